"""Channel whose range is too small."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self, cast

from piezoharvest.description.effects.base import Channel, Effect
from piezoharvest.description.parameters import described, quantity
from piezoharvest.description.protocol import CampaignSizes


@dataclass(frozen=True, kw_only=True)
class Clipping(Effect):
    """A channel is clipped at +-limit; absent at infinity."""

    name: ClassVar[str] = "clipping"
    of_specimen: ClassVar[bool] = False
    source: ClassVar[str] = "Bendat & Piersol, Random Data, 2010, section 10.3"
    looks: ClassVar[str] = "the peaks of one channel are cut off flat, always at the same value"
    told_by: ClassVar[str] = "record at a smaller amplitude, or with a larger range"

    limit: float = quantity("", "largest value, in the channel's SI unit", above=0, null=float("inf"))
    channel: Channel = described("channel that is clipped")

    @property
    def acts_at(self) -> tuple[str, ...]:
        return (f"reading.{self.channel}",)

    def span(self, channel: str) -> float:
        return self.limit if channel == self.channel else float("inf")

    def shown(self, scales: CampaignSizes) -> bool:
        lowest, highest = scales.ends[self.channel]
        return lowest <= self.limit <= highest

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        for channel in scales.channels:
            for limit in scales.peaks[channel]:
                yield cls(limit=limit, channel=cast(Channel, channel))
