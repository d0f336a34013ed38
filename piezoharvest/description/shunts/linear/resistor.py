"""Resistive load."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class Resistor(LinearShunt):
    """Load resistor across the electrodes."""

    kind: ClassVar[str] = "resistor"
    source: ClassVar[str] = "Hagood & von Flotow, J. Sound Vib. 146(2), 243-268, 1991"

    resistance: float = quantity("ohm", "load resistance", above=0)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [self.resistance * port.i - port.v]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        return {"harvested": [Product(1.0, port.v, port.i)]}
