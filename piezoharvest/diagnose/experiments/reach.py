"""What planned records may be: the limits that a campaign states, and else those that its records show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from piezoharvest.description.shunts import Resistor, Shunt
from piezoharvest.identify.fitting.data import Data
from piezoharvest.records.campaign import Campaign

# Times the longest record: no converter limits how long a record may be, but somebody has to wait for it.
LONGER = 10.0
# Share of the drive's variance above the mean that lies below the highest frequency shown.
SHOWN_SHARE = 0.99
# Of the largest reading: what a planned record may reach beyond it, since the model of it is not perfect.
MARGIN = 1.05
DRIVES = {"force": False, "base_acceleration": True}  # that an excitation can be, and whether it drives the base


@dataclass(frozen=True, eq=False)
class Reach:
    """Limits of planned records.

    Attributes
    ----------
    drive : str
        The imposed channel.
    span : (float, float)
        Lowest and highest value of the drive.
    frequency : (float, float)
        Hz.
    duration, sample_rate : float
    shunts : tuple of Shunt
    channels : tuple of str
        Responses that are measured.
    largest : mapping of str to float
        Largest magnitude of each.
    """

    drive: str
    span: tuple[float, float]
    frequency: tuple[float, float]
    duration: float
    sample_rate: float
    shunts: tuple[Shunt, ...]
    channels: tuple[str, ...]
    largest: Mapping[str, float]


def reach_of(campaign: Campaign, records: Sequence[Data]) -> Reach | None:
    """Limits of a campaign; None where no record has a drive that an excitation can be.

    Parameters
    ----------
    campaign : Campaign
    records : sequence of Data
        Its records over time.
    """
    known = [data for data in records if data.drive in DRIVES and data.setting.shunt is not None]
    if not known:
        return None
    drive = known[0].drive
    known, limits = [data for data in known if data.drive == drive], campaign.limits
    span = limits.drive or (
        min(float(data.record[drive].min()) for data in known), max(float(data.record[drive].max()) for data in known),
    )  # fmt: skip
    duration = limits.duration or LONGER * max(data.record.duration for data in known)
    rate = limits.sample_rate or max(data.record.sample_rate for data in known)
    shown = max(highest_frequency(data.record[drive], data.setting.sample_time) for data in known)
    # Two periods show what a sine does; a twentieth of the sample rate is twenty samples in each.
    frequency = limits.frequency or (2.0 / duration, max(min(shown, rate / 20.0), 4.0 / duration))
    shunts = tuple(map(_resistor, limits.loads)) if limits.loads else _shunts(known)
    channels = tuple(dict.fromkeys(channel for data in known for channel in data.channels))
    seen = {
        channel: MARGIN * max(float(np.abs(data.record[channel]).max()) for data in known if channel in data.channels)
        for channel in channels
    }
    told = {c: value for c in channels if (value := getattr(limits, f"max_{c}", None)) is not None}
    return Reach(drive, span, frequency, duration, rate, shunts, channels, seen | told)


def _resistor(resistance: float) -> Shunt:
    return Resistor(resistance=resistance)


def _shunts(records: Sequence[Data]) -> tuple[Shunt, ...]:
    """Different shunts of the records."""
    found: list[Shunt] = []
    for data in records:
        if data.setting.shunt is not None and data.setting.shunt not in found:
            found.append(data.setting.shunt)
    return tuple(found)


def highest_frequency(values: np.ndarray, sample_time: float) -> float:
    """Frequency in Hz below which `SHOWN_SHARE` of a signal's variance lies."""
    window = np.hanning(len(values))
    power = np.abs(np.fft.rfft((values - values.mean()) * window)) ** 2
    total = np.cumsum(power)
    if not total[-1] > 0:
        return 0.0
    return float(np.searchsorted(total, SHOWN_SHARE * total[-1]) / (len(values) * sample_time))
