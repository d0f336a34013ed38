"""Switched loop that is not as good as its label says."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import AS_LABELLED, altered, quantity
from piezoharvest.description.protocol import CampaignSizes
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.switching import EmptyingSwitch, SwitchedCoil


@dataclass(frozen=True, kw_only=True)
class InversionLoss(Effect):
    """The quality of the switched loop is `quality` instead of its nominal one; absent where the two are equal.

    An inversion of the voltage V leaves q V of the other sign, q = exp(-pi/(2 Q_i)). The switch stays closed for half a
    damped period of the actual loop; `on_time_offset` describes a wrong closing time.
    """

    name: ClassVar[str] = "inversion_loss"
    source: ClassVar[str] = "Guyomar, Badel, Lefeuvre & Richard, IEEE Trans. UFFC 52(4), 584-595, 2005"
    looks: ClassVar[str] = "every inversion leaves less voltage than expected, by the same fraction at every amplitude"
    told_by: ClassVar[str] = (
        "sample an inversion fast enough to resolve it: a voltage that falls back afterwards, or diodes that drop "
        "another voltage, do not change the inversion itself"
    )
    places: ClassVar[tuple[str, ...]] = ("switch_loop",)

    quality: float = quantity("", "quality of the switched loop, Q_i = sqrt(L/C)/R", above=0.5, null=AS_LABELLED)

    def connect(self, shunt: Shunt) -> Shunt:
        return altered(shunt, quality=self.quality) if self.acts_on(shunt) else shunt

    @classmethod
    def acts_on(cls, shunt: Shunt | None) -> bool:
        return isinstance(shunt, SwitchedCoil) or (isinstance(shunt, EmptyingSwitch) and not shunt.at_once)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        labels = (s.quality for s in scales.shunts if isinstance(s, SwitchedCoil | EmptyingSwitch))
        for quality in dict.fromkeys(label for label in labels if label is not None):
            yield cls(quality=quality)
