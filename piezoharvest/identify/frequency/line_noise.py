"""Noise of a measured frequency response, from how its lines scatter about a smooth curve through their neighbours.

No model of the specimen enters, so that a fit which misses the data cannot pass for noise. In every window of a few
lines a rational function (a quadratic numerator over a linear denominator: one pole, one zero and what else is slow) is
fitted, which follows a sharp resonance even where it is no wider than the lines are apart; what it leaves is noise.
Its size over all lines is that of four sources: a share of the response, a constant, a constant of the reciprocal (an
impedance is a voltage over a current, either with noise of its own), and what the coherence tells.

Sources: Schoukens, Vandersteen, Barbe & Pintelon, "Nonparametric preprocessing in system identification", European
Journal of Control 15, 260-274, 2009 (local polynomials); McKelvey & Guerin, IFAC SYSID 2012 (local rational functions);
Sanathanan & Koerner, IEEE Trans. Automatic Control 8, 56-58, 1963 (the iteration).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.special import ndtr
from scipy.stats import t as student

WINDOW = 11  # lines: four complex coefficients leave seven of them for the noise
ROUNDS = 3  # of weighing the windows by their own denominators
# Times its expectation, that a square counts at most: a spike, or a window with more poles than one. So much of a
# square is its mean that nothing has to be made up for.
CLIPPED = 16.0
DEEP = 0.1  # of the size within a window: what is smaller weighs no more, for noise may be all there is of it
SCORINGS = 30
LITTLE = 0.02  # of an error is always taken to be left by the curve
SURE, FEWEST_DEGREES = 3.0, 2.0  # standard errors that are to be right, and degrees of freedom at least
ROUNDING = 1e-9  # relative: less noise no calculation keeps


class LineNoise(NamedTuple):
    """Noise of every line, relative to the response there.

    Attributes
    ----------
    along, across : (f,) array
        Standard deviations of the magnitude's relative error, and of the phase in rad.
    """

    along: np.ndarray
    across: np.ndarray


def line_noise(
    smooth: np.ndarray, error: np.ndarray, leverage: np.ndarray, coherence: np.ndarray | None = None
) -> LineNoise:
    """Noise of a response by what a smooth curve leaves of it.

    Where few lines tell it, as those on a sharp peak, which the curve may follow wherever noise takes them, it counts
    for as much more as the quantile of Student's distribution says: three standard errors then hold what they promise.

    Parameters
    ----------
    smooth : (f,) complex array
        Response without its noise.
    error : (f,) complex array
        What is left.
    leverage : (2, f) array
        By how much errors of magnitude and phase at each line draw the curve towards themselves, from 0 to 1.
    coherence : (f,) array, optional
        Between 0 and 1, excluded.
    """
    relative = error / smooth
    size = np.abs(smooth) / np.exp(np.mean(np.log(np.abs(smooth))))
    sources = [np.ones(len(size)), size**-2.0, size**2.0]
    if coherence is not None:
        sources.append((1.0 - coherence) / coherence)  # Bendat & Piersol, Random Data, 2010, 9.2, but for a factor
    parts = zip((relative.real, relative.imag), 1.0 - np.clip(leverage, 0.0, 1.0 - LITTLE), strict=True)
    return LineNoise(*(np.sqrt(_variance(part**2, left, np.array(sources))) for part, left in parts))


def smoothed(frequency: np.ndarray, response: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A response without most of its noise, and the leverage of each line on this.

    Parameters
    ----------
    frequency : (f,) array
        Hz, not falling; a frequency may come several times, of repeated sweeps. At least `WINDOW` of them.
    response : (f,) complex array
    """
    begin = np.clip(np.arange(len(frequency)) - WINDOW // 2, 0, len(frequency) - WINDOW)
    lines = begin[:, None] + np.arange(WINDOW)
    middle = np.median(np.abs(response[lines]), axis=1, keepdims=True)
    f, y = frequency[lines], response[lines] / middle
    x = (f - f[:, :1]) / np.maximum(f[:, -1:] - f[:, :1], 1e-300) * 2.0 - 1.0
    numerator = x[..., None] ** np.arange(3)
    level = np.maximum(np.abs(y), DEEP)
    weight, solution = 1.0 / level, np.zeros((len(lines), 4), complex)
    for _ in range(ROUNDS):
        columns = np.concatenate([numerator, (-x * y)[..., None]], axis=-1) * weight[..., None]
        inverse = np.linalg.pinv(columns, rcond=1e-12)
        solution = (inverse @ (weight * y)[..., None])[..., 0]
        denominator = 1.0 + x * solution[:, 3:]
        least = 1e-6 * np.abs(denominator).max(axis=1, keepdims=True)
        weight = 1.0 / level / np.maximum(np.abs(denominator), least)
    fitted = np.einsum("fwk,fk->fw", numerator, solution[:, :3]) / np.where(denominator == 0, 1.0, denominator)
    row, at = np.arange(len(lines)), np.arange(len(lines)) - begin
    # What a line itself has drawn the curve towards it: with the derivatives of the curve, whose last column is that of
    # the denominator.
    slopes = np.concatenate([numerator, (-x * fitted)[..., None]], axis=-1) / denominator[..., None] / level[..., None]
    drawn = np.real(np.einsum("fk,fk->f", slopes[row, at], np.linalg.pinv(slopes, rcond=1e-12)[row, :, at]))
    return fitted[row, at] * middle[:, 0], drawn


def _variance(squares: np.ndarray, left: np.ndarray, sources: np.ndarray) -> np.ndarray:
    """Variance of every line as a sum of sources, of which each has its own size; by scoring, and robust.

    Parameters
    ----------
    squares : (f,) array
    left : (f,) array
        Shares of the variances, that are in the squares.
    sources : (sources, f) array
    """
    floor, squares = ROUNDING**2, squares / left
    level = np.full(len(squares), np.average(squares, weights=left) + floor)
    for n in range(SCORINGS):
        # From above: a source that few lines show would be clipped away, were the level too low at first.
        counted = squares if n < SCORINGS // 2 else np.minimum(squares, CLIPPED * level)
        size, root = (sources / level).max(axis=1), np.sqrt(left) / level
        shares, _ = nnls((sources * root / size[:, None]).T, counted * root)
        level = (shares / size) @ sources + floor
    # The variance of each line by the scatter of these shares, which is that of so many degrees of freedom.
    rows = sources / level / size[:, None]
    scatter = np.linalg.pinv((rows * left) @ rows.T, rcond=1e-9, hermitian=True)
    degrees = 1.0 / np.maximum(np.einsum("sf,st,tf->f", rows, scatter, rows), 1e-9)
    return level * (student.ppf(ndtr(SURE), np.maximum(degrees, FEWEST_DEGREES)) / SURE) ** 2
