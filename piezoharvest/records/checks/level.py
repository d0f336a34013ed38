"""Resolution and noise of a channel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import erf

from piezoharvest.records.finding import runs

_MIN_RUN = 3  # equal samples that count as a run
_LONG_RUN = 8  # equal samples at an end of the range that are not used for the noise
_NOISE_SAMPLES = 1 << 20  # from which the noise is estimated
_GAIN_OF_FOURTH_DIFFERENCES = 70.0  # of the variance of white noise
_FEW_VALUES = 16  # different values of a channel
_TRIMMED_SHARE = 0.95  # share of the differences from which noise is estimated: the rest may be corners
_TRIMMED_VARIANCE = 0.759  # of normal noise without the largest 5 %
_MIN_NOISE_STEPS = 0.6  # steps of a converter, whose rounding is noise of 0.29
_MIN_MOVING_SHARE = 0.3  # least share of samples outside runs
_MAX_EQUAL_SHARE = 0.5  # largest share of equal neighbours among these
_MAX_EQUAL_PROBABILITY = 0.9  # largest probability that the next sample is equal
_MIN_SIGN_CHANGES = 0.4  # least share of sign changes: 0.8 for white noise
_ROUNDING = 1e-9  # of the range: smaller noise is rounding of arithmetic
_FALSE_ALARM_PROBABILITY = 1e-6  # probability of a false alarm in a record, if noise makes samples differ


class Level(NamedTuple):
    """Resolution and noise of a channel.

    Attributes
    ----------
    step : float
        Least difference of values: the step of the converter, or almost zero.
    noise : float
        Standard deviation of the part that is not smooth.
    range : float
    noisy : bool
        True if noise exceeds the resolution, so that many equal samples in a row are not by chance.
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
        """True if noise is more than rounding by the converter or by arithmetic."""
        return self.noise > max(_MIN_NOISE_STEPS * self.step, _ROUNDING * self.range)

    def pinned(self, count: int) -> float:
        """Number of equal samples in a row that noise does not give by chance in a record of `count` samples.

        A signal at rest in the middle of a step is the most likely to be rounded to one value: then the next sample is
        equal with the probability that the noise, without that of the rounding itself, stays within half a step.
        """
        noise = np.sqrt(max(self.noise**2 - self.step**2 / 12, np.finfo(float).tiny))
        rounded_alike = erf(self.step / noise / np.sqrt(8))
        return 1 + np.log(count / _FALSE_ALARM_PROBABILITY) / -np.log(
            np.clip(max(rounded_alike, self.equal), 1e-6, _MAX_EQUAL_PROBABILITY)
        )

    @property
    def resolution(self) -> float:
        """The larger of step and noise."""
        return max(self.step, self.noise)


def flat_runs(values: np.ndarray) -> np.ndarray:
    """Runs of three equal values or more, first and last index, (runs, 2)."""
    found = runs(values[1:] == values[:-1])
    found[:, 1] += 1
    return found[found[:, 1] - found[:, 0] + 1 >= _MIN_RUN]


def level_of(values: np.ndarray, flat: np.ndarray) -> Level:
    """Resolution and noise of a channel; noise is estimated from fourth differences, which remove a smooth signal."""
    # The ends of the range are left out: a clipping limit may lie between the steps of a converter.
    taken = np.unique(values[:_NOISE_SAMPLES])
    step = float(np.diff(taken[1:-1] if len(taken) > _FEW_VALUES else taken).min(initial=np.inf))
    kept = np.ones(min(len(values), _NOISE_SAMPLES), bool)
    for begin, end in _suspects(values, flat[flat[:, 0] < len(kept)]):
        kept[begin : end + 1] = False
    fourth = np.diff(values[: len(kept)], 4)[kept[2:-2]]
    span = float(np.ptp(values))
    if len(fourth) < 2:
        return Level(step, 0.0, span, False, 1.0)
    noise, changing = white_noise(fourth)
    # A square wave has few samples outside runs, a staircase many that are equal to their neighbours.
    equal = float(np.mean(np.diff(values[: len(kept)])[kept[1:]] == 0))
    level = Level(step, noise, span, False, equal)
    noisy = (
        level.beyond and changing > _MIN_SIGN_CHANGES and np.mean(kept) > _MIN_MOVING_SHARE and equal < _MAX_EQUAL_SHARE
    )
    return level._replace(noisy=bool(noisy))


def white_noise(fourth: np.ndarray) -> tuple[float, float]:
    """Standard deviation of white noise from fourth differences, and the share of their sign changes.

    Fourth differences of noise mostly alternate in sign, those of a smooth signal seldom.
    """
    squares = fourth**2
    variance = np.mean(squares[squares <= np.quantile(squares, _TRIMMED_SHARE)]) / _TRIMMED_VARIANCE
    changing = float(np.mean(fourth[1:] * fourth[:-1] < 0))
    return float(np.sqrt(variance / _GAIN_OF_FOURTH_DIFFERENCES)), changing


def _suspects(values: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """Runs to leave out of the noise estimate, as possible faults: those at the ends of the range, and the longest."""
    if not len(flat):
        return flat
    length, at = flat[:, 1] - flat[:, 0] + 1, values[flat[:, 0]]
    extreme = (at == values.max()) | (at == values.min())
    return flat[(extreme & (length >= _LONG_RUN)) | (length == length.max())]
