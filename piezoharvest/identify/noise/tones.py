"""A drive that is a sum of sines after it was at rest: what a generator or a servo was told to do."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.signal import find_peaks
from scipy.signal.windows import hann

MOST = 30  # tones
LONGEST = 1 << 17  # samples
FALLS = 0.5  # of the squares that are left, which further tones have to leave at most
WEAK = 0.01  # of the power of the strongest line that is left: sidelobes of a Hann window have less
STANDS_OUT = 20.0  # times the mean power of the lines, beyond what the largest of so many has by chance
STEPS, LAST = 6, 30  # of Newton's method for the frequencies, and once all are known: those of close lines take long
STILL = 1e-6  # cycles in the samples, by which no frequency moves any more
CYCLE, APART = 0.5, 0.3  # cycles in the samples that a tone has at least, and by which tones differ


class DriveTones(NamedTuple):
    """Constant, and sines by angle from sample to sample; samples count from the middle of some.

    Attributes
    ----------
    count : int
        Samples that they were fitted to.
    angles : (tones,) array
    sizes : (1 + 2 tones,) array
        Of the constant, the cosines and the sines.
    """

    count: int
    angles: np.ndarray
    sizes: np.ndarray

    def since(self, early: int) -> np.ndarray:
        """Values at their samples and so many before them."""
        return _columns(np.arange(-early, self.count) - 0.5 * (self.count - 1), self.angles) @ self.sizes


def tones(values: np.ndarray) -> DriveTones | None:
    """Constant and sines that stand out of the noise of some samples, by least squares.

    The strongest lines of the residual are added until none is left, all frequencies being refined each time (Newton's
    method on separable least squares: Golub & Pereyra, SIAM Journal on Numerical Analysis 10(2), 413-432, 1973).

    Parameters
    ----------
    values : (n,) array

    Returns
    -------
    Tones or None
        None where there are too many, or none, or where the samples are more than memory has room for.
    """
    if len(values) > LONGEST:
        return None
    found = DriveTones(len(values), np.empty(0), np.array([values.mean()]))
    left, squares = values - values.mean(), np.inf
    while left @ left < FALLS * squares:
        squares = left @ left
        more = _lines(left, found.angles)
        if not len(more):
            return refined(values, found.angles) if len(found.angles) else None
        if len(found.angles) + len(more) > MOST:
            return None
        found = refined(values, np.concatenate([found.angles, more]), STEPS)
        left = values - found.since(0)
    return None


def _lines(residual: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Angles from sample to sample of lines that stand out and are no part of those that are known."""
    n = len(residual)
    power = np.abs(np.fft.rfft(residual * hann(n, sym=False), 2 * n)) ** 2
    least = np.median(power) / np.log(2.0) * (np.log(n) + STANDS_OUT)
    peaks = find_peaks(power, height=max(least, WEAK * power.max()), distance=4)[0]
    found = np.pi * peaks / n
    apart = np.abs(found[:, None] - angles).min(axis=1, initial=np.inf) > APART * 2 * np.pi / n
    return found[apart & (found > 2 * np.pi * CYCLE / n)]


def refined(values: np.ndarray, angles: np.ndarray, steps: int = LAST) -> DriveTones:
    """Tones near some angles, by least squares, in so many steps at most."""
    time = np.arange(len(values)) - 0.5 * (len(values) - 1)
    sizes = np.empty(0)
    for _ in range(steps):
        columns = _columns(time, angles)
        sizes = _solved(columns, values)
        cos, sin = columns[:, 1 : 1 + len(angles)], columns[:, 1 + len(angles) :]
        moving = time[:, None] * (sizes[1 + len(angles) :] * cos - sizes[1 : 1 + len(angles)] * sin)
        change = _solved(np.column_stack([columns, moving]), values - columns @ sizes)[columns.shape[1] :]
        change = np.clip(change, -np.pi / len(values), np.pi / len(values))
        angles = np.clip(angles + change, 2 * np.pi * CYCLE / len(values), np.pi)
        if np.abs(change).max() * len(values) < 2 * np.pi * STILL:
            break
    return DriveTones(len(values), angles, _solved(_columns(time, angles), values))


def _columns(time: np.ndarray, angles: np.ndarray) -> np.ndarray:
    turns = time[:, None] * angles
    return np.column_stack([np.ones(len(time)), np.cos(turns), np.sin(turns)])


def _solved(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Least squares by the normal equations: the columns are all but orthogonal, and there are few."""
    size = np.sqrt(np.maximum((columns**2).sum(axis=0), 1e-300))
    scaled = columns / size
    return np.linalg.lstsq(scaled.T @ scaled, scaled.T @ values, rcond=1e-12)[0] / size
