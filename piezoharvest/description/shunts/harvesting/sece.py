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
    """At every extremum the charge is extracted at once: voltage to zero, a share of the energy to the load.

    With `diode_drop` V_d the charge passes two conducting diodes of the bridge before the flyback converter: of
    the energy that leaves the electrodes, C V^2/2 from a voltage V, they take 2 V_d C V, and `efficiency` is the share
    of the rest. The switch opens when the electrodes are empty, as without drops. Below V = 4 V_d, where the drops
    would take more than there is, the charge is taken all the same and nothing is harvested.

    The circuit is that of the source; the constant drop is that of the other bridges.
    """

    kind: ClassVar[str] = "sece"
    source: ClassVar[str] = "Lefeuvre, Badel, Richard & Guyomar, J. Intell. Mater. Syst. Struct. 16(10), 865-876, 2005"

    efficiency: float = quantity("", "share that reaches the load", default=1.0, at_least=0, at_most=1)
    diode_drop: float = quantity("V", "forward drop of one diode", default=0.0, at_least=0)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [port.i]

    def harvested_share(self) -> float:
        return self.efficiency

    def extraction_drop(self) -> float:
        return 2.0 * self.diode_drop
