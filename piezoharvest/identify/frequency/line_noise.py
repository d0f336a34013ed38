"""Noise of a measured frequency response, from the scatter of its lines about a smooth curve through their neighbours.

No model of the specimen is used, so that misfit of a model cannot be taken for noise. In every window of a few lines a
rational function (a quadratic numerator over a linear denominator: one pole, one zero and a slow rest) is fitted, which
follows a sharp resonance even if it is no wider than the distance of the lines; its residual is noise. The variance
over all lines is a sum of four sources: a share of the response, a constant, a constant of the reciprocal (an impedance
is a voltage over a current, each with noise), and one given by the coherence.

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

WINDOW_LINES = 11  # lines: four complex coefficients leave seven degrees of freedom for the noise
WEIGHTING_ROUNDS = 3  # of weighting the windows by their own denominators
# Times its expectation, at which a square is clipped: a spike, or a window with more than one pole. The limit is so
# high that the bias of the mean is negligible.
MAX_SQUARE = 16.0
MIN_MAGNITUDE = (
    0.1  # of the magnitude within a window: smaller lines get no more weight, because they may be only noise
)
SCORING_ITERATIONS = 30
MIN_RESIDUAL_SHARE = 0.02  # least share of an error that the curve is taken to leave
# Standard errors whose coverage is to be right, and least degrees of freedom.
COVERED_STANDARD_ERRORS = 3.0
MIN_DEGREES_OF_FREEDOM = 2.0
MIN_NOISE = 1e-9  # relative: smaller noise is lost in rounding


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
    """Noise of a response from its residual to a smooth curve.

    Where few lines determine the noise, as on a sharp peak, whose noise the curve may follow, it is increased by the
    quantile of Student's distribution, so that three standard errors have the right coverage.

    Parameters
    ----------
    smooth : (f,) complex array
        Response without its noise.
    error : (f,) complex array
        Residual.
    leverage : (2, f) array
        Leverage of the errors of magnitude and phase at each line on the curve, from 0 to 1.
    coherence : (f,) array, optional
        Between 0 and 1, excluded.
    """
    relative = error / smooth
    size = np.abs(smooth) / np.exp(np.mean(np.log(np.abs(smooth))))
    sources = [np.ones(len(size)), size**-2.0, size**2.0]
    if coherence is not None:
        sources.append((1.0 - coherence) / coherence)  # Bendat & Piersol, Random Data, 2010, 9.2, up to a factor
    parts = zip((relative.real, relative.imag), 1.0 - np.clip(leverage, 0.0, 1.0 - MIN_RESIDUAL_SHARE), strict=True)
    return LineNoise(*(np.sqrt(_variance(part**2, left, np.array(sources))) for part, left in parts))


def smoothed(frequency: np.ndarray, response: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed response, and the leverage of each line on it.

    Parameters
    ----------
    frequency : (f,) array
        Hz, not decreasing; a frequency may occur several times, in repeated sweeps. At least `WINDOW_LINES` of them.
    response : (f,) complex array
    """
    begin = np.clip(np.arange(len(frequency)) - WINDOW_LINES // 2, 0, len(frequency) - WINDOW_LINES)
    lines = begin[:, None] + np.arange(WINDOW_LINES)
    middle = np.median(np.abs(response[lines]), axis=1, keepdims=True)
    f, y = frequency[lines], response[lines] / middle
    x = (f - f[:, :1]) / np.maximum(f[:, -1:] - f[:, :1], 1e-300) * 2.0 - 1.0
    numerator = x[..., None] ** np.arange(3)
    level = np.maximum(np.abs(y), MIN_MAGNITUDE)
    weight, solution = 1.0 / level, np.zeros((len(lines), 4), complex)
    for _ in range(WEIGHTING_ROUNDS):
        columns = np.concatenate([numerator, (-x * y)[..., None]], axis=-1) * weight[..., None]
        inverse = np.linalg.pinv(columns, rcond=1e-12)
        solution = (inverse @ (weight * y)[..., None])[..., 0]
        denominator = 1.0 + x * solution[:, 3:]
        least = 1e-6 * np.abs(denominator).max(axis=1, keepdims=True)
        weight = 1.0 / level / np.maximum(np.abs(denominator), least)
    fitted = np.einsum("fwk,fk->fw", numerator, solution[:, :3]) / np.where(denominator == 0, 1.0, denominator)
    row, at = np.arange(len(lines)), np.arange(len(lines)) - begin
    # Leverage of a line on the curve, from the derivatives of the curve, whose last column is that of the denominator.
    slopes = np.concatenate([numerator, (-x * fitted)[..., None]], axis=-1) / denominator[..., None] / level[..., None]
    drawn = np.real(np.einsum("fk,fk->f", slopes[row, at], np.linalg.pinv(slopes, rcond=1e-12)[row, :, at]))
    return fitted[row, at] * middle[:, 0], drawn


def _variance(squares: np.ndarray, left: np.ndarray, sources: np.ndarray) -> np.ndarray:
    """Variance of every line as a sum of sources with unknown sizes, by robust scoring.

    Parameters
    ----------
    squares : (f,) array
    left : (f,) array
        Shares of the variances that remain in the squares.
    sources : (sources, f) array
    """
    floor, squares = MIN_NOISE**2, squares / left
    level = np.full(len(squares), np.average(squares, weights=left) + floor)
    for n in range(SCORING_ITERATIONS):
        # From above: with a low level at first, a source seen in few lines would be clipped away.
        counted = squares if n < SCORING_ITERATIONS // 2 else np.minimum(squares, MAX_SQUARE * level)
        size, root = (sources / level).max(axis=1), np.sqrt(left) / level
        shares, _ = nnls((sources * root / size[:, None]).T, counted * root)
        level = (shares / size) @ sources + floor
    # The variance of each line is uncertain by the scatter of the shares, equivalent to these degrees of freedom.
    rows = sources / level / size[:, None]
    scatter = np.linalg.pinv((rows * left) @ rows.T, rcond=1e-9, hermitian=True)
    degrees = 1.0 / np.maximum(np.einsum("sf,st,tf->f", rows, scatter, rows), 1e-9)
    quantile = student.ppf(ndtr(COVERED_STANDARD_ERRORS), np.maximum(degrees, MIN_DEGREES_OF_FREEDOM))
    return level * (quantile / COVERED_STANDARD_ERRORS) ** 2
