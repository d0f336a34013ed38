"""Resonant shunt: inductance and resistance in parallel."""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.circuit import Product, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class ParallelRL(LinearShunt):
    """Inductance beside a resistance, across the electrodes."""

    kind: ClassVar[str] = "parallel_rl"
    source: ClassVar[str] = "Wu, Proc. SPIE 2720, 259-269, 1996"

    inductance: float = quantity("H", "inductance", above=0)
    resistance: float = quantity("ohm", "parallel resistance", above=0)

    def states(self, capacitance):
        return (State("current", self.inductance),)

    def equations(self, configuration, port, z, dz):
        return [self.resistance * (port.i - z.current) - port.v, self.inductance * dz.current - port.v]

    def powers(self, configuration, port, z):
        return {"harvested": [Product(1.0 / self.resistance, port.v, port.v)]}
