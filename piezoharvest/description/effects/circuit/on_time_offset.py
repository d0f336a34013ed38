"""Switch that stays closed for too long or too short."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Protocol, Self, runtime_checkable

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import altered, quantity
from piezoharvest.description.protocol import CampaignSizes
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.switching import EmptyingSwitch

TRIED = (-0.1, 0.1)  # start values: to second order the sign does not show


@runtime_checkable
class WithOnTime(Protocol):
    """Any circuit that closes its switch for a time of its own."""

    on_time_error: float


@dataclass(frozen=True, kw_only=True)
class OnTimeOffset(Effect):
    """The relative error of the time for which the switch is closed is larger by `on_time_error`; absent at zero."""

    name: ClassVar[str] = "on_time_offset"
    source: ClassVar[str] = "Lefeuvre, Badel, Richard, Petit & Guyomar, Sens. Actuators A 126(2), 405-416, 2006"
    looks: ClassVar[str] = (
        "the inversion ends before or after the voltage reaches its peak, as the switch is closed too short or too long"
    )
    told_by: ClassVar[str] = (
        "record the gate signal, or sample an inversion: a loop of low quality still ends at its peak, at the "
        "commanded time"
    )
    places: ClassVar[tuple[str, ...]] = ("switch_loop",)

    # A switch that opens on time cuts no current: to first order nothing changes.
    second_order: ClassVar[bool] = True

    on_time_error: float = quantity("", "relative error in addition to the nominal one", above=-1, null=0.0)

    def connect(self, shunt: Shunt) -> Shunt:
        if not isinstance(shunt, WithOnTime) or not self.acts_on(shunt):
            return shunt
        return altered(shunt, on_time_error=shunt.on_time_error + self.on_time_error)

    @classmethod
    def acts_on(cls, shunt: Shunt | None) -> bool:
        return isinstance(shunt, WithOnTime) and not (isinstance(shunt, EmptyingSwitch) and shunt.at_once)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        for error in TRIED:
            yield cls(on_time_error=error)
