"""Negative capacitance, from an active circuit, with a resistance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar, Literal

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import described, quantity
from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class NegativeCapacitance(LinearShunt):
    """Ideal negative capacitance -C_n in parallel or in series with a resistance."""

    kind: ClassVar[str] = "negative_capacitance"
    source: ClassVar[str] = "Forward, J. Spacecraft Rockets 16(1), 11-17, 1979; de Marneffe & Preumont, SMS 17, 2008"

    capacitance: float = quantity("F", "magnitude C_n of the negative capacitance", above=0)
    resistance: float = quantity("ohm", "resistance of the branch", above=0)
    topology: Literal["parallel", "series"] = described(
        "whether the resistance is in parallel or in series with the capacitance", default="parallel"
    )

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (State("voltage", -self.capacitance),)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        current = -self.capacitance * dz.voltage
        if self.topology == "parallel":
            return [port.i - port.v / self.resistance - current, dz.voltage - port.dv]
        return [port.i - current, self.resistance * port.i + z.voltage - port.v]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        if self.topology == "parallel":
            return {"harvested": [Product(1.0 / self.resistance, port.v, port.v)]}
        return {"harvested": [Product(self.resistance, port.i, port.i)]}
