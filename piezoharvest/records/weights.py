"""Linear operations on samples together with their transposes, by which noise is followed through them."""

from __future__ import annotations

import numpy as np
from scipy.signal import sosfilt


def simpson_weights(count: int, end: float) -> np.ndarray:
    """Weights of equally spaced samples for Simpson's integral from the first one to `end`, for a spacing of 1.

    `scipy.integrate.simpson` gives the integral and not the weights, which the uncertainty of the integral needs, and
    ends at samples only. Where `end` is not an even number the parabola through the three samples about it is used.

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
    """Integrals from 0 to s of the parabolas that are 1 at one of 0, 1, 2 and 0 at the others."""
    return np.array([s**3 / 6 - 0.75 * s**2 + s, s**2 - s**3 / 3, s**3 / 6 - 0.25 * s**2])


def smooth(low_pass: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Filter a signal that has always been as its first sample is."""
    return signal[0] + np.asarray(sosfilt(low_pass, signal - signal[0]))


def smooth_transposed(low_pass: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weights of a signal that make the same sum as `weights` of the filtered one."""
    found = np.asarray(sosfilt(low_pass, weights[::-1]))[::-1].copy()
    found[0] += weights.sum() - found.sum()
    return found


def gradient_transposed(weights: np.ndarray, step: float) -> np.ndarray:
    """Weights of a signal that make the same sum as `weights` of its `numpy.gradient`."""
    slopes = 0.5 * weights / step
    slopes[[0, -1]] *= 2.0
    found = np.zeros(len(weights))
    found[2:] += slopes[1:-1]
    found[:-2] -= slopes[1:-1]
    found[[1, -1]] += slopes[[0, -1]]
    found[[0, -2]] -= slopes[[0, -1]]
    return found
