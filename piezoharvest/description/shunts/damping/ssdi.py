"""Synchronised switch damping on inductor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.shunts.real_coil import WoundSwitch


@dataclass(frozen=True, kw_only=True)
class SSDI(WoundSwitch):
    """Synchronised switch damping on an inductor: at every extremum a coil inverts the electrode voltage.

    Between the extrema the electrodes are open. The inverted voltage opposes the velocity, as dry friction does.
    """

    kind: ClassVar[str] = "ssdi"
    source: ClassVar[str] = "Richard, Guyomar, Audigier & Bassaler, Proc. SPIE 3989, 288-299, 2000"

    def states(self, capacitance: float) -> tuple[State, ...]:
        return self.real_coil(capacitance).states()

    def configurations(self) -> tuple[str, ...]:
        return ("open", "closed")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        closed, coil = configuration == "closed", self.real_coil(port.capacitance)
        return [port.i - coil.current(closed, port.v, port, z), *coil.equations(closed, port.v, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        return {"shunt_loss": self.real_coil(port.capacitance).losses(configuration == "closed", port.v, port, z)}

    def closed(self, configuration: str, polarity: int) -> str:
        return "closed"

    def opened(self, configuration: str) -> str:
        return "open"
