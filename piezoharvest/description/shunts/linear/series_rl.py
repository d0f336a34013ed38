"""Resonant shunt: inductance and resistance in series."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.linear.coil import WoundShunt


@dataclass(frozen=True, kw_only=True)
class SeriesRL(WoundShunt):
    """Inductor and resistor in series across the electrodes."""

    kind: ClassVar[str] = "series_rl"
    source: ClassVar[str] = "Hagood & von Flotow, J. Sound Vib. 146(2), 243-268, 1991"

    resistance: float = quantity("ohm", "series resistance", above=0)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return self.coil_states()

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        current, coil = self.coil(self.resistance + self.winding, port.v, z, dz)
        return [port.i - current, *coil]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        current = self.coil_current(self.resistance + self.winding, port.v, z)
        return {"harvested": [Product(self.resistance, current, current)], **self.coil_losses(current, z)}
