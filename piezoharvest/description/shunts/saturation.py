"""A rectifying circuit whose diodes pass a saturation current backwards, at any voltage of its dc side."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row
from piezoharvest.description.shunts.base import ExtendedCircuit, Shunt, own_configuration
from piezoharvest.description.shunts.bridge import Bridge

LOW, HIGH = "low", "high"
BACK = 1e-5  # of the voltage between the two: by so much less it is left downwards, so that they do not alternate


def with_saturation(whole: Shunt, shunt: Shunt) -> Shunt:
    """The `whole` circuit, where diodes of `shunt` may discharge a capacitor, at low and at high voltages of that."""
    if not isinstance(shunt, Bridge) or shunt.smoothing_capacitance is None:
        return whole
    return Saturated(circuit=whole, at=shunt.saturation_voltage) if np.any(np.real(shunt.diode_saturation)) else whole


@dataclass(frozen=True, kw_only=True)
class Saturated(ExtendedCircuit):
    """A circuit while the dc voltage is so high that blocking diodes are saturated ("high open+"), and below ("low").

    What they take of the dc side is a constant current, or one in proportion to the voltage; the two meet at the
    voltage `at`, V.
    """

    at: Any

    def configurations(self) -> tuple[str, ...]:
        return tuple(f"{level} {own}" for level in (LOW, HIGH) for own in self.circuit.configurations())

    def alike(self) -> tuple[str, ...]:
        return tuple(f"{level} {own}" for level in (LOW, HIGH) for own in self.circuit.alike())

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        level, own = configuration.split(" ", 1)
        return _at(level, self.circuit).equations(own, port, z, dz)

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        level, own = configuration.split(" ", 1)
        return _at(level, self.circuit).powers(own, port, z)

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        level, own = configuration.split(" ", 1)
        guards = [
            guard._replace(target=f"{level} {guard.target}", conducts=guard.begins_to_conduct)
            for guard in _at(level, self.circuit).guards(own, port, z)
        ]
        if level == LOW:
            return [*guards, Guard(z.dc - self.at * port.one, f"{HIGH} {own}", event="")]
        return [*guards, Guard((1.0 - BACK) * self.at * port.one - z.dc, f"{LOW} {own}", event="")]

    def closed(self, configuration: str, polarity: int) -> str:
        level = configuration.split(" ", 1)[0]
        return f"{level} {self.circuit.closed(own_configuration(configuration), polarity)}"

    def opened(self, configuration: str) -> str:
        level = configuration.split(" ", 1)[0]
        return f"{level} {self.circuit.opened(own_configuration(configuration))}"


def _at(level: str, circuit: Shunt) -> Shunt:
    """The circuit with its bridge, which may be inside of others, at one level of the dc voltage."""
    found = copy.copy(circuit)
    if isinstance(circuit, ExtendedCircuit):
        found.__dict__["circuit"] = _at(level, circuit.circuit)
    else:
        found.__dict__["low"] = level == LOW
    return found
