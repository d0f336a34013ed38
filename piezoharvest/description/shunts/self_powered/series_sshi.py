"""Series switch harvesting on an inductor, by electronic breakers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.self_powered.breaker import ElectronicBreaker
from piezoharvest.description.shunts.self_powered.breaker_states import Breakers, breakers_of


@dataclass(frozen=True, kw_only=True)
class SelfPoweredSeriesSSHI(ElectronicBreaker, Bridge):
    """Self-powered series SSHI: breakers, coil and rectifier in series.

    Charge flows to the dc side while a breaker is closed. The path has the breaker's own diode and two of the bridge.
    Reverse leakage between the electrodes is neglected, as in series SSHI.
    """

    kind: ClassVar[str] = "self_powered_series_sshi"
    source: ClassVar[str] = "Lallart & Guyomar, Smart Mater. Struct. 17(3), 035030, 2008"
    path_diodes: ClassVar[int] = 3

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (*self.breaker_states(capacitance), *self.bridge_states())

    def path_excess(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        return super().path_excess(sign, port, z) - self.level(sign, port, z)

    def line(self, sign: int) -> Any:
        return self.resistance(sign)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        breakers = breakers_of(configuration)
        own, rectified = self.breaker_equations(breakers, port, z, dz), self._rectified(breakers, port, z)
        return [port.i - self.breaker_current(breakers, port, z), *own, *self.dc_equations(rectified, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        breakers = breakers_of(configuration)
        rectified = self._rectified(breakers, port, z)
        powers = self.bridge_powers(rectified, port, z)
        # The drops of the bridge are those of the breaker's path, too, and counted there.
        lost = [Product(self.path_resistance, rectified, rectified)]
        lost += self.dc_loss(self.terminal(rectified, port, z), port)
        lost += self.capacitor_loss(rectified, port, z)
        powers["shunt_loss"] = [*lost, *self.breaker_losses(breakers, port, z)]
        return powers

    def _rectified(self, breakers: Breakers, port: Port, z: SimpleNamespace) -> Row:
        return breakers.sign * self.path_current(breakers, port, z)
