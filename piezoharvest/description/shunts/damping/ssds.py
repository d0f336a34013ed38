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
    """Synchronised switch damping on a short circuit: at every extremum the electrodes are discharged.

    Without an `inductance` this happens instantly, and the energy is lost. With the `inductance` and `quality` of a
    real discharge path, the switch stays closed until that path alone would have emptied the electrodes; the current
    that then still flows is cut off and its energy lost. If the switch stayed closed for half a period of the loop, the
    circuit would be SSDI.
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
