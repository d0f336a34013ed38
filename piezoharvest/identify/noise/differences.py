"""White noise from differences of high order, which leave little of a signal: also where it grows with the reading."""

from __future__ import annotations

from math import comb

import numpy as np

# Differences of these orders have the same variance, as white noise has it, only where a signal is far below the noise:
# the variances of a sine go as powers of 2 sin(w h/2).
ORDERS = (4, 6, 8)
STANDARD_DEVIATIONS = 6.0  # by which they may differ: one false alarm in 10^9
# Standard deviations for one sample of white noise, by simulation: of the logarithm of the variance that the middle
# order shows, and of its difference between the first and the last.
OF_VARIANCE, OF_RATIO = 2.5, 0.75
# The same by medians, and the median of a square over its mean.
OF_MEDIAN, OF_MEDIAN_RATIO, MEDIAN = 3.4, 1.9, 0.4549364


def median_variance(values: np.ndarray, order: int, kept: np.ndarray | slice = slice(None)) -> float:
    """Variance of the white noise on a smooth signal, from the median square of its (kept) differences.

    The differences of a band-limited signal shrink with the order, those of white noise grow by a known factor. The
    median makes the estimate robust against corners. Noise that is not white is underestimated.
    """
    squares = np.diff(np.asarray(values, float), order)[kept] ** 2
    return float(np.median(squares)) / MEDIAN / comb(2 * order, order) if len(squares) else 0.0


def white_squares(values: np.ndarray) -> np.ndarray | None:
    """Squares about each sample, (samples,), with the variance of its noise as mean; None with a signal in them."""
    squares = [_squares(values, order) for order in ORDERS]
    means = np.array([each.mean() for each in squares])
    if not means.min() > 0.0:
        return None
    scatter = OF_RATIO * scatter_of(values**2) / np.sqrt(len(values))
    return squares[1] if np.ptp(np.log(means)) < STANDARD_DEVIATIONS * scatter else None


def white_variance(values: np.ndarray) -> float | None:
    """Variance of a channel's noise whatever its signal does in few samples; None with a signal in most of them."""
    medians = np.array([median_variance(values, order) for order in ORDERS])
    if not medians.min() > 0.0:
        return None
    tolerance = STANDARD_DEVIATIONS * OF_MEDIAN_RATIO / np.sqrt(len(values))
    return float(medians[1]) if np.ptp(np.log(medians)) < tolerance else None


def scatter_of(variance: np.ndarray) -> float:
    """Scatter of a mean of squares, at most, if the variance of the noise is anything from constant to this one."""
    return float(np.sqrt(np.mean(variance**2)) / np.mean(variance))


def _squares(values: np.ndarray, order: int) -> np.ndarray:
    """Squares of differences, about each sample, whose mean is the variance of white noise; the ends are repeated."""
    return np.pad(np.diff(values, order) ** 2 / comb(2 * order, order), order // 2, mode="edge")
