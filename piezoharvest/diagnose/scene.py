"""What start values of effects are taken from: the sizes and times of a campaign, and what its residuals show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from piezoharvest.identify.data import EQUAL, PLATEAU, Data
from piezoharvest.identify.descent import Fit
from piezoharvest.identify.model import noise_passed, residual_blocks, unexplained_blocks
from piezoharvest.identify.responses import FrequencyData
from piezoharvest.shunts.resistor import Resistor

TIMES = 6  # time constants over the plausible range
_NEAR = np.concatenate([mains + np.arange(-15, 16) * 0.02 for mains in (50.0, 60.0)])  # Hz
PULLED = 0.01  # of the range of a force
BEYOND = (0.0, 2.0, 4.0)  # standard deviations below the largest reading, where a range may end,
HELD = 2.0  # up to these where readings are held there;
PASSED = 50.0  # squares above noise that have to go if there is one


@dataclass(frozen=True)
class Scene:
    """A campaign as its effects' start values see it; SI units.

    Attributes
    ----------
    drives, channels : tuple of str
    loaded : bool
        Whether a current into the electrodes shows: not where their voltage is imposed and no current is measured.
    pulled : bool
        Whether a force that is imposed ever pulls.
    displacement : float
        Half of its peak-to-peak.
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


def scene_of(data: Sequence[Data | FrequencyData], found: Fit) -> Scene:
    """Scene of the fitted records."""
    records = [each for each in data if isinstance(each, Data)]
    channels = tuple(sorted({channel for each in records for channel in each.channels}))
    displacements = [each.record["displacement"] for each in records if "displacement" in each.record.signals]
    step = min((each.setting.sample_time for each in records), default=float("inf"))
    resistors = [each.setting.shunt for each in records if isinstance(each.setting.shunt, Resistor)]
    loads = sorted({shunt.resistance for shunt in resistors})
    drives = {each.record.input if isinstance(each, FrequencyData) else each.drive for each in data}
    return Scene(
        drives=tuple(sorted({each.drive for each in records})),
        channels=channels,
        loaded="current" in channels or drives != {"voltage"},
        pulled=any(each.drive == "force" and _pulled(each.record["force"]) for each in records),
        displacement=0.5 * max((float(np.ptp(values)) for values in displacements), default=1e-6),
        capacitance=found.model.transducer.capacitance,
        sample_time=step,
        times=tuple(np.geomspace(*_span(data), TIMES).tolist()),
        loads=tuple(loads),
        peaks={channel: _ranges(records, found, data, channel) for channel in channels},
        mains=_mains(data, found),
    )


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


def _ranges(records: Sequence[Data], found: Fit, data: Sequence, channel: str) -> tuple[float, ...]:
    """Where a channel may end: at an extreme value that it has many times, or that the model passes and it does not.

    Noise that comes after the range takes readings beyond it.
    """
    largest = max(float(np.abs(each.record[channel]).max()) for each in records if channel in each.channels)
    sigma = found.noise.sigma[channel]
    limits = np.array([largest - k * sigma for k in BEYOND])
    equal, gains = 0, np.zeros(len(limits))
    for each, own in zip(data, found.own, strict=True):
        if not isinstance(each, Data) or channel not in each.channels:
            continue
        values = each.record[channel]
        equal += int(np.sum(np.abs(values) >= (1.0 - EQUAL) * largest))
        c = each.channels.index(channel)
        for prediction, begin, residual, _ in residual_blocks(_bare(found), each, own, False):
            measured, left = values[begin : begin + len(residual)], residual[:, c]
            passed = noise_passed(prediction, each, begin, begin + len(residual))[:, c]
            cut = np.clip(measured - left, -limits[:, None], limits[:, None]) + passed
            gains += np.sum(((left - passed) ** 2 - (measured - cut) ** 2) / sigma**2, axis=1)
    return tuple(limits[(gains > PASSED) | ((equal >= PLATEAU) & (np.array(BEYOND) <= HELD))].tolist())


def _mains(data: Sequence, found: Fit) -> dict[str, tuple[float, ...]]:
    """Mains frequencies of the channels: a network is seldom at its nominal one."""
    power: dict[str, np.ndarray] = {}
    for each, own in zip(data, found.own, strict=True):
        if not isinstance(each, Data):
            continue
        for _, begin, residual in unexplained_blocks(found.model, each, own):
            time = (begin + np.arange(len(residual))) * each.setting.sample_time
            lines = np.exp(-2j * np.pi * _NEAR[:, None] * time) @ (residual / residual.std(axis=0))
            for c, channel in enumerate(each.channels):
                power[channel] = power.get(channel, 0.0) + np.abs(lines[:, c]) ** 2
            # What stands on the measured drive comes out in all channels.
            power[each.drive] = power.get(each.drive, 0.0) + (np.abs(lines) ** 2).sum(axis=1)
    half = len(_NEAR) // 2
    return {
        channel: (float(_NEAR[np.argmax(some[:half])]), float(_NEAR[half + np.argmax(some[half:])]))
        for channel, some in power.items()
    }


def _bare(found: Fit):
    from dataclasses import replace

    return replace(found.model, parameters=())
