"""Records prepared for a fit: samples, settings of the prediction, and known noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import comb
from types import MappingProxyType
from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.spice_circuit import SpiceCircuit
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.circuit_start import circuit_start, loop_closed_at_first
from piezoharvest.identify.noise.drive_denoising import denoised
from piezoharvest.identify.noise.noise_model import initial_noise
from piezoharvest.identify.noise.proportional_noise import relative_variance
from piezoharvest.predict.circuit.setting import begins_anywhere, circuit_setting, periodic_setting
from piezoharvest.predict.discrete_model import Setting, setting_of
from piezoharvest.predict.drive import MIN_JUMP_RATIO
from piezoharvest.predict.step_counts import with_steps
from piezoharvest.records.checks.unused import unused
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.finding import shifted
from piezoharvest.records.record import Record, Signal

MAX_TIME_JITTER = 1e-2  # of the sample time: largest deviation of time stamps from a uniform grid
# Extreme samples that are equal, within this relative tolerance, at the end of a range.
MIN_CLIPPED_SAMPLES = 4
EQUALITY_TOLERANCE = 1e-9
COMPARED_STEPS = 4  # steps between samples with which the first one is compared
RESPONSES = (
    "displacement", "velocity", "acceleration", "voltage", "current", "force", "dc_voltage", "dc_current",
)  # fmt: skip

_CLEAN_DRIVES: WeakKeyDictionary[Signal, np.ndarray] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Data:
    """One record prepared for a fit.

    Attributes
    ----------
    name, role : str
    record : Record
    setting : Setting
        With the drive without its noise.
    rest : (samples,) array
        The rest of the measured drive.
    channels : tuple of str
        Responses that a model predicts.
    sigma : mapping of str to float
        Known standard deviations.
    scatter : mapping of str to float
        Standard deviations of the noise before a sensor's range clips it, in the order of `channels`; zero if no range
        clips the noise.
    start : mapping of str to float
        Start values of nuisance parameters that do not start at zero, by name.
    hidden : (samples,) array of bool, optional
        Samples behind a circuit that a fit leaves out.
    levels : mapping of str to float
        Noise of the channels and of the drive relative to that of the campaign; 1 for those that are missing.
    variance : (samples, channels) array, optional
        Of the noise in each sample over its mean, where noise grows with the reading.
    """

    name: str
    role: str
    record: Record
    setting: Setting
    rest: np.ndarray
    channels: tuple[str, ...]
    sigma: Mapping[str, float]
    scatter: Mapping[str, float]
    start: Mapping[str, float] = field(default_factory=dict)
    hidden: np.ndarray | None = None
    levels: Mapping[str, float] = field(default_factory=dict)
    variance: np.ndarray | None = None

    @property
    def drive(self) -> str:
        """The imposed channel."""
        return self.setting.drive

    def level(self, channel: str) -> float:
        """Noise of a channel, or of the drive, relative to that of the campaign."""
        return self.levels.get(channel, 1.0)

    @cached_property
    def values(self) -> np.ndarray:
        """Measured responses, (samples, channels), read-only, because results computed from them are cached."""
        values = np.column_stack([self.record[channel] for channel in self.channels])
        values.flags.writeable = False
        return values

    def part(self, begin: int, end: int) -> np.ndarray:
        """Measured responses of some samples, without a second copy of a long record in memory."""
        if "values" in self.__dict__:
            return self.values[begin:end]
        return np.column_stack([self.record[channel][begin:end] for channel in self.channels])

    def __len__(self) -> int:
        return self.setting.count


def data_of(record: Record, transducer: Transducer, levels: Mapping[str, float] = MappingProxyType({})) -> Data:
    """Prepare a record, with its sizes, when it was made and the levels of its noise.

    Raises
    ------
    CampaignError
        The samples are not uniform in time, or there are no responses.
    """
    data = _prepared(record, transducer)
    data = replace(data, levels=levels, variance=_variance_of(data))
    size = data.setting.size
    if size is None:
        return data
    signal = record.signals.get("displacement")
    moved = np.nan if signal is None else float(np.sqrt(2.0) * np.std(record["displacement"]))
    known = size._replace(displacement_amplitude=moved, begin=record.start_time)
    return replace(data, setting=replace(data.setting, size=known))


def _prepared(record: Record, transducer: Transducer) -> Data:
    """Prepare a record.

    Raises
    ------
    CampaignError
        The samples are not uniform in time, or there are no responses.
    """
    time = record["time"]
    step = record.duration / (len(record) - 1)
    off = np.abs(time - time[0] - step * np.arange(len(time)))
    if off.max() > MAX_TIME_JITTER * step:
        worst = int(np.argmax(off))
        message = (
            f"found a time stamp {off.max() / step:.2g} samples off even spacing, allowed are evenly spaced samples"
        )
        rows = shifted([(worst, worst)], record.time.first_row)
        raise CampaignError(record.time.file, "", message, channel="time", rows=rows)
    left_out = {finding.channel for finding in unused(record)} | _silent(record)
    channels = tuple(c for c in RESPONSES if c in record.signals and c != record.drive and c not in left_out)
    if not channels:
        silent = " and responses that never change" if _silent(record) else ""
        raise CampaignError(
            record.name, record.key, f"the record contains only its drive{silent}, at least one response is needed"
        )
    check_channels(record)
    sigma = {c: s.sigma for c, s in record.signals.items() if s.sigma is not None}
    drive = record[record.drive]
    clean = drive if record.periodic else clean_drive(record.signals[record.drive])
    noise = {c: sigma.get(c, unclipped_noise(record[c])) for c in channels}
    scatter = {c: noise[c] if is_clipped(record[c]) else 0.0 for c in channels}
    shunt = record.shunt
    if record.harmonics is not None:
        settled = periodic_setting(record.drive, shunt, step, len(record), record.harmonics, transducer)
        rest = drive - record.harmonics.at(step * np.arange(len(record)))
        return Data(record.name, record.role, record, settled, rest, channels, sigma, scatter)
    if begins_anywhere(shunt, record.drive):
        moved = _range_of(record, "displacement")
        behind = circuit_setting(record.drive, shunt, step, clean, transducer, moved, record.gate)
        behind = replace(behind, reach=_reach(record, clean, transducer))
        first = loop_closed_at_first(record, shunt, transducer)
        start = circuit_start(record, behind, shunt, transducer, first)
        behind = replace(behind, acted=first * step if start else 0.0)
        hidden = np.arange(len(record)) < first if first and start else None
        return Data(record.name, record.role, record, behind, drive - clean, channels, sigma, scatter, start, hidden)
    abrupt = any(begins_abruptly(record[c], noise[c]) for c in channels) and not begins_abruptly(clean, 0.0, (1,))
    setting = setting_of(record.drive, record.shunt, step, clean, transducer, abrupt=abrupt)
    setting = with_steps(setting, [(record[c], noise[c]) for c in channels])
    setting = replace(setting, reach=_reach(record, clean, transducer))
    return Data(record.name, record.role, record, setting, drive - clean, channels, sigma, scatter)


def _silent(record: Record) -> set[str]:
    """Responses with one value throughout, as the exact zero of a current behind open electrodes.

    They show no noise by which they could be weighed; where it is stated, they are no such ones.
    """
    return {c for c in record.responses if record.signals[c].sigma is None and np.ptp(record[c]) == 0.0}


def _variance_of(data: Data) -> np.ndarray | None:
    """`Data.variance`; None where no noise grows with the reading."""
    every = [None if channel in data.sigma else relative_variance(data.record, channel) for channel in data.channels]
    if all(each is None for each in every):
        return None
    return np.column_stack([np.ones(len(data)) if each is None else each for each in every])


def check_channels(record: Record) -> None:
    """Raise an error if a channel is one that the record's circuit has not.

    Raises
    ------
    CampaignError
    """
    side = ("dc_voltage", "dc_current")
    for channel in side:
        if channel not in record.signals:
            continue
        shunt, signal = record.shunt, record.signals[channel]
        kind = "no circuit" if shunt is None else shunt.kind
        imported = isinstance(shunt, SpiceCircuit) and channel == "dc_voltage" and shunt.dc_capacitor is not None
        if not (isinstance(shunt, Bridge) or imported):
            message = f"found a channel {channel} behind {kind}, allowed behind a rectifier or an SSHI circuit"
            raise CampaignError(signal.file, channel, message, channel=channel)
        if isinstance(shunt, Bridge) and channel == "dc_current" and shunt.load_resistance is None:
            message = "found a channel dc_current at a constant dc_voltage, it must be that through a load_resistance"
            raise CampaignError(signal.file, channel, message, channel=channel)


def _range_of(record: Record, channel: str) -> float:
    """Half of the range of a channel; 0 if it was not measured."""
    return 0.5 * float(np.ptp(record[channel])) if channel in record.signals else 0.0


def _reach(record: Record, drive: np.ndarray, transducer: Transducer) -> float:
    """`Setting.reach`: of the whole ranges, as a record may begin at one end of what came before."""
    moved, voltage = (2.0 * _range_of(record, channel) for channel in ("displacement", "voltage"))
    k, pushed = transducer.stiffness, float(np.ptp(drive))
    driven = {
        "force": pushed**2 / k,
        "base_acceleration": (transducer.all_modes[0].base_mass * pushed) ** 2 / k,
        "displacement": k * pushed**2,
        "voltage": transducer.capacitance * pushed**2,
    }
    return float(np.sqrt(max(k * moved**2, transducer.capacitance * voltage**2, driven[record.drive])))


def clean_drive(signal: Signal) -> np.ndarray:
    """Drive without its noise, (n,), cached for campaigns whose records change their roles."""
    if signal not in _CLEAN_DRIVES:
        sigma = initial_noise(signal.values) if signal.sigma is None else signal.sigma
        _CLEAN_DRIVES[signal] = denoised(signal.values, sigma)
    return _CLEAN_DRIVES[signal]


def is_clipped(values: np.ndarray) -> bool:
    """True if many extreme samples are equal, as at the end of a converter's range, and more than next to them.

    In rounded noise, fewer samples are at the extreme than next to it.
    """
    sizes = np.abs(values)
    inside = sizes < (1.0 - EQUALITY_TOLERANCE) * sizes.max()
    equal = len(sizes) - np.count_nonzero(inside)
    beside = np.count_nonzero(sizes >= (1.0 - EQUALITY_TOLERANCE) * sizes.max(initial=0.0, where=inside)) - equal
    return bool(equal >= MIN_CLIPPED_SAMPLES and equal > beside)


def unclipped_noise(values: np.ndarray) -> float:
    """Standard deviation of the noise of a channel, without the samples at the end of its range, which have none."""
    ends = np.abs(values) == np.abs(values).max()
    if len(ends) < 5:
        return initial_noise(values)
    inside = np.flatnonzero(np.lib.stride_tricks.sliding_window_view(ends, 5).sum(axis=1) == 0)
    return initial_noise(values, inside if len(inside) else slice(None))


def begins_abruptly(values: np.ndarray, sigma: float, orders: Sequence[int] = (1, 3)) -> bool:
    """True if the first sample is in another state than those after it: the drive started suddenly.

    Its differences are then large: of the first order if the record is slow, of the third if it is fast.
    """
    for order in orders:
        found = np.abs(np.diff(values[: COMPARED_STEPS + 1 + order], order))
        if len(found) > COMPARED_STEPS and found[0] > MIN_JUMP_RATIO * max(
            found[1:].max(), np.sqrt(comb(2 * order, order)) * sigma
        ):
            return True
    return False
