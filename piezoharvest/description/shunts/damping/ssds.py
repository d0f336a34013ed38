"""Synchronised switch damping on short circuit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.shunts.real_coil import WoundCoil
from piezoharvest.description.shunts.switching import EmptyingSwitch


@dataclass(frozen=True, kw_only=True)
class SSDS(EmptyingSwitch, WoundCoil):
    """At every extremum the electrodes are shorted for an instant: the voltage goes to zero, its energy is lost.

    With the `inductance` and `quality` of a real path the switch stays closed until that alone would have emptied the
    electrodes; the current that it then cuts is lost. Closed for half a swing instead, the same path is SSDI.
    """

    kind: ClassVar[str] = "ssds"
    source: ClassVar[str] = "Richard, Guyomar, Audigier & Ching, Proc. SPIE 3672, 104-111, 1999"

    def states(self, capacitance: float) -> tuple[State, ...]:
        return () if self.at_once else self.real_coil(capacitance).states()

    def configurations(self) -> tuple[str, ...]:
        return ("linear",) if self.at_once else ("open", "closed")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        if self.at_once:
            return [port.i]
        closed, coil = configuration == "closed", self.real_coil(port.capacitance)
        return [port.i - coil.current(closed, port.v, port, z), *coil.equations(closed, port.v, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        if self.at_once:
            return {}
        closed = configuration == "closed"
        return {"shunt_loss": self.real_coil(port.capacitance).losses(closed, port.v, port, z)}

    def closed(self, configuration: str, polarity: int) -> str:
        return configuration if self.at_once else "closed"

    def opened(self, configuration: str) -> str:
        return configuration if self.at_once else "open"
