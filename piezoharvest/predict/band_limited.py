"""Interpolation of a drive that is fast beside its samples: of limited bandwidth, by a windowed sinc.

A cubic spline loses 1.4 % of a sine of a quarter of the sample rate. Here the cubic of a step has the moments of the
function of limited bandwidth through the samples: a specimen that is slow beside the samples answers to these alone,
however fast the drive is.

Source: Kaiser & Schafer, IEEE Trans. ASSP 28(1), 105-107, 1980 (window).
"""

from __future__ import annotations

from functools import cache

import numpy as np

REACH = 24  # samples to each side
WINDOW = 11.0  # beta of Kaiser's window: errors of 1e-6 up to 0.4 times the sample rate
NODES = 12  # of the quadrature over a step
FAST = 0.12 * np.pi  # angle per sample from which a cubic spline loses more than 2e-5 of an amplitude
MIN_FAST_SHARE = 1e-3  # of a drive's power above it; 3 % of white noise have less


def is_fast(values: np.ndarray) -> bool:
    """True for samples (n,) of a drive with power at frequencies where a cubic spline is inaccurate."""
    if len(values) < 4 * REACH:
        return False
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    angle = np.linspace(0.0, np.pi, len(power))
    return float(power[angle > FAST].sum()) > MIN_FAST_SHARE * float(power.sum())


def put_cubics(values: np.ndarray, coefficients: np.ndarray) -> None:
    """Overwrite coefficients (n - 1, 4) of the steps between samples (n,), except for those near the ends."""
    if len(values) < 2 * REACH:
        return
    for power, taps in enumerate(_taps(), start=1):
        coefficients[REACH - 1 : len(values) - REACH, power] = np.convolve(values, taps[::-1], "valid")


def cubic_of_sine(angle: np.ndarray) -> list[np.ndarray]:
    """Coefficients (4 times (f,)) of the step of exp(i angle n) from n = 0 on."""
    places = np.arange(1 - REACH, REACH + 1)
    turns = np.exp(1j * np.outer(places, angle))
    return [np.ones_like(turns[0]), *(taps @ turns for taps in _taps())]


@cache
def _taps() -> np.ndarray:
    """Weights (3, 2 REACH) of the samples around a step in the coefficients of its first three powers.

    The constant is the first sample; the other three follow from the moments of orders 0 to 2.
    """
    node, weight = np.polynomial.legendre.leggauss(NODES)
    node, weight = 0.5 * (node + 1.0), 0.5 * weight
    away = node[:, None] - np.arange(1 - REACH, REACH + 1)
    window = np.i0(WINDOW * np.sqrt(np.maximum(1.0 - (away / REACH) ** 2, 0.0)))
    shape = np.sinc(away) * window
    shape /= shape.sum(axis=1, keepdims=True)  # a constant is a constant
    first = np.zeros(2 * REACH)
    first[REACH - 1] = 1.0
    moments = np.array([(weight * node**k) @ shape - first / (k + 1) for k in range(3)])
    powers = [[1.0 / (j + k + 1) for j in range(1, 4)] for k in range(3)]
    return np.linalg.solve(powers, moments)
