"""Resonant shunt: inductance, resistance and capacitance in series."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class SeriesRLC(LinearShunt):
    """Inductor, resistor and capacitor in series across the electrodes."""

    kind: ClassVar[str] = "series_rlc"
    source: ClassVar[str] = "Moheimani & Fleming, Piezoelectric Transducers for Vibration Control and Damping, 2006"

    inductance: float = quantity("H", "inductance", above=0)
    resistance: float = quantity("ohm", "series resistance", above=0)
    capacitance: float = quantity("F", "series capacitance", above=0)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (State("current", self.inductance), State("voltage", self.capacitance))

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [
            port.i - z.current,
            self.inductance * dz.current + self.resistance * z.current + z.voltage - port.v,
            self.capacitance * dz.voltage - z.current,
        ]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        return {"harvested": [Product(self.resistance, z.current, z.current)]}
