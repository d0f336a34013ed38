"""Diodes that drop another voltage than their label says."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import AS_LABELLED, altered, quantity
from piezoharvest.description.protocol import CampaignSizes
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.harvesting.sece import SECE


@dataclass(frozen=True, kw_only=True)
class DiodeDropError(Effect):
    """Every diode drops `diode_drop` instead of what its label says; absent where the two are equal."""

    name: ClassVar[str] = "diode_drop_error"
    source: ClassVar[str] = "Sze & Ng, Physics of Semiconductor Devices, 2007, section 2.3"
    looks: ClassVar[str] = (
        "while the bridge conducts, the voltage is above that of the dc side by a constant, whatever the amplitude"
    )
    told_by: ClassVar[str] = "record the dc voltage beside that of the leads, or measure at two amplitudes"

    diode_drop: float = quantity("V", "forward drop of one diode", at_least=0, null=AS_LABELLED)

    def connect(self, shunt: Shunt) -> Shunt:
        return altered(shunt, diode_drop=self.diode_drop) if isinstance(shunt, Bridge | SECE) else shunt

    @classmethod
    def acts_on(cls, shunt: Shunt | None) -> bool:
        return isinstance(shunt, Bridge | SECE)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        for drop in dict.fromkeys(s.diode_drop for s in scales.shunts if isinstance(s, Bridge | SECE)):
            yield cls(diode_drop=drop)
