"""Network of resistors, inductors and capacitors for the solver, by its nodes."""

from __future__ import annotations

import numpy as np

from piezoharvest.bench.solver.loads.circuits import Circuit
from piezoharvest.description.netlist import Element


class Network(Circuit):
    """A netlist between nodes 1 and 0; states are the voltages of its capacitors, then the currents of its inductors.

    Potentials and their rates, currents of capacitors and that of the port follow from the current law at every node,
    from the voltages of capacitors and their derivatives. Where only inductors meet, the derivative of the current law
    says which potential they have. What the rest leaves open (rates between resistors) has no influence: least squares.
    """

    netlist: tuple[Element, ...]

    def meet(self, capacitance):
        kinds = {kind: [e for e in self.netlist if e.kind == kind] for kind in "RLC"}
        self.storage = tuple(e.value for kind in "CL" for e in kinds[kind])
        nodes = sorted({node for e in self.netlist for node in e.nodes} - {0})
        ends = {kind: np.array([self._ends(e, nodes) for e in each]).reshape(-1, len(nodes)).T
                for kind, each in kinds.items()}  # fmt: skip
        # In units in which the parts are of the size of one: ohm, and s.
        unit = float(np.exp(np.mean(np.log([e.value for e in kinds["R"]])))) if kinds["R"] else 1.0
        rates = [e.value * unit for e in kinds["C"]] + [e.value / unit for e in kinds["L"]]
        time = float(np.exp(np.mean(np.log(rates)))) if rates else 1.0
        conductance = ends["R"] @ np.diag([unit / e.value for e in kinds["R"]]) @ ends["R"].T
        filled = np.diag([time / (e.value * unit) for e in kinds["C"]])
        wound = np.diag([time * unit / e.value for e in kinds["L"]])
        n, caps, coils = len(nodes), len(kinds["C"]), len(kinds["L"])
        port = np.array([[-1.0] if node == 1 else [0.0] for node in nodes])
        meeting = _left_null(np.hstack((ends["R"], ends["C"], port))) @ ends["L"] @ wound
        # Columns: potentials, their rates, currents of the capacitors, port current; then, known as the potential of
        # node 1 and its rate are, voltages of the capacitors and currents of the inductors.
        rows = np.vstack((
            np.hstack((conductance, np.zeros((n, n)), ends["C"], port, np.zeros((n, caps)), ends["L"])),
            np.hstack((ends["C"].T, np.zeros((caps, n + caps + 1)), -np.eye(caps), np.zeros((caps, coils)))),
            np.hstack((np.zeros((caps, n)), ends["C"].T, -filled, np.zeros((caps, 1 + caps + coils)))),
            np.hstack((meeting @ ends["L"].T, np.zeros((len(meeting), n + 2 * caps + 1 + coils)))),
        ))  # fmt: skip
        first = nodes.index(1)
        known = [*range(2 * n + caps + 1, rows.shape[1]), first, n + first]
        unknown = [k for k in range(2 * n + caps + 1) if k not in known]
        found = np.zeros((rows.shape[1], len(known)))
        found[known] = np.eye(len(known))
        found[unknown] = -np.linalg.lstsq(rows[:, unknown], rows[:, known], rcond=None)[0]
        # To states, voltage and rate in SI: currents are in V/unit, rates in V/time.
        sizes = np.array([1.0] * caps + [unit] * coils + [1.0, time])
        self._port = found[2 * n + caps] * sizes / unit
        into = found[2 * n : 2 * n + caps] * sizes / unit
        across = ends["L"].T @ found[:n] * sizes
        self._rates = np.vstack((into, across)) / np.array(self.storage).reshape(-1, 1)

    def flow(self, z, v, free, elastance):
        seen = np.vstack((z, v))
        beside = self._port[-1]  # capacitance that the port has
        i = (self._port[:-1] @ seen + beside * free) / (1.0 + beside * elastance)
        rise = free - elastance * i
        return i, self._rates[:, :-1] @ seen + self._rates[:, -1:] * rise

    @staticmethod
    def _ends(element: Element, nodes: list[int]) -> list[float]:
        """Row of the nodes: the element's current leaves the first of its own and enters the second."""
        return [float(node == element.nodes[0]) - float(node == element.nodes[1]) for node in nodes]


def _left_null(matrix: np.ndarray) -> np.ndarray:
    """Combinations of rows that vanish, one in each row."""
    from scipy.linalg import null_space

    return null_space(matrix.T).T
