"""Synchronous electric charge extraction."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Row
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.switching import SynchronisedShunt


@dataclass(frozen=True, kw_only=True)
class SECE(SynchronisedShunt):
    """At every extremum the charge is extracted at once: voltage to zero, a share of the energy to the load."""

    kind: ClassVar[str] = "sece"
    source: ClassVar[str] = "Lefeuvre, Badel, Richard & Guyomar, J. Intell. Mater. Syst. Struct. 16(10), 865-876, 2005"

    efficiency: float = quantity("", "share that reaches the load", default=1.0, at_least=0, at_most=1)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [port.i]

    def harvested_share(self) -> float:
        return self.efficiency
