"""Charge extraction by electronic breakers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.self_powered.breaker import ElectronicBreaker
from piezoharvest.description.shunts.self_powered.breaker_states import breakers_of


@dataclass(frozen=True, kw_only=True)
class SelfPoweredSECE(ElectronicBreaker):
    """Self-powered SECE: a breaker connects the electrodes to a coil, which supplies the load when they are empty.

    The path has two diodes, one of them the breaker's own.
    """

    kind: ClassVar[str] = "self_powered_sece"
    source: ClassVar[str] = "Zhu, Chen & Liu, IEEE Trans. Ind. Electron. 59(6), 2449-2455, 2012"
    path_diodes: ClassVar[int] = 2

    efficiency: float = quantity(
        "", "fraction of the extracted energy that reaches the load", default=1.0, at_least=0, at_most=1
    )

    def states(self, capacitance: float) -> tuple[State, ...]:
        inductor, *others = self.breaker_states(capacitance)
        return (inductor._replace(recovered=self.efficiency), *others)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        breakers = breakers_of(configuration)
        return [port.i - self.breaker_current(breakers, port, z), *self.breaker_equations(breakers, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        return {"shunt_loss": self.breaker_losses(breakers_of(configuration), port, z)}

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        breakers, guards = breakers_of(configuration), list(super().guards(configuration, port, z))
        if breakers.sign:
            after = breakers._replace(position="open").name
            inductor = self.real_coil(port.capacitance).names[0]
            guards.append(Guard(-breakers.sign * port.v, after, inductor, event="switch opens"))
        return guards
