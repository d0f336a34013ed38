"""Channel whose range is too small."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity


@dataclass(frozen=True, kw_only=True)
class Clipping(Effect):
    """A channel ends at +-limit; absent at infinity."""

    name: ClassVar[str] = "clipping"
    source: ClassVar[str] = "Bendat & Piersol, Random Data, 2010, section 10.3"
    looks: ClassVar[str] = "the peaks of one channel are cut off flat, always at the same value"
    told_by: ClassVar[str] = "a record at a smaller amplitude, or with a larger range"

    limit: float = quantity("", "largest value, in the channel's SI unit", above=0, null=float("inf"))
    channel: Literal["force", "base_acceleration", "displacement", "voltage", "current"]

    def span(self, channel):
        return self.limit if channel == self.channel else float("inf")

    def shown(self, scene):
        lowest, highest = scene.ends[self.channel]
        return lowest <= self.limit <= highest

    @classmethod
    def starts(cls, scene):
        for channel in scene.channels:
            for limit in scene.peaks[channel]:
                yield cls(limit=limit, channel=channel)
