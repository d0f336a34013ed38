"""Switch damping on an inductor, by electronic breakers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.shunts.self_powered.breaker import ElectronicBreaker
from piezoharvest.description.shunts.self_powered.breaker_states import breakers_of


@dataclass(frozen=True, kw_only=True)
class SelfPoweredSSDI(ElectronicBreaker):
    """Self-powered SSDI: two electronic breakers invert the voltage of the electrodes through a coil.

    As nothing is harvested, `consumption` is taken from another supply.
    """

    kind: ClassVar[str] = "self_powered_ssdi"
    source: ClassVar[str] = "Lallart, Lefeuvre, Richard & Guyomar, Sens. Actuators A 143(2), 377-382, 2008"

    def states(self, capacitance: float) -> tuple[State, ...]:
        return self.breaker_states(capacitance)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        breakers = breakers_of(configuration)
        return [port.i - self.breaker_current(breakers, port, z), *self.breaker_equations(breakers, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        losses, control = self.breaker_losses(breakers_of(configuration), port, z), super().control(port)
        return {"shunt_loss": [*losses, *control], "source": control} if control else {"shunt_loss": losses}

    def control(self, port: Port) -> list[Product]:
        return []  # nothing is harvested that it could be taken from
