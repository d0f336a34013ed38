"""Networks for the solver, by their nodes: resistors, inductors and capacitors, constant sources, diodes and switches.

Potentials and their rates, and the currents of all parts but inductors, follow from the current law at every node,
from the law of every part, and from its derivative where that says more: for loops of capacitors, and for nodes at
which only inductors meet. What this leaves open (rates between resistors) has no influence: least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from piezoharvest.bench.solver.loads.circuits import Circuit
from piezoharvest.description.netlist import Element

ALIKE = 1e-13  # ratio of singular values below which equations are taken for the same one
PASSES = 30  # of scaling; each halves the decades between the largest values of rows and columns
ROUNDS = 3  # of solving for what rounding has left


class Part(NamedTuple):
    """A part whose current leaves the first of its nodes and enters the second.

    Attributes
    ----------
    kind : str
        R, L, C, V or I.
    nodes : (int, int)
        The port is at 1 and 0.
    value : float
        ohm, H, F, V or A.
    ahead : float
        Voltage in series with a resistance, V.
    """

    kind: str
    nodes: tuple[int, int]
    value: float
    ahead: float = 0.0


class Laws(NamedTuple):
    """Quantities as rows.

    Columns are the voltages of capacitors, the currents of inductors, 1, the voltage of the port and its rate.

    Attributes
    ----------
    potentials : (nodes, columns) array
        That of node 0 is zero.
    rates : (states, columns) array
        Of the voltages of capacitors and the currents of inductors.
    resistive : (resistances, columns) array
        Currents of the resistances.
    port : (columns,) array
        Current of the port.
    """

    potentials: np.ndarray
    rates: np.ndarray
    resistive: np.ndarray
    port: np.ndarray


def laws(parts: Sequence[Part], inductances: np.ndarray) -> Laws:
    """Solve a network.

    Parameters
    ----------
    parts : sequence of Part
    inductances : (inductors, inductors) array
        Matrix of the inductors in their order, H.
    """
    ends, values, port = described(parts)
    ahead = np.array([part.ahead for part in parts if part.kind == "R"])
    softness = np.linalg.inv(inductances) if len(inductances) else inductances
    # Currents of inductors change as the potentials say: the current law there is one of these.
    meeting = only_inductors(ends, port) @ ends["L"]
    nodes, kinds = len(port), {kind: len(each) for kind, each in values.items()}
    sizes = {"e": nodes, "de": nodes, "C": kinds["C"], "V": kinds["V"], "R": kinds["R"], "port": 1,
             "u": kinds["C"], "i": kinds["L"], "1": 1, "v": 1, "dv": 1}  # fmt: skip
    place = dict(zip(sizes, np.split(np.arange(sum(sizes.values())), np.cumsum([*sizes.values()])[:-1]), strict=True))

    def equations(**blocks: np.ndarray) -> np.ndarray:
        rows = np.zeros((len(next(iter(blocks.values()))), sum(sizes.values())))
        for name, block in blocks.items():
            rows[:, place[name]] = block
        return rows

    one = np.eye(1, nodes)
    rows = np.vstack((
        equations(**{"R": ends["R"], "C": ends["C"], "V": ends["V"], "port": port, "i": ends["L"],
                     "1": ends["I"] @ values["I"][:, None]}),
        equations(**{"e": ends["R"].T, "R": -np.diag(values["R"]), "1": -ahead[:, None]}),
        equations(**{"e": ends["V"].T, "1": -values["V"][:, None]}),
        equations(**{"de": ends["V"].T}),
        equations(**{"e": ends["C"].T, "u": -np.eye(sizes["C"])}),
        equations(**{"de": ends["C"].T * values["C"][:, None], "C": -np.eye(sizes["C"])}),
        equations(**{"e": meeting @ softness @ ends["L"].T}),
        equations(**{"e": one, "v": -np.eye(1)}),
        equations(**{"de": one, "dv": -np.eye(1)}),
    ))  # fmt: skip
    unknown = np.concatenate([place[name] for name in ("e", "de", "C", "V", "R", "port")])
    known = np.concatenate([place[name] for name in ("u", "i", "1", "v", "dv")])
    found = _solved(rows[:, unknown], -rows[:, known])
    into = found[place["C"]] / values["C"][:, None]
    across = softness @ (ends["L"].T @ found[place["e"]])
    potentials = np.vstack((np.zeros(len(known)), found[place["e"]]))
    return Laws(potentials, np.vstack((into, across)), found[place["R"]], found[place["port"][0]])


class Network(Circuit):
    """A netlist between nodes 1 and 0; states are the capacitors' voltages, then the inductors' currents."""

    netlist: tuple[Element, ...]

    def meet(self, capacitance):
        parts = [Part(e.kind, e.nodes, e.value) for e in self.netlist]
        coils = np.diag([part.value for part in parts if part.kind == "L"])
        self.storage = tuple(part.value for kind in "CL" for part in parts if part.kind == kind)
        self.laws = laws(parts, coils)

    def flow(self, z, v, free, elastance):
        found, seen = self.laws, np.vstack((z, 0.0 * v + 1.0, v))
        beside = found.port[-1]  # capacitance that the port has
        i = (found.port[:-1] @ seen + beside * free) / (1.0 + beside * elastance)
        rise = free - elastance * i
        return i, found.rates[:, :-1] @ seen + found.rates[:, -1:] * rise


def described(parts: Sequence[Part]) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """Network as matrices.

    Returns
    -------
    ends : dict of (nodes, parts) array
        For each kind, 1 where a current leaves a node and -1 where it enters one; without node 0.
    values : dict of (parts,) array
    port : (nodes, 1) array
        The same of the port's current.
    """
    count = 1 + max(node for part in parts for node in part.nodes)
    ends, values = {}, {}
    for kind in "RLCVI":
        of = [part for part in parts if part.kind == kind]
        plus, minus = (np.array([part.nodes[k] for part in of], int) for k in (0, 1))
        ends[kind] = (np.eye(count)[:, plus] - np.eye(count)[:, minus])[1:]
        values[kind] = np.array([part.value for part in of])
    return ends, values, -np.eye(count)[1:, 1:2]


def only_inductors(ends: dict[str, np.ndarray], port: np.ndarray) -> np.ndarray:
    """Combinations of the current law at the nodes that have inductors and constant currents only, one in each row."""
    from scipy.linalg import null_space

    return null_space(np.hstack((ends["R"], ends["C"], ends["V"], port)).T).T


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Least squares of equations whose parts may lie many decades apart.

    Rows and columns are scaled to the size of one, and what rounding leaves is solved for again.
    """
    rows, columns = np.ones((len(matrix), 1)), np.ones((1, matrix.shape[1]))
    for _ in range(PASSES):
        scaled = np.abs(matrix) * rows * columns
        rows = rows / np.sqrt(_size(scaled, 1))
        columns = columns / np.sqrt(_size(scaled, 0))
    scaled, wanted = matrix * rows * columns, right * rows
    inverse, found = np.linalg.pinv(scaled, rcond=ALIKE), np.zeros((matrix.shape[1], right.shape[1]))
    exact = scaled.astype(np.longdouble)
    for _ in range(ROUNDS):
        found = found + inverse @ (wanted - exact @ found).astype(float)
    return found * columns.T


def _size(values: np.ndarray, axis: int) -> np.ndarray:
    """Largest of each row or column, 1 where all are zero."""
    largest = values.max(axis=axis, keepdims=True, initial=0.0)
    return np.where(largest > 0.0, largest, 1.0)
