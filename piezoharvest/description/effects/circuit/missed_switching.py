"""Switch that does not act at small voltages."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import altered, quantity
from piezoharvest.description.protocol import CampaignSizes
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.switching import SynchronisedShunt


@dataclass(frozen=True, kw_only=True)
class MissedSwitching(Effect):
    """The peak detector does not act at an extremum at which |v_p| is below `threshold`; absent at zero.

    The voltage counts, not the displacement, as a detector sees only the voltage. A larger nominal threshold prevails.
    """

    name: ClassVar[str] = "missed_switching"
    source: ClassVar[str] = "Lallart & Guyomar, Smart Mater. Struct. 17(3), 035030, 2008"
    looks: ClassVar[str] = "no inversion takes place at extrema where the voltage is small"
    told_by: ClassVar[str] = "record the gate signal, or raise the amplitude until the switch acts at every extremum"

    scanned: ClassVar[bool] = True

    threshold: float = quantity("V", "electrode voltage below which the switch does not act", at_least=0, null=0.0)

    def connect(self, shunt: Shunt) -> Shunt:
        if not isinstance(shunt, SynchronisedShunt):
            return shunt
        larger = np.real(self.threshold) > np.real(shunt.detector_threshold)
        return altered(shunt, detector_threshold=np.where(larger, self.threshold, shunt.detector_threshold)[()])

    @classmethod
    def acts_on(cls, shunt: Shunt | None) -> bool:
        return isinstance(shunt, SynchronisedShunt)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        for voltage in scales.switching:
            yield cls(threshold=voltage)
