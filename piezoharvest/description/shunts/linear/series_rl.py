"""Resonant shunt: inductance and resistance in series."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class SeriesRL(LinearShunt):
    """Inductance in series with a resistance, across the electrodes."""

    kind: ClassVar[str] = "series_rl"
    source: ClassVar[str] = "Hagood & von Flotow, J. Sound Vib. 146(2), 243-268, 1991"

    inductance: float = quantity("H", "inductance", above=0)
    resistance: float = quantity("ohm", "series resistance", above=0)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (State("current", self.inductance),)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [port.i - z.current, self.inductance * dz.current + self.resistance * z.current - port.v]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        return {"harvested": [Product(self.resistance, z.current, z.current)]}
