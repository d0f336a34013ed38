"""Electrical channels sampled later than mechanical ones."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes


@dataclass(frozen=True, kw_only=True)
class ChannelSkew(Effect):
    """Voltage and current are recorded late by `delay`; absent at zero."""

    name: ClassVar[str] = "channel_skew"
    of_specimen: ClassVar[bool] = False
    source: ClassVar[str] = "Doebelin, Measurement Systems, 2003, section 3.3"
    looks: ClassVar[str] = "voltage and current are late by the same time at every frequency"
    told_by: ClassVar[str] = (
        "record at higher frequency: a leakage or relaxation shifts the phase at low frequency, a delay at high "
        "frequency"
    )
    places: ClassVar[tuple[str, ...]] = ("reading.voltage", "reading.current")

    delay: float = quantity("s", "delay of voltage and current", at_least=0, null=0.0)

    def late(self, channel: str) -> float:
        return self.delay if channel in ("voltage", "current") else 0.0

    def shown(self, scales: CampaignSizes) -> bool:
        return self.delay < scales.longest

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        if {"voltage", "current"} & set(scales.channels):
            yield cls(delay=0.0)
