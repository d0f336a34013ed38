"""Diodes that conduct backwards."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import altered, quantity
from piezoharvest.description.protocol import CampaignSizes
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.bridge import Bridge


@dataclass(frozen=True, kw_only=True)
class ReverseLeakage(Effect):
    """Every diode of a bridge has a reverse `conductance` in addition to its nominal one; absent at zero.

    See `shunts.bridge.Bridge`: four such conductances are one across the leads and one across the dc side.
    """

    name: ClassVar[str] = "reverse_leakage"
    source: ClassVar[str] = "Sze & Ng, Physics of Semiconductor Devices, 2007, section 2.3"
    looks: ClassVar[str] = (
        "the dc side discharges faster than through its load alone, and the voltage decays between peaks"
    )
    told_by: ClassVar[str] = (
        "measure with the bridge removed: a leakage of the specimen remains; a probe loads one side only"
    )

    conductance: float = quantity("S", "reverse conductance of one diode", at_least=0, null=0.0)

    def connect(self, shunt: Shunt) -> Shunt:
        if not isinstance(shunt, Bridge):
            return shunt
        return altered(shunt, diode_leakage=shunt.diode_leakage + self.conductance)

    @classmethod
    def acts_on(cls, shunt: Shunt | None) -> bool:
        return isinstance(shunt, Bridge)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        yield cls(conductance=0.0)
