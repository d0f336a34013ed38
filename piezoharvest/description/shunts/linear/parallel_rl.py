"""Resonant shunt: inductance and resistance in parallel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class ParallelRL(LinearShunt):
    """Inductance beside a resistance, across the electrodes."""

    kind: ClassVar[str] = "parallel_rl"
    source: ClassVar[str] = "Wu, Proc. SPIE 2720, 259-269, 1996"

    inductance: float = quantity("H", "inductance", above=0)
    resistance: float = quantity("ohm", "parallel resistance", above=0)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (State("current", self.inductance),)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [self.resistance * (port.i - z.current) - port.v, self.inductance * dz.current - port.v]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        return {"harvested": [Product(1.0 / self.resistance, port.v, port.v)]}
