"""Synchronised switch damping on short circuit."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Row
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.switching import SynchronisedShunt


@dataclass(frozen=True, kw_only=True)
class SSDS(SynchronisedShunt):
    """At every extremum the electrodes are shorted for an instant: the voltage goes to zero, its energy is lost.

    The short is instantaneous, so an error of the on-time changes nothing; the key is accepted for uniformity.
    """

    kind: ClassVar[str] = "ssds"
    source: ClassVar[str] = "Richard, Guyomar, Audigier & Ching, Proc. SPIE 3672, 104-111, 1999"

    on_time_error: float = quantity("", "accepted for uniformity: the short is instantaneous", default=0.0, above=-1)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [port.i]
