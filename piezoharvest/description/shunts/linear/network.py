"""Any network of resistors, inductors and capacitors: `Circuit` has the equations, `Network` reads a netlist."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.netlist import Element, NormalTree, normal_tree, read_netlist
from piezoharvest.description.parameters import described
from piezoharvest.description.shunts.base import LinearShunt


class _Resistive(NamedTuple):
    """Elimination of the resistors: gains from [port voltage, tree capacitor voltages, link inductor currents].

    Arrays (n, m), for a batch of designs (n, m, designs, 1).
    """

    link_currents: np.ndarray
    tree_voltages: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Circuit(LinearShunt):
    """R, L and C elements between numbered nodes, port at nodes 1 and 0, loads among the resistors.

    Subclasses give the elements, whose values may be arrays for a batch of designs.

    Notes
    -----
    The equations follow from a normal tree in which the port is a branch of imposed voltage. Capacitors in a loop with
    others or with the port, and inductors in a cutset with others, are not independent states: they are kept for their
    energy, tied to the others by the derivative of their constraint.
    """

    @property
    def elements(self) -> tuple[Element, ...]:
        """The elements, in the order of the netlist."""
        raise NotImplementedError

    @cached_property
    def _topology(self) -> NormalTree:
        return normal_tree(self.elements)

    @cached_property
    def _resistive(self) -> _Resistive:
        """Eliminate the resistors: (R_l + F' R_t F) i_l = v_l of the rest, a positive definite system."""
        tree, links, _ = self._topology
        of_tree, of_links = _diagonal(tree), _diagonal(links)
        cut_r, cut_l = self._cut("R", "R"), self._cut("R", "L")
        own = -cut_r.T @ of_tree @ cut_l
        outer = [np.broadcast_to(self._cut(kind, "R").T, (*own.shape[:-2], len(cut_r.T), n))
                 for kind, n in (("port", 1), ("C", len(self._cut("C", "R"))))]  # fmt: skip
        currents = np.linalg.solve(of_links + cut_r.T @ of_tree @ cut_r, np.concatenate([*outer, own], axis=-1))
        through = cut_r @ currents
        through[..., through.shape[-1] - cut_l.shape[1] :] += cut_l
        return _Resistive(*(np.moveaxis(gain, (-2, -1), (0, 1)) for gain in (currents, -of_tree @ through)))

    def _cut(self, branch: str, link: str) -> np.ndarray:
        """Part of the cutset matrix between tree branches of one kind ("port" too) and links of another."""
        tree, links, cut = self._topology
        rows = [n for n, kind in enumerate(["port", *(e.kind for e in tree)]) if kind == branch]
        return cut[np.ix_(rows, [n for n, e in enumerate(links) if e.kind == link])]

    def states(self, capacitance: float) -> tuple[State, ...]:
        """Voltage of every capacitor and current of every inductor."""
        storing = [e for e in self.elements if e.kind != "R"]
        return tuple(State(_state(e), e.value) for e in storing)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        """Current law at the port and of tree capacitors, voltage law of link inductors, ties of redundant states."""
        tree, links, cut = self._topology
        none = 0.0 * port.one
        link_currents, tree_voltages = self._resistors(port, z)

        def current(e: Element) -> Row:
            """Current of a link."""
            return link_currents[e.name] if e.kind == "R" else e.value * _of(dz, e) if e.kind == "C" else _of(z, e)

        def voltage(e: Element) -> Row:
            """Voltage across a branch of the tree."""
            return tree_voltages[e.name] if e.kind == "R" else _of(z, e) if e.kind == "C" else e.value * _of(dz, e)

        currents = [current(e) for e in links]
        voltages = [port.v, *(voltage(e) for e in tree)]
        # Only loops of capacitors and cutsets of inductors are differentiated: they contain no resistor.
        current_rates = [_of(dz, e) if e.kind == "L" else none for e in links]
        voltage_rates = [port.dv, *(_of(dz, e) if e.kind == "C" else none for e in tree)]

        equations = [port.i - _combine(cut[0], currents, none)]
        for row, e in zip(cut[1:], tree, strict=True):
            if e.kind == "C":
                equations.append(e.value * _of(dz, e) + _combine(row, currents, none))
            elif e.kind == "L":
                equations.append(_of(dz, e) + _combine(row, current_rates, none))
        for column, e in zip(cut.T, links, strict=True):
            if e.kind == "L":
                equations.append(e.value * _of(dz, e) - _combine(column, voltages, none))
            elif e.kind == "C":
                equations.append(_of(dz, e) - _combine(column, voltage_rates, none))
        return equations

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        """Power of each resistor: harvested in loads, lost in others."""
        link_currents, tree_voltages = self._resistors(port, z)
        powers: dict[str, list[Product]] = {"harvested": [], "shunt_loss": []}
        for e in (e for e in (*self._topology.links, *self._topology.tree) if e.kind == "R"):
            row, weight = (tree_voltages[e.name], 1.0 / e.value) if e.name in tree_voltages else (
                link_currents[e.name], e.value)  # fmt: skip
            powers["harvested" if e.load else "shunt_loss"].append(Product(weight, row, row))
        return powers

    def _resistors(self, port: Port, z: SimpleNamespace) -> tuple[dict[str, Row], dict[str, Row]]:
        """Currents of the resistors among the links and voltages of those in the tree, by name."""
        tree, links, _ = self._topology
        none = 0.0 * port.one
        drive = [port.v, *(_of(z, e) for e in tree if e.kind == "C"), *(_of(z, e) for e in links if e.kind == "L")]
        gains = self._resistive
        currents = [_combine(row, drive, none) for row in gains.link_currents]
        voltages = [_combine(row, drive, none) for row in gains.tree_voltages]
        return (
            dict(zip((e.name for e in links if e.kind == "R"), currents, strict=True)),
            dict(zip((e.name for e in tree if e.kind == "R"), voltages, strict=True)),
        )


@dataclass(frozen=True, kw_only=True)
class Network(Circuit):
    """Any circuit of resistors, inductors and capacitors, as a netlist with the electrodes at nodes 1 and 0.

    Parameters
    ----------
    netlist : str or sequence of str, mapping or Element
        One element a line, as in "R1 1 2 100k", the loads with "load=true"; or a table for each element.

    Raises
    ------
    ParameterError
        An element or the circuit is not allowed.
    """

    kind: ClassVar[str] = "network"
    source: ClassVar[str] = "Bryant, Proc. IEE C 106(9), 174-188, 1959; Kuo & Rohrer, Proc. IEEE 55(9), 1201-1219, 1967"

    netlist: str | Sequence[str | Mapping[str, Any] | Element] = described(
        'elements, one per line as in "R1 1 2 100k", with "load=true" after the load; or a list of tables'
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "netlist", read_netlist(self.netlist))

    @property
    def elements(self) -> tuple[Element, ...]:
        """The elements, in the order of the netlist."""
        return self.netlist  # type: ignore[return-value]


def _diagonal(branches: Iterable[Element]) -> np.ndarray:
    """Diagonal matrix (..., n, n) of the resistances among some branches."""
    values = np.broadcast_arrays(*(e.value for e in branches if e.kind == "R"))
    return np.stack(values, axis=-1)[..., None] * np.eye(len(values)) if values else np.zeros((0, 0))


def _state(element: Element) -> str:
    """Name of an element's state."""
    return f"{'voltage' if element.kind == 'C' else 'current'}_{element.name}"


def _of(states: SimpleNamespace, element: Element) -> Row:
    """Row of an element's state, or of its derivative."""
    return getattr(states, _state(element))


def _combine(coefficients: Iterable[float], rows: Sequence[Row], none: Row) -> Row:
    """Sum of coefficient * row, without absent terms."""
    return sum((c * row for c, row in zip(coefficients, rows, strict=True) if np.any(c)), start=none)
