"""Resonant shunt: inductance and resistance in series."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

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
        current, (series, across) = self._current(port, z), self._across(port, z)
        coil = self.coil(series, across, z, dz)
        if self.self_resonance is not None:
            stray = self.stray_capacitance * dz.winding + self.winding_current(series, across, z) - current
            coil.append(stray)
        return [port.i - current, *coil]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        current, wound = self._current(port, z), self.winding_current(*self._across(port, z), z)
        return {"harvested": [Product(self.resistance, current, current)], **self.coil_losses(wound, z)}

    def _across(self, port: Port, z: SimpleNamespace) -> tuple[Any, Row]:
        """Resistance in line with the inductance up to where a voltage is known, and this voltage."""
        if self.self_resonance is not None:
            return self.winding, z.winding
        return self.resistance + self.winding, port.v

    def _current(self, port: Port, z: SimpleNamespace) -> Row:
        """Current into the shunt, A."""
        if self.self_resonance is not None:
            return (port.v - z.winding) / self.resistance
        return self.winding_current(*self._across(port, z), z)
