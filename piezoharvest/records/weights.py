"""Linear operations on samples and their transposes, for the propagation of noise through them."""

from __future__ import annotations

import numpy as np
from scipy.signal import sosfilt


def simpson_weights(count: int, end: float) -> np.ndarray:
    """Weights of equally spaced samples for Simpson's integral from the first one to `end`, for a spacing of 1.

    `scipy.integrate.simpson` gives the integral and not the weights, which the uncertainty of the integral needs, and
    ends at samples only. If `end` is not an even number, the parabola through the three samples about it is used.

    Parameters
    ----------
    count : int
        Number of samples, three or more.
    end : float
        From 0 to count - 1.
    """
    weights = np.zeros(count)
    whole = 2 * int(min(end, count - 1) // 2)
    if whole:
        weights[: whole + 1 : 2] = 2.0 / 3.0
        weights[1:whole:2] = 4.0 / 3.0
        weights[[0, whole]] = 1.0 / 3.0
    first = min(whole, count - 3)
    weights[first : first + 3] += _parabola(end - first) - _parabola(whole - first)
    return weights


def _parabola(s: float) -> np.ndarray:
    """Integrals from 0 to s of the quadratic Lagrange polynomials at 0, 1, 2."""
    return np.array([s**3 / 6 - 0.75 * s**2 + s, s**2 - s**3 / 3, s**3 / 6 - 0.25 * s**2])


def smooth(low_pass: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Filter a signal, with its first sample as its value at all earlier times."""
    return signal[0] + np.asarray(sosfilt(low_pass, signal - signal[0]))


def smooth_transposed(low_pass: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Transpose of `smooth`: weights of a signal whose sum equals that of `weights` of the filtered signal."""
    found = np.asarray(sosfilt(low_pass, weights[::-1]))[::-1].copy()
    found[0] += weights.sum() - found.sum()
    return found


def gradient_transposed(weights: np.ndarray, step: float) -> np.ndarray:
    """Transpose of `numpy.gradient`: weights of a signal whose sum equals that of `weights` of its gradient."""
    slopes = 0.5 * weights / step
    slopes[[0, -1]] *= 2.0
    found = np.zeros(len(weights))
    found[2:] += slopes[1:-1]
    found[:-2] -= slopes[1:-1]
    found[[1, -1]] += slopes[[0, -1]]
    found[[0, -2]] -= slopes[[0, -1]]
    return found
