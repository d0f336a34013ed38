"""Start values of effects: scales of a campaign, and features of the residuals of a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy.signal import zoom_fft

from piezoharvest.description.effects.sensing.mains_hum import NETWORKS
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.shunts.switching import SynchronisedShunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.residual_structure.residual_tests import drive_frequency_of
from piezoharvest.diagnose.scanning.extrema import extrema_of, thresholds_between
from piezoharvest.identify.fitting.data import Data, is_clipped
from piezoharvest.identify.fitting.evaluation import map_records
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model, drive_noise_response, residual_blocks
from piezoharvest.identify.noise.noise_model import Noise

TIME_CONSTANTS = 6  # time constants over the plausible range
MAINS_DEVIATION = 0.3  # Hz: largest deviation of a network from 50 or 60 Hz at which its line is sought
MAINS_STEP = 0.2  # of the lines of the longest block: step of that search
LIMIT_OFFSETS = (0.0, 2.0, 4.0)  # standard deviations below the largest reading, where a saturation limit is tried


@dataclass(frozen=True)
class CampaignScales:
    """Scales of a campaign that start values of effects depend on; SI units.

    Attributes
    ----------
    drives, channels : tuple of str
    loaded : bool
        True if current into the electrodes is visible: the voltage is not imposed, or the current is measured.
    has_tension : bool
        True if an imposed force is ever tensile.
    displacement : float
        Half of its peak-to-peak range; where it is not measured, that of a spring under the drive.
    jitter : float
        Displacement equivalent to the noise of the drive.
    capacitance : float
    sample_time : float
    times : tuple of float
        Time constants from a few samples to a record's length.
    loads : tuple of float
        Resistances of the resistors, by which effects are labelled.
    peaks : mapping of str to tuple of float
        Candidate saturation limits of each channel.
    mains : mapping of str to tuple of float
        Frequencies near 50 and 60 Hz with the largest residual, for each channel and drive, Hz.
    longest : float
        Duration of the longest record, s.
    ends : mapping of str to (float, float)
        Lowest and highest possible saturation limit of each channel, from its largest readings.
    shunts : tuple of Shunt or None
        Circuits of the records by their labels, None under an imposed voltage.
    switching : tuple of float
        Voltages that part the extrema on which a switch acted from smaller ones on which it did not, V; none where it
        acted on all that are seen.
    harmonics : mapping of str to tuple of (float, float)
        For each channel and drive: drive frequency of every record with the channel (zero where the drive is not one
        sine), and the frequency resolution of the record; Hz.
    """

    drives: tuple[str, ...]
    channels: tuple[str, ...]
    loaded: bool
    has_tension: bool
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
    shunts: tuple[Shunt | None, ...] = ()
    switching: tuple[float, ...] = ()

    def resolves_time(self, time_constant: float) -> bool:
        """True if the records resolve a relaxation with this time constant: its curvature, and its samples."""
        return self.sample_time < time_constant < thresholds.MAX_TIME_CONSTANT * self.longest

    def separates_line(self, channel: str, frequency: float) -> bool:
        """True if some record separates a line from zero and the harmonics of its drive, which nonlinearity makes."""
        return any(
            abs(frequency - (round(frequency / line) * line if line else 0.0)) > apart
            for line, apart in self.harmonics.get(channel, ())
        )


class _BlockResidual(NamedTuple):
    """Residual of a block of a record, and the part of it that the drive's noise causes."""

    data: Data
    begin: int
    residual: np.ndarray
    drive_noise: np.ndarray

    def measured(self, channel: str) -> np.ndarray:
        """Samples of a channel in the block."""
        return self.data.record[channel][self.begin : self.begin + len(self.residual)]


def campaign_scales(data: Sequence[Data | FrequencyData], found: Fit) -> CampaignScales:
    """Scales of the fitted records under a model."""
    records = [each for each in data if isinstance(each, Data)]
    channels = tuple(sorted({channel for each in records for channel in each.channels}))
    step = min((each.setting.sample_time for each in records), default=float("inf"))
    resistors = [each.setting.shunt for each in records if isinstance(each.setting.shunt, Resistor)]
    loads = sorted({shunt.resistance for shunt in resistors})
    bare = replace(found.model, parameters=())
    blocks = list(
        chain(*map_records(lambda each, nuisance: _block_residuals(bare, each, nuisance), data, found.nuisance))
    )
    drives = {each.record.input if isinstance(each, FrequencyData) else each.drive for each in data}
    return CampaignScales(
        drives=tuple(sorted({each.drive for each in records})),
        channels=channels,
        loaded="current" in channels or drives != {"voltage"},
        has_tension=any(each.drive == "force" and _has_tension(each.record["force"]) for each in records),
        displacement=displacement_of(records, found.model.transducer),
        jitter=drive_jitter(records, found.model.transducer, found.noise),
        capacitance=found.model.transducer.capacitance,
        sample_time=step,
        times=tuple(np.geomspace(*_time_constant_range(data), TIME_CONSTANTS).tolist()),
        loads=tuple(loads),
        peaks={channel: _candidate_limits(blocks, found.noise, channel) for channel in channels},
        mains=_mains_frequencies(blocks),
        longest=max(
            (len(each) * each.setting.sample_time for each in records),
            default=_time_constant_range(data)[1] if data else np.inf,
        ),
        ends={channel: _range_of_limit(records, found.noise, channel) for channel in channels},
        harmonics=_drive_frequencies(records),
        shunts=tuple(each.setting.shunt for each in records),
        switching=tuple(thresholds_between(list(chain(*map(_switched_extrema, records))))),
    )


def _switched_extrema(data: Data) -> list[tuple[float, bool]]:
    """Extrema of the voltage behind a switch, and whether it acted on them."""
    seen = "voltage" in data.channels and isinstance(data.setting.shunt, SynchronisedShunt)
    return extrema_of(data.record["voltage"]) if seen else []


def displacement_of(records: Sequence[Data], transducer: Transducer) -> float:
    """Half of the largest peak-to-peak displacement, measured or that of a spring under the drive."""
    moved = [
        float(np.ptp(each.record["displacement"]))
        if "displacement" in each.record.signals
        else _compliance(each, transducer) * float(np.ptp(each.record[each.drive]))
        for each in records
    ]
    return 0.5 * max(moved, default=np.inf)


def drive_jitter(records: Sequence[Data], transducer: Transducer, noise: Noise) -> float:
    """Displacement equivalent to the noise of a drive, in the record where it is smallest."""
    sigmas = (noise.at(each.levels).sigma.get(each.drive, 0.0) for each in records)
    return min((_compliance(each, transducer) * s for each, s in zip(records, sigmas, strict=True)), default=0.0)


def _compliance(data: Data, transducer: Transducer) -> float:
    """Static displacement of the spring per unit of the drive."""
    force = {
        "force": 1.0,
        "voltage": abs(transducer.coupling),
        "base_acceleration": abs(transducer.all_modes[0].base_mass),
        "displacement": transducer.stiffness,
    }
    return force[data.drive] / transducer.stiffness


def _range_of_limit(records: Sequence[Data], noise: Noise, channel: str) -> tuple[float, float]:
    """Lowest and highest possible saturation limit of a channel."""
    those = [each for each in records if channel in each.channels]
    sizes = np.sort(np.abs(np.concatenate([each.record[channel] for each in those])))
    sigma = max(noise.at(each.levels).sigma[channel] for each in those)
    return float(sizes[-1 - int(thresholds.MAX_SPIKE_SHARE * len(sizes))]) - thresholds.NOISE_MARGIN * sigma, float(
        sizes[-1]
    ) + thresholds.NOISE_MARGIN * sigma


def _drive_frequencies(records: Sequence[Data]) -> dict[str, tuple[tuple[float, float], ...]]:
    """Drive frequencies and frequency resolutions of records, by channel."""
    found: dict[str, list[tuple[float, float]]] = {}
    for each in records:
        line = drive_frequency_of(each) or 0.0
        for channel in (*each.channels, each.drive):
            found.setdefault(channel, []).append((line, 1.0 / (len(each) * each.setting.sample_time)))
    return {channel: tuple(some) for channel, some in found.items()}


def _has_tension(force: np.ndarray) -> bool:
    """True if a force is tensile at some time by more than noise about zero."""
    return bool(force.min() < -thresholds.MIN_TENSION * np.ptp(force))


def _time_constant_range(data: Sequence[Data | FrequencyData]) -> tuple[float, float]:
    """Shortest and longest time constant shown by records over time, or by frequency responses without such records."""
    records = [each for each in data if isinstance(each, Data)]
    if records:
        steps = [each.setting.sample_time for each in records]
        return 10.0 * min(steps), 0.5 * max(len(each) * step for each, step in zip(records, steps, strict=True))
    frequencies = np.concatenate([each.record.frequency for each in data if isinstance(each, FrequencyData)])
    frequencies = frequencies[frequencies > 0]
    return 0.5 / (np.pi * frequencies.max()), 0.5 / (np.pi * frequencies.min())


def _block_residuals(model: Model, data: Data | FrequencyData, nuisance: np.ndarray) -> list[_BlockResidual]:
    """Residuals of a record, block by block."""
    if not isinstance(data, Data):
        return []
    return [
        _BlockResidual(data, begin, residual, drive_noise_response(prediction, data, begin, begin + len(residual)))
        for prediction, begin, residual, _ in residual_blocks(model, data, nuisance, False)
    ]


def _candidate_limits(blocks: Sequence[_BlockResidual], noise: Noise, channel: str) -> tuple[float, ...]:
    """Candidate saturation limits of a channel: extreme values that occur often, or that the model exceeds.

    Noise that is added after the saturation takes readings beyond the limit.
    """
    blocks = [block for block in blocks if channel in block.data.channels]
    together = np.concatenate([block.measured(channel) for block in blocks])
    sigmas = [noise.at(block.data.levels).sigma[channel] for block in blocks]
    limits = np.abs(together).max() - max(sigmas) * np.array(LIMIT_OFFSETS)
    gains = np.zeros(len(limits))
    for block, sigma in zip(blocks, sigmas, strict=True):
        c, measured = block.data.channels.index(channel), block.measured(channel)
        residual, drive_noise = block.residual[:, c], block.drive_noise[:, c]
        cut = np.clip(measured - residual, -limits[:, None], limits[:, None]) + drive_noise
        gains += np.sum(((residual - drive_noise) ** 2 - (measured - cut) ** 2) / sigma**2, axis=1)
    return tuple(
        limits[
            (gains > thresholds.MIN_LIMIT_GAIN)
            | (is_clipped(together) & (np.array(LIMIT_OFFSETS) <= thresholds.MAX_PINNED_OFFSET))
        ].tolist()
    )


def _mains_frequencies(blocks: Sequence[_BlockResidual]) -> dict[str, tuple[float, ...]]:
    """Mains frequencies of the channels, which differ slightly from the nominal ones."""
    power: dict[str, np.ndarray] = {}
    longest = max((len(block.residual) * block.data.setting.sample_time for block in blocks), default=np.inf)
    steps = max(round(MAINS_DEVIATION * longest / MAINS_STEP), 1) if blocks else 1
    for lines, (data, *_) in zip(map_records(partial(_lines_near_mains, steps), blocks), blocks, strict=True):
        for c, channel in enumerate(data.channels):
            power[channel] = power.get(channel, 0.0) + np.abs(lines[:, c]) ** 2
        # Hum on the measured drive appears in all channels.
        power[data.drive] = power.get(data.drive, 0.0) + (np.abs(lines) ** 2).sum(axis=1)
    return {
        channel: tuple(
            mains + MAINS_DEVIATION * float(np.argmax(part) - steps) / steps
            for mains, part in zip(NETWORKS, np.split(some, len(NETWORKS)), strict=True)
        )
        for channel, some in power.items()
    }


def _lines_near_mains(steps: int, block: _BlockResidual) -> np.ndarray:
    """Spectral lines of the residual less the drive's noise at so many steps to both sides of each network's frequency.

    Shape (networks * (2 steps + 1), channels).
    """
    residual, nyquist = block.residual - block.drive_noise, 0.5 / block.data.setting.sample_time
    residual /= residual.std(axis=0)
    ranges = ((np.array([-1.0, 1.0]) * MAINS_DEVIATION + mains) / nyquist for mains in NETWORKS)
    return np.concatenate([zoom_fft(residual, ends, 2 * steps + 1, endpoint=True, axis=0) for ends in ranges])
