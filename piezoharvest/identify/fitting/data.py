"""Records as a fit takes them: samples, settings of the prediction, and what is known of their noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb
from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.noise.drive_denoising import denoised
from piezoharvest.identify.noise.noise_model import first_guess
from piezoharvest.predict.discrete_model import SOON, Setting, setting_of
from piezoharvest.predict.drive import CALM
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.finding import shifted
from piezoharvest.records.record import Record, Signal

JITTER = 1e-2  # of the sample time, that stamps may be off a uniform grid
FAINT = 5e-5  # of how far a response moves: less noise does not ask for more
STRAIGHT = 1.0  # times the noise: error of what runs straight within a step of a model with elements
FINEST = 16  # such steps in a sample
SCATTERED = 1.2  # times the noise: bends that are no larger are none
PLATEAU, EQUAL = 4, 1e-9  # extreme samples that are equal, but for so much of them, at the end of a range
BESIDE = 4  # steps between samples, beside which the first one stands out
RESPONSES = ("displacement", "voltage", "current", "force")

_CLEAN: WeakKeyDictionary[Signal, np.ndarray] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Data:
    """One record.

    Attributes
    ----------
    name, role : str
    record : Record
    setting : Setting
        Driven by what stands out of the drive's noise.
    rest : (samples,) array
        What is left of the measured drive.
    channels : tuple of str
        Responses that a model predicts.
    sigma : mapping of str to float
        Known standard deviations.
    scatter : mapping of str to float
        Standard deviations of what scatters the responses before they come to the end of a range, in the order of
        `channels`: none where no range cuts the noise off, too, for then a sensor's range ends before its noise.
    """

    name: str
    role: str
    record: Record
    setting: Setting
    rest: np.ndarray
    channels: tuple[str, ...]
    sigma: Mapping[str, float]
    scatter: Mapping[str, float]

    @property
    def drive(self) -> str:
        """The imposed channel."""
        return self.setting.drive

    @cached_property
    def values(self) -> np.ndarray:
        """Measured responses, (samples, channels), which nobody may write to: what was made of them is kept."""
        values = np.column_stack([self.record[channel] for channel in self.channels])
        values.flags.writeable = False
        return values

    def part(self, begin: int, end: int) -> np.ndarray:
        """Measured responses of some samples: a fit needs no second copy of a long record in memory."""
        if "values" in self.__dict__:
            return self.values[begin:end]
        return np.column_stack([self.record[channel][begin:end] for channel in self.channels])

    def __len__(self) -> int:
        return self.setting.count


def data_of(record: Record, transducer: Transducer) -> Data:
    """Prepare a record.

    Raises
    ------
    CampaignError
        The samples are not uniform in time, or there are no responses.
    """
    time = record["time"]
    step = record.duration / (len(record) - 1)
    off = np.abs(time - time[0] - step * np.arange(len(time)))
    if off.max() > JITTER * step:
        worst = int(np.argmax(off))
        message = f"found a time stamp {off.max() / step:.2g} samples off a uniform grid, allowed are uniform samples"
        rows = shifted([(worst, worst)], record.time.first_row)
        raise CampaignError(record.time.file, "", message, channel="time", rows=rows)
    channels = tuple(channel for channel in RESPONSES if channel in record.signals and channel != record.drive)
    if not channels:
        raise CampaignError(record.name, record.key, "found the drive alone, allowed is a record with a response")
    sigma = {c: s.sigma for c, s in record.signals.items() if s.sigma is not None}
    drive, clean = record[record.drive], clean_drive(record.signals[record.drive])
    noise = {c: sigma.get(c, scatter_of(record[c])) for c in channels}
    abrupt = any(begins_abruptly(record[c], noise[c]) for c in channels) and not begins_abruptly(clean, 0.0, (1,))
    setting = setting_of(record.drive, record.shunt, step, clean, transducer, abrupt=abrupt)
    bends = (bend_of(record[c], noise[c], setting.jumps) for c in channels)
    fine = int(np.clip(np.ceil(np.sqrt(max(bends) / (12.0 * STRAIGHT))), 1, FINEST))
    setting = replace(setting, fine=fine)
    scatter = {c: noise[c] if pinned(record[c]) else 0.0 for c in channels}
    return Data(record.name, record.role, record, setting, drive - clean, channels, sigma, scatter)


def clean_drive(signal: Signal) -> np.ndarray:
    """Drive without its noise, (n,), which a campaign whose records change their roles asks for again and again."""
    if signal not in _CLEAN:
        sigma = first_guess(signal.values) if signal.sigma is None else signal.sigma
        _CLEAN[signal] = denoised(signal.values, sigma)
    return _CLEAN[signal]


def pinned(values: np.ndarray) -> bool:
    """Whether extreme samples are equal, as at the end of a converter's range, and more than are next to these.

    Of noise that is rounded fewer are the most extreme.
    """
    sizes = np.abs(values)
    inside = sizes < (1.0 - EQUAL) * sizes.max()
    equal = len(sizes) - np.count_nonzero(inside)
    beside = np.count_nonzero(sizes >= (1.0 - EQUAL) * sizes.max(initial=0.0, where=inside)) - equal
    return bool(equal >= PLATEAU and equal > beside)


def scatter_of(values: np.ndarray) -> float:
    """Standard deviation of the noise of a channel before it comes to the end of its range, where it has none."""
    ends = np.abs(values) == np.abs(values).max()
    if len(ends) < 5:
        return first_guess(values)
    inside = np.flatnonzero(np.lib.stride_tricks.sliding_window_view(ends, 5).sum(axis=1) == 0)
    return first_guess(values, inside if len(inside) else slice(None))


def bend_of(values: np.ndarray, sigma: float, jumps: np.ndarray) -> float:
    """How far a response bends between samples, in units of its noise: (w h)^2 times as far as a sine moves.

    What is all but free of noise is only asked to be right to a small part of how far it moves.

    A twelfth of it is the error of what is taken to run straight from sample to sample.
    """
    bends = np.diff(values, 2)
    beside = jumps[:, None] + np.arange(-2, SOON)  # these steps are small ones anyway
    bends[beside[(beside >= 0) & (beside < len(bends))]] = 0.0
    above = np.mean(bends**2) - SCATTERED * 6.0 * sigma**2 if len(bends) else 0.0
    return float(np.sqrt(above) / max(sigma, FAINT * values.std())) if above > 0.0 else 0.0


def begins_abruptly(values: np.ndarray, sigma: float, orders: Sequence[int] = (1, 3)) -> bool:
    """Whether the first sample is of another state than those after it: the drive came upon a specimen at rest.

    Its differences of some order stand out then: of the first where the record is slow, of the third where it is fast.
    """
    for order in orders:
        found = np.abs(np.diff(values[: BESIDE + 1 + order], order))
        if len(found) > BESIDE and found[0] > CALM * max(found[1:].max(), np.sqrt(comb(2 * order, order)) * sigma):
            return True
    return False
