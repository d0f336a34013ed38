"""Resonant shunt: inductance and resistance in parallel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.linear.coil import WoundShunt


@dataclass(frozen=True, kw_only=True)
class ParallelRL(WoundShunt):
    """Inductor and resistor in parallel across the electrodes, and so is the capacitance of a winding.

    Its voltage is a state only for its energy, as that of `parallel_rlc`.
    """

    kind: ClassVar[str] = "parallel_rl"
    source: ClassVar[str] = "Wu, Proc. SPIE 2720, 259-269, 1996"

    resistance: float = quantity("ohm", "parallel resistance", above=0)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return self.coil_states()

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        rest, coil = port.i - self.winding_current(self.winding, port.v, z), self.coil(self.winding, port.v, z, dz)
        if self.self_resonance is not None:
            rest, coil = rest - self.stray_capacitance * dz.winding, [*coil, dz.winding - port.dv]
        return [self.resistance * rest - port.v, *coil]  # divided by it, a certificate over a tolerance is far wider

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        current = self.winding_current(self.winding, port.v, z)
        return {"harvested": [Product(1.0 / self.resistance, port.v, port.v)], **self.coil_losses(current, z)}
