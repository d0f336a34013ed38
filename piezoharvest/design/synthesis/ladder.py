"""Ladders: coils and capacitors in series and across, one after the other between the electrodes and one load resistor.

Capitals are arms in series, small letters arms across: "Lc" is a coil from the electrodes to a capacitor with the load
beside it. A lossless network that ends in one resistor can have any positive-real impedance (Darlington, J. Math. Phys.
18, 257-353, 1939); ladders are those that need neither transformers nor bridges.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from piezoharvest.description.netlist import Element
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.linear.network import Circuit, Network

LOAD = "R1"
_UNITS = {"R": ("ohm", "load resistance"), "L": ("H", "inductance"), "C": ("F", "capacitance")}
# The immittance of an arm (impedance in series, admittance across) rises with its value, or falls.
_RISES = {"L": 1.0, "C": -1.0, "l": -1.0, "c": 1.0}


@dataclass(frozen=True, kw_only=True)
class Ladder(Circuit):
    """Ladder with one field for the value of each arm, in the order from the electrodes, and last the load "R1".

    Attributes
    ----------
    arms : str
    loss : float
        Series resistance of all coils in ohm per henry. It belongs to the coil: it rises with the inductance, and what
        it takes is lost.
    """

    arms: ClassVar[str] = ""
    loss: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        # Of the instance: classes with a kind are found by study files, and this one is what tuning works on.
        object.__setattr__(self, "kind", Network.kind)

    @cached_property
    def elements(self) -> tuple[Element, ...]:
        """Elements of the circuit, the coils' resistances among them."""
        found, node, last = [], 1, 1
        for name, arm in zip(names_of(self.arms), self.arms, strict=True):
            value, end = getattr(self, name), 0
            if arm.isupper():
                end = last = last + 1
            inner = end
            if arm in "Ll" and self.loss:
                inner = last = last + 1
                found.append(Element(f"R{name}", "R", (inner, end), value * self.loss))
            found.append(Element(name, arm.upper(), (node, inner), value))
            node = end or node
        return (*found, Element(LOAD, "R", (node, 0), getattr(self, LOAD), load=True))

    def network(self) -> Network:
        """The same circuit as a netlist, with its nodes numbered from the electrodes on."""
        order = {0: 0, 1: 1}
        for e in self.elements:
            for node in e.nodes:
                order.setdefault(node, len(order))
        moved = [dataclasses.replace(e, nodes=(order[e.nodes[0]], order[e.nodes[1]])) for e in self.elements]
        return Network(netlist=moved)


class Chain(NamedTuple):
    """Port voltage (..., f) in V and current in A for a load current of 1 A."""

    voltage: np.ndarray
    current: np.ndarray


def names_of(arms: str) -> tuple[str, ...]:
    """Names of the arms: L1, L2, C1, ... in the order from the electrodes."""
    kinds = arms.upper()
    return tuple(f"{kind}{kinds[: n + 1].count(kind)}" for n, kind in enumerate(kinds))


@cache
def ladder_class(arms: str, loss: float) -> type[Ladder]:
    """Class of the ladders with some arms, from the electrodes to the load, and coils of some loss in ohm per henry."""
    names = (*names_of(arms), LOAD)
    fields: list[Any] = [(name, float, quantity(*_UNITS[name[0]], above=0)) for name in names]
    namespace = {"arms": arms, "loss": loss, "__doc__": Ladder.__doc__, "__module__": __name__}
    return dataclasses.make_dataclass("Ladder", fields, bases=(Ladder,), namespace=namespace, frozen=True, kw_only=True)


def chain(ladder: Ladder, s: np.ndarray) -> Chain:
    """Chain of a ladder, or of a batch of designs, at complex frequencies (f,) in rad/s."""
    voltage, current = getattr(ladder, LOAD) + 0 * s, 1.0 + 0 * s
    for name, arm in zip(reversed(names_of(ladder.arms)), reversed(ladder.arms), strict=True):
        x = _immittance(arm, getattr(ladder, name), ladder.loss, s)
        if arm.isupper():
            voltage = voltage + x * current
        else:
            current = current + x * voltage
    return Chain(voltage, current)


def chain_slopes(arms: str, logs: np.ndarray, loss: float, s: np.ndarray) -> tuple[Chain, Chain]:
    """Chain of one ladder, and its derivatives (n, f) by the logarithms of the values (n,) of all arms and the load.

    From the load to the port the voltage and the current add up; from the port back, rows say what each of them gives.
    """
    values = np.exp(logs)
    x = [_immittance(arm, value, loss, s) for arm, value in zip(arms, values, strict=False)]
    voltage, current = values[-1] + 0 * s, 1.0 + 0 * s
    behind = []
    for arm, own in zip(reversed(arms), reversed(x), strict=True):
        behind.append((voltage, current))
        voltage, current = (voltage + own * current, current) if arm.isupper() else (voltage, current + own * voltage)
    by_voltage, by_current = np.array([[1.0], [0.0]]) + 0 * s, np.array([[0.0], [1.0]]) + 0 * s
    slopes = np.empty((2, len(values), len(s)), complex)
    for k, (arm, own) in enumerate(zip(arms, x, strict=True)):
        v, i = behind[-1 - k]
        if arm.isupper():
            slopes[:, k] = _RISES[arm] * by_voltage * own * i
            by_current = by_current + by_voltage * own
        else:
            slopes[:, k] = _RISES[arm] * by_current * own * v
            by_voltage = by_voltage + by_current * own
    slopes[:, -1] = by_voltage * values[-1]
    return Chain(voltage, current), Chain(slopes[0], slopes[1])


def _immittance(arm: str, value: Any, loss: float, s: np.ndarray) -> np.ndarray:
    """Impedance of an arm in series, admittance of one across."""
    coil = arm in "Ll"
    own = value * (s + loss) if coil else value * s
    return own if arm in "Lc" else 1 / own
