"""Detection of a drive that is a sum of sines, as commanded by a generator or a servo."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.signal import find_peaks
from scipy.signal.windows import hann

MAX_TONES = 30  # largest number of tones
MAX_SAMPLES = 1 << 17  # largest number of samples
MAX_RESIDUAL_RATIO = 0.5  # largest ratio of the squares left after further tones to those before
MIN_RELATIVE_POWER = 0.01  # of the power of the strongest remaining line: sidelobes of a Hann window have less
LINE_SIGNIFICANCE = 20.0  # times the mean power of the lines, above the expected largest of that many
# Steps of Newton's method for the frequencies, and for the last round: close lines take long.
NEWTON_STEPS = 6
FINAL_NEWTON_STEPS = 30
FREQUENCY_TOLERANCE = 1e-6  # cycles in all samples: change of a frequency at convergence
MIN_CYCLES, MIN_SEPARATION = 0.5, 0.3  # cycles in all samples: least of a tone, and least difference of tones


class DriveTones(NamedTuple):
    """Constant and sines with angles per sample; time counts in samples from the middle of the fitted ones.

    Attributes
    ----------
    count : int
        Number of samples of the fit.
    angles : (tones,) array
    sizes : (1 + 2 tones,) array
        Coefficients of the constant, the cosines and the sines.
    """

    count: int
    angles: np.ndarray
    sizes: np.ndarray

    def since(self, early: int) -> np.ndarray:
        """Values at the samples of the fit and `early` samples before them."""
        return _columns(np.arange(-early, self.count) - 0.5 * (self.count - 1), self.angles) @ self.sizes


def tones(values: np.ndarray, angles: np.ndarray | None = None) -> DriveTones | None:
    """Constant and sines that are significant above the noise of some samples, by least squares.

    The strongest lines of the residual are added until none is left, all frequencies being refined each time (Newton's
    method on separable least squares: Golub & Pereyra, SIAM Journal on Numerical Analysis 10(2), 413-432, 1973).

    Parameters
    ----------
    values : (n,) array
    angles : (tones,) array, optional
        Start values per sample, of a drive like this one: if they are right, nothing is searched for.

    Returns
    -------
    DriveTones or None
        None if there are too many, or none, or if the samples are too many for memory.
    """
    if len(values) > MAX_SAMPLES:
        return None
    found = DriveTones(len(values), np.empty(0), np.array([values.mean()]))
    if angles is not None and len(angles):
        found = refined(values, angles, NEWTON_STEPS)
    left, squares = values - found.since(0), np.inf
    while left @ left < MAX_RESIDUAL_RATIO * squares:
        squares = left @ left
        more = _lines(left, found.angles)
        if not len(more):
            return refined(values, found.angles) if len(found.angles) else None
        if len(found.angles) + len(more) > MAX_TONES:
            return None
        found = refined(values, np.concatenate([found.angles, more]), NEWTON_STEPS)
        left = values - found.since(0)
    return None


def _lines(residual: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Angles per sample of significant lines that are not part of known ones."""
    n = len(residual)
    power = np.abs(np.fft.rfft(residual * hann(n, sym=False), 2 * n)) ** 2
    least = np.median(power) / np.log(2.0) * (np.log(n) + LINE_SIGNIFICANCE)
    peaks = find_peaks(power, height=max(least, MIN_RELATIVE_POWER * power.max()), distance=4)[0]
    found = np.pi * peaks / n
    apart = np.abs(found[:, None] - angles).min(axis=1, initial=np.inf) > MIN_SEPARATION * 2 * np.pi / n
    return found[apart & (found > 2 * np.pi * MIN_CYCLES / n)]


def refined(values: np.ndarray, angles: np.ndarray, steps: int = FINAL_NEWTON_STEPS) -> DriveTones:
    """Tones near some angles, by least squares, in at most `steps` steps."""
    time = np.arange(len(values)) - 0.5 * (len(values) - 1)
    sizes = np.empty(0)
    for _ in range(steps):
        columns = _columns(time, angles)
        sizes = _solved(columns, values)
        cos, sin = columns[:, 1 : 1 + len(angles)], columns[:, 1 + len(angles) :]
        moving = time[:, None] * (sizes[1 + len(angles) :] * cos - sizes[1 : 1 + len(angles)] * sin)
        change = _solved(np.column_stack([columns, moving]), values - columns @ sizes)[columns.shape[1] :]
        change = np.clip(change, -np.pi / len(values), np.pi / len(values))
        angles = np.clip(angles + change, 2 * np.pi * MIN_CYCLES / len(values), np.pi)
        if np.abs(change).max() * len(values) < 2 * np.pi * FREQUENCY_TOLERANCE:
            break
    return DriveTones(len(values), angles, _solved(_columns(time, angles), values))


def _columns(time: np.ndarray, angles: np.ndarray) -> np.ndarray:
    turns = time[:, None] * angles
    return np.column_stack([np.ones(len(time)), np.cos(turns), np.sin(turns)])


def _solved(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Least squares by the normal equations: the columns are few and nearly orthogonal."""
    size = np.sqrt(np.maximum((columns**2).sum(axis=0), 1e-300))
    scaled = columns / size
    return np.linalg.lstsq(scaled.T @ scaled, scaled.T @ values, rcond=1e-12)[0] / size
