"""What start values of effects are taken from: the sizes and times of a campaign, and what its residuals show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.residual_tests import fundamental
from piezoharvest.identify.fitting.data import Data, pinned
from piezoharvest.identify.fitting.evaluation import at_once
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model, noise_passed, residual_blocks
from piezoharvest.identify.noise.noise_model import Noise

TIMES = 6  # time constants over the plausible range
_NEAR = np.concatenate([mains + np.arange(-15, 16) * 0.02 for mains in (50.0, 60.0)])  # Hz
PULLED = 0.01  # of the range of a force
BEYOND = (0.0, 2.0, 4.0)  # standard deviations below the largest reading, where a range may end,
HELD = 2.0  # up to these where readings are held there;
PASSED = 50.0  # squares above noise that have to go if there is one
SLOWEST = 3.0  # records: within one, so slow a relaxation is off a straight line by less than a sixth of its way
SPIKES = 2e-3  # of the samples, that something else than the signal may have taken beyond the end of a range
REACHED = 6.0  # standard deviations: no noise takes a reading so far beyond the end of a range


@dataclass(frozen=True)
class CampaignScales:
    """A campaign as its effects' start values see it; SI units.

    Attributes
    ----------
    drives, channels : tuple of str
    loaded : bool
        Whether a current into the electrodes shows: not where their voltage is imposed and no current is measured.
    pulled : bool
        Whether a force that is imposed ever pulls.
    displacement : float
        Half of its peak-to-peak; where it is not measured, that of a spring under the drive.
    jitter : float
        What the noise of the drive would be of it.
    capacitance : float
    sample_time : float
    times : tuple of float
        Time constants from a few samples to a record's length.
    loads : tuple of float
        Labels of the resistors.
    peaks : mapping of str to tuple of float
        For each channel where its range may end.
    mains : mapping of str to tuple of float
        For each channel, the drive among them, where near 50 and 60 Hz its residuals are strongest, Hz.
    longest : float
        Time that the longest record shows, s.
    ends : mapping of str to (float, float)
        For each channel between which values its range may end: it reads nothing far beyond it, and comes to it.
    harmonics : mapping of str to tuple of (float, float)
        For each channel, the drive among them, frequency of the drive in every record that has the channel (zero where
        that is not one line), and by how much frequencies have to differ there to be told apart; Hz.
    """

    drives: tuple[str, ...]
    channels: tuple[str, ...]
    loaded: bool
    pulled: bool
    displacement: float
    capacitance: float
    sample_time: float
    times: tuple[float, ...]
    loads: tuple[float, ...]
    peaks: Mapping[str, tuple[float, ...]]
    mains: Mapping[str, tuple[float, ...]]
    longest: float = float("inf")
    jitter: float = 0.0
    ends: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    harmonics: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)

    def shows_time(self, time_constant: float) -> bool:
        """Whether something so slow still bends within a record, and something so fast between its samples."""
        return self.sample_time < time_constant < SLOWEST * self.longest

    def tells_line(self, channel: str, frequency: float) -> bool:
        """Whether some record tells a line from harmonics of its drive, which any bent characteristic makes."""
        return any(
            not line or abs(frequency - round(frequency / line) * line) > apart
            for line, apart in self.harmonics.get(channel, ())
        )


class _Left(NamedTuple):
    """What a model leaves of a part of a record, and what of it the noise of the drive would do."""

    data: Data
    begin: int
    residual: np.ndarray
    passed: np.ndarray

    def measured(self, channel: str) -> np.ndarray:
        """Its samples of a channel."""
        return self.data.record[channel][self.begin : self.begin + len(self.residual)]


def scene_of(data: Sequence[Data | FrequencyData], found: Fit) -> CampaignScales:
    """Scene of the fitted records, as a model sees them."""
    records = [each for each in data if isinstance(each, Data)]
    channels = tuple(sorted({channel for each in records for channel in each.channels}))
    step = min((each.setting.sample_time for each in records), default=float("inf"))
    resistors = [each.setting.shunt for each in records if isinstance(each.setting.shunt, Resistor)]
    loads = sorted({shunt.resistance for shunt in resistors})
    bare = replace(found.model, parameters=())
    blocks = list(chain(*at_once(lambda each, own: _left(bare, each, own), data, found.own)))
    drives = {each.record.input if isinstance(each, FrequencyData) else each.drive for each in data}
    return CampaignScales(
        drives=tuple(sorted({each.drive for each in records})),
        channels=channels,
        loaded="current" in channels or drives != {"voltage"},
        pulled=any(each.drive == "force" and _pulled(each.record["force"]) for each in records),
        displacement=displacement_of(records, found.model.transducer),
        jitter=jitter_of(records, found.model.transducer, found.noise),
        capacitance=found.model.transducer.capacitance,
        sample_time=step,
        times=tuple(np.geomspace(*_span(data), TIMES).tolist()),
        loads=tuple(loads),
        peaks={channel: _ranges(blocks, found.noise.sigma[channel], channel) for channel in channels},
        mains=_mains(blocks),
        longest=max(
            (len(each) * each.setting.sample_time for each in records), default=_span(data)[1] if data else np.inf
        ),
        ends={channel: _ends(records, found.noise.sigma[channel], channel) for channel in channels},
        harmonics=_harmonics(records),
    )


def displacement_of(records: Sequence[Data], transducer: Transducer) -> float:
    """Half of the largest peak-to-peak displacement, measured or that of a spring under the drive."""
    moved = [
        float(np.ptp(each.record["displacement"]))
        if "displacement" in each.record.signals
        else _compliance(each, transducer) * float(np.ptp(each.record[each.drive]))
        for each in records
    ]
    return 0.5 * max(moved, default=np.inf)


def jitter_of(records: Sequence[Data], transducer: Transducer, noise: Noise) -> float:
    """Displacement that the noise of a drive would be, of that record where it is least."""
    return min((_compliance(each, transducer) * noise.sigma.get(each.drive, 0.0) for each in records), default=0.0)


def _compliance(data: Data, transducer: Transducer) -> float:
    """Displacement of a spring under a unit of the drive."""
    force = {
        "force": 1.0,
        "voltage": abs(transducer.coupling),
        "base_acceleration": abs(transducer.all_modes[0].base_mass),
        "displacement": transducer.stiffness,
    }
    return force[data.drive] / transducer.stiffness


def _ends(records: Sequence[Data], sigma: float, channel: str) -> tuple[float, float]:
    """Between which values the range of a channel may end."""
    sizes = np.sort(np.abs(np.concatenate([each.record[channel] for each in records if channel in each.channels])))
    return float(sizes[-1 - int(SPIKES * len(sizes))]) - REACHED * sigma, float(sizes[-1]) + REACHED * sigma


def _harmonics(records: Sequence[Data]) -> dict[str, tuple[tuple[float, float], ...]]:
    """Frequencies of the drives of records, and their resolutions, by channel."""
    found: dict[str, list[tuple[float, float]]] = {}
    for each in records:
        line = fundamental(each) or 0.0
        for channel in (*each.channels, each.drive):
            found.setdefault(channel, []).append((line, 1.0 / (len(each) * each.setting.sample_time)))
    return {channel: tuple(some) for channel, some in found.items()}


def _pulled(force: np.ndarray) -> bool:
    """Whether a force is tension at some time, by more than noise about zero would make it."""
    return bool(force.min() < -PULLED * np.ptp(force))


def _span(data: Sequence[Data | FrequencyData]) -> tuple[float, float]:
    """Shortest and longest time constant that records over time show, or responses where there are no such records."""
    records = [each for each in data if isinstance(each, Data)]
    if records:
        steps = [each.setting.sample_time for each in records]
        return 10.0 * min(steps), 0.5 * max(len(each) * step for each, step in zip(records, steps, strict=True))
    frequencies = np.concatenate([each.record.frequency for each in data if isinstance(each, FrequencyData)])
    frequencies = frequencies[frequencies > 0]
    return 0.5 / (np.pi * frequencies.max()), 0.5 / (np.pi * frequencies.min())


def _left(model: Model, data: Data | FrequencyData, own: np.ndarray) -> list[_Left]:
    """What a model leaves of a record."""
    if not isinstance(data, Data):
        return []
    return [
        _Left(data, begin, residual, noise_passed(prediction, data, begin, begin + len(residual)))
        for prediction, begin, residual, _ in residual_blocks(model, data, own, False)
    ]


def _ranges(blocks: Sequence[_Left], sigma: float, channel: str) -> tuple[float, ...]:
    """Where a channel may end: at an extreme value that it has many times, or that the model passes and it does not.

    Noise that comes after the range takes readings beyond it.
    """
    blocks = [block for block in blocks if channel in block.data.channels]
    together = np.concatenate([block.measured(channel) for block in blocks])
    limits = np.abs(together).max() - sigma * np.array(BEYOND)
    gains = np.zeros(len(limits))
    for block in blocks:
        c, measured = block.data.channels.index(channel), block.measured(channel)
        left, passed = block.residual[:, c], block.passed[:, c]
        cut = np.clip(measured - left, -limits[:, None], limits[:, None]) + passed
        gains += np.sum(((left - passed) ** 2 - (measured - cut) ** 2) / sigma**2, axis=1)
    return tuple(limits[(gains > PASSED) | (pinned(together) & (np.array(BEYOND) <= HELD))].tolist())


def _mains(blocks: Sequence[_Left]) -> dict[str, tuple[float, ...]]:
    """Mains frequencies of the channels: a network is seldom at its nominal one."""
    power: dict[str, np.ndarray] = {}
    for lines, (data, *_) in zip(at_once(_near_mains, blocks), blocks, strict=True):
        for c, channel in enumerate(data.channels):
            power[channel] = power.get(channel, 0.0) + np.abs(lines[:, c]) ** 2
        # What stands on the measured drive comes out in all channels.
        power[data.drive] = power.get(data.drive, 0.0) + (np.abs(lines) ** 2).sum(axis=1)
    half = len(_NEAR) // 2
    return {
        channel: (float(_NEAR[np.argmax(some[:half])]), float(_NEAR[half + np.argmax(some[half:])]))
        for channel, some in power.items()
    }


def _near_mains(block: _Left) -> np.ndarray:
    """Lines near the mains frequencies of what a model leaves, less the noise of the drive, (f, channels)."""
    left = block.residual - block.passed
    time = (block.begin + np.arange(len(left))) * block.data.setting.sample_time
    return np.exp(-2j * np.pi * _NEAR[:, None] * time) @ (left / left.std(axis=0))
