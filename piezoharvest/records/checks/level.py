"""What a channel can resolve, and how large its noise is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import erf

from piezoharvest.records.finding import runs

_SHORTEST = 3  # equal samples that count as a run
_LONG = 8  # equal samples at an end of the range that say nothing of the noise
_NOISE_SAMPLES = 1 << 20  # that tell the noise
_GAIN_OF_FOURTH_DIFFERENCES = 70.0  # for the variance of white noise
_FEW = 16  # values that a channel takes
_TRIMMED = 0.95  # share of the differences that noise is taken from: the rest may be corners
_TRIMMED_VARIANCE = 0.759  # of normal noise without the largest 5 %
_BEYOND = 0.6  # steps of a converter, whose rounding is noise of 0.29
_MOVING = 0.3  # least share of samples outside runs
_EQUAL = 0.5  # share of equal neighbours among these
_ALIKE = 0.9  # likeliest that the next sample is equal
_CHANGING = 0.4  # share of changes of sign: 0.8 for white noise
_ROUNDING = 1e-9  # of the range: below it, noise is that of arithmetic
_ODDS = 1e-6  # of a false alarm in a record, where noise is what keeps samples from being equal


class Level(NamedTuple):
    """What a channel can resolve.

    Attributes
    ----------
    step : float
        Least difference of values: the step of the converter, or next to nothing.
    noise : float
        Standard deviation of what is not smooth.
    range : float
    noisy : bool
        Whether noise is beyond the resolution, so that many equal samples in a row are no accident.
    equal : float
        Share of equal neighbours.
    """

    step: float
    noise: float
    range: float
    noisy: bool
    equal: float

    @property
    def beyond(self) -> bool:
        """Whether noise is more than rounding, by the converter or by arithmetic."""
        return self.noise > max(_BEYOND * self.step, _ROUNDING * self.range)

    def pinned(self, count: int) -> float:
        """Equal samples in a row that noise does not give by chance in a record of so many samples.

        A signal that stands still in the middle of a step is the likeliest to be rounded alike: then the next sample is
        equal with the probability that the noise, without that of the rounding itself, stays within half a step.
        """
        noise = np.sqrt(max(self.noise**2 - self.step**2 / 12, np.finfo(float).tiny))
        rounded_alike = erf(self.step / noise / np.sqrt(8))
        return 1 + np.log(count / _ODDS) / -np.log(np.clip(max(rounded_alike, self.equal), 1e-6, _ALIKE))

    @property
    def resolution(self) -> float:
        """The larger of step and noise."""
        return max(self.step, self.noise)


def flat_runs(values: np.ndarray) -> np.ndarray:
    """Runs of three equal values or more, first and last index, (runs, 2)."""
    found = runs(values[1:] == values[:-1])
    found[:, 1] += 1
    return found[found[:, 1] - found[:, 0] + 1 >= _SHORTEST]


def level_of(values: np.ndarray, flat: np.ndarray) -> Level:
    """Resolution and noise of a channel; noise is what fourth differences leave of a smooth signal."""
    # The ends of the range are left out: where it is cut off lies between the steps of a converter.
    taken = np.unique(values[:_NOISE_SAMPLES])
    step = float(np.diff(taken[1:-1] if len(taken) > _FEW else taken).min(initial=np.inf))
    kept = np.ones(min(len(values), _NOISE_SAMPLES), bool)
    for begin, end in _suspects(values, flat[flat[:, 0] < len(kept)]):
        kept[begin : end + 1] = False
    fourth = np.diff(values[: len(kept)], 4)[kept[2:-2]]
    span = float(np.ptp(values))
    if len(fourth) < 2:
        return Level(step, 0.0, span, False, 1.0)
    noise, changing = white_noise(fourth)
    # A square wave has few samples that are not in a run, a staircase many that are equal to their neighbours.
    equal = float(np.mean(np.diff(values[: len(kept)])[kept[1:]] == 0))
    level = Level(step, noise, span, False, equal)
    noisy = level.beyond and changing > _CHANGING and np.mean(kept) > _MOVING and equal < _EQUAL
    return level._replace(noisy=bool(noisy))


def white_noise(fourth: np.ndarray) -> tuple[float, float]:
    """Standard deviation of the noise that fourth differences show, and how often they change sign.

    Those of noise change sign from one to the next; those of a smooth signal do so but seldom.
    """
    squares = fourth**2
    variance = np.mean(squares[squares <= np.quantile(squares, _TRIMMED)]) / _TRIMMED_VARIANCE
    changing = float(np.mean(fourth[1:] * fourth[:-1] < 0))
    return float(np.sqrt(variance / _GAIN_OF_FOURTH_DIFFERENCES)), changing


def _suspects(values: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """Runs that say nothing of the noise if they are faults: those at the ends of the range, and the longest."""
    if not len(flat):
        return flat
    length, at = flat[:, 1] - flat[:, 0] + 1, values[flat[:, 0]]
    extreme = (at == values.max()) | (at == values.min())
    return flat[(extreme & (length >= _LONG)) | (length == length.max())]
