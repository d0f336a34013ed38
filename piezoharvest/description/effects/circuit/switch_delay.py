"""Switch that acts later than it is told."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import altered, quantity
from piezoharvest.description.protocol import CampaignSizes
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.switching import SynchronisedShunt


@dataclass(frozen=True, kw_only=True)
class SwitchDelay(Effect):
    """The switch acts later than nominal, by the delay of a comparator or gate driver; absent at zero."""

    name: ClassVar[str] = "switch_delay"
    source: ClassVar[str] = "Liang & Liao, IEEE Trans. Ind. Electron. 59(4), 1950-1960, 2012"
    looks: ClassVar[str] = (
        "the voltage is inverted after it has passed its extremum, by the same time at every frequency"
    )
    told_by: ClassVar[str] = (
        "record the gate signal, or measure at two frequencies: a lossy loop inverts less, but at the extremum itself"
    )

    time_lag: float = quantity("s", "delay in addition to the nominal one", at_least=0, null=0.0)

    def connect(self, shunt: Shunt) -> Shunt:
        if not isinstance(shunt, SynchronisedShunt):
            return shunt
        return altered(shunt, time_lag=shunt.time_lag + self.time_lag)

    @classmethod
    def acts_on(cls, shunt: Shunt | None) -> bool:
        return isinstance(shunt, SynchronisedShunt)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        yield cls(time_lag=0.0)
