"""Line at the mains frequency."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self, cast

from piezoharvest.description.effects.base import Channel, Effect
from piezoharvest.description.parameters import described, quantity
from piezoharvest.description.protocol import CampaignSizes

NETWORKS = (50.0, 60.0)  # Hz
TOLERANCE = 0.01  # relative deviation of a network's frequency from the nominal (EN 50160, section 4.1)


@dataclass(frozen=True, kw_only=True)
class MainsHum(Effect):
    """A line at the mains frequency on a channel, with a different phase in each record; absent at zero."""

    name: ClassVar[str] = "mains_hum"
    of_specimen: ClassVar[bool] = False
    source: ClassVar[str] = "Horowitz & Hill, The Art of Electronics, 2015, section 8.13"
    looks: ClassVar[str] = "a sharp line at 50 or 60 Hz in one channel, whatever the drive"
    told_by: ClassVar[str] = "make a record without drive"

    amplitude: float = quantity("", "peak value, in the channel's SI unit", at_least=0, null=0.0)
    frequency: float = quantity("Hz", "mains frequency", above=0)
    channel: Channel = described("channel that has the hum")

    @property
    def acts_at(self) -> tuple[str, ...]:
        return (f"reading.{self.channel}",)

    def line(self, channel: str) -> float | None:
        return self.frequency if channel == self.channel else None

    def shown(self, scales: CampaignSizes) -> bool:
        near = min(abs(self.frequency - mains) / mains for mains in NETWORKS)
        return near < TOLERANCE and scales.separates_line(self.channel, self.frequency)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        for channel in (*scales.channels, *scales.drives):
            for mains in scales.mains.get(channel, ()):
                if 1.0 / scales.longest < mains < 0.45 / scales.sample_time:
                    yield cls(amplitude=0.0, frequency=mains, channel=cast(Channel, channel))
