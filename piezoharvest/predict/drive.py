"""Interpolation of the imposed channel: a cubic spline, broken at jumps that a spline cannot follow.

A step with a jump is divided into many small ones: elements reverse and slip within it, as the response overshoots.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d

from piezoharvest.description.effects.nameless.sizes import RecordSizes
from piezoharvest.predict.band_limited import is_fast, put_cubics

SINE_ITERATIONS = 5  # of the fit of a sine, which doubles its digits with each
MIN_JUMP = 0.1  # of the range: a larger change between two samples is a jump if the others are slower
MIN_JUMP_RATIO = 8.0  # smallest ratio of a jump to the changes beside it
JUMP_BESIDE = 8  # of these changes on one side; so many of white noise are that small once in 10^5 samples
MIN_CORNER = 1e-3  # of the range: least change of slope per sample at a corner
SPLINE_PIECE = 1 << 18  # samples of a spline computed at a time: that of millions needs several times their memory
SPLINE_OVERLAP = 32  # samples after which a value has no influence on a spline: (2 - sqrt 3)^32 of it remains

JUMP_PARTS = 512  # small steps of a step with a jump
RISE_PARTS = 8.0  # of these: initial duration of a jump
RISE_DIFFERENCE = 1e-4  # finite difference for derivatives of a rise


class PolynomialDrive(NamedTuple):
    """A drive as piecewise polynomial.

    Attributes
    ----------
    coefficients : (samples - 1, 4) array
        Of the powers of time as fraction of the step.
    jumps : (jumps,) array of int
        Steps in which it jumps, at an unknown time and rate.
    fast : bool
        True if it is interpolated as a function of limited bandwidth (`band_limited`).
    """

    coefficients: np.ndarray
    jumps: np.ndarray
    fast: bool = False


def size_of(values: np.ndarray, sample_time: float) -> RecordSizes:
    """Amplitude of a drive, half of its range, frequency in Hz of its strongest line, and length in s.

    The frequency is zero where the drive is still.

    The line is interpolated in a windowed spectrum (Harris, Proc. IEEE 66(1), 51-83, 1978), and refined by the fit of a
    sine (IEEE Std 1057, 2017, annex B) where that stays within a line of it.
    """
    lasts = sample_time * (len(values) - 1)
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    peak = int(np.argmax(power)) if len(power) > 2 else 0
    if not 0 < peak < len(power) - 1 or not np.all(power[peak - 1 : peak + 2] > 0.0):
        return RecordSizes(0.5 * float(np.ptp(values)), 0.0, length=lasts)
    a, b, c = np.log(power[peak - 1 : peak + 2])
    line = peak + (0.5 * (a - c) / (a - 2.0 * b + c) if a + c < 2.0 * b else 0.0)
    length = len(values) * sample_time
    found = _refined(values, sample_time, line / length)
    frequency = found if abs(found * length - line) < 1.0 else float(line / length)
    return RecordSizes(0.5 * float(np.ptp(values)), frequency, length=lasts)


def _refined(values: np.ndarray, sample_time: float, frequency: float) -> float:
    """Frequency in Hz of the sine that is closest to samples, from one nearby on."""
    t = sample_time * (np.arange(len(values)) - 0.5 * len(values))
    sine = np.zeros(3)
    for _ in range(SINE_ITERATIONS):
        angle = 2.0 * np.pi * frequency * t
        basis = np.column_stack([np.cos(angle), np.sin(angle), np.ones(len(t))])
        slope = t * (basis[:, 0] * sine[1] - basis[:, 1] * sine[0])
        columns = np.column_stack([basis, slope]) if np.any(sine) else basis
        *sine, move = [*np.linalg.lstsq(columns, values, rcond=None)[0], 0.0][:4]
        frequency += move / (2.0 * np.pi)
    return float(frequency)


def drive_of(values: np.ndarray) -> PolynomialDrive:
    """Interpolate the samples of a drive.

    A spline, not straight lines: these lose (w h)^2/12 of a sine of angular frequency w between samples h apart, which
    is significant in a record of ten thousand samples. The spline is broken at jumps and corners, where it would
    oscillate. Where the drive is fast beside the samples, and nothing breaks it, its limited bandwidth tells more.
    """
    jumps = jumps_of(values)
    coefficients = np.zeros((len(values) - 1, 4))
    coefficients[:, 0], coefficients[:, 1] = values[:-1], np.diff(values)
    corners = np.setdiff1d(corners_of(values), [jumps, jumps + 1])
    begins = np.union1d(np.concatenate([[0], jumps + 1]), corners)
    ends = np.union1d(np.concatenate([jumps, [len(values) - 1]]), corners)
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        if end - begin >= 3:
            for a, b in pairwise([begin, *range(begin + SPLINE_PIECE, end - SPLINE_PIECE // 2, SPLINE_PIECE), end]):
                first, last = max(a - SPLINE_OVERLAP, begin), min(b + SPLINE_OVERLAP, end)
                spline = CubicSpline(np.arange(last - first + 1.0), values[first : last + 1])
                coefficients[a:b] = spline.c[::-1, a - first : b - first].T
    fast = not len(jumps) and not len(corners) and is_fast(values)
    if fast:
        put_cubics(values, coefficients)
    return PolynomialDrive(coefficients, jumps, fast)


def rise_steps(line: np.ndarray, late: float, rise: float) -> tuple[np.ndarray, np.ndarray]:
    """Small steps of a step in which a drive rises from one constant value to another.

    The duration of the rise determines the overshoot, and thereby the operators that reverse with it; there is none if
    the rise is slower than the oscillation.

    Parameters
    ----------
    line : (4,) array
        Coefficients of the step as a linear drive.
    late : float
        Delay of the middle of the rise after that of the step, in small steps: half of them at most.
    rise : float
        Logarithm of its duration over `RISE_PARTS` small steps.

    Returns
    -------
    (JUMP_PARTS, 4) array
        Coefficients of the small steps: the mean in each.
    (JUMP_PARTS, 2) array
        Derivatives of these means with respect to the integral over the step, in small steps, and to `rise`.
    """
    found = np.zeros((JUMP_PARTS, 4))
    found[:, 0] = line[0] + line[1] * _rise_fraction(late, rise)
    to_late = (_rise_fraction(late + RISE_DIFFERENCE, rise) - _rise_fraction(late - RISE_DIFFERENCE, rise)) / (
        2.0 * RISE_DIFFERENCE
    )
    to_rise = (_rise_fraction(late, rise + RISE_DIFFERENCE) - _rise_fraction(late, rise - RISE_DIFFERENCE)) / (
        2.0 * RISE_DIFFERENCE
    )
    return found, np.column_stack([-to_late, line[1] * to_rise])


def _rise_fraction(late: float, rise: float) -> np.ndarray:
    """Completed fraction of a rise, as the mean over each small step; the whole rise lies between the samples."""
    half = max(min(0.5 * RISE_PARTS * np.exp(rise), JUMP_PARTS / 2 - abs(late)), RISE_DIFFERENCE)
    begin, end = JUMP_PARTS / 2 + late - half, JUMP_PARTS / 2 + late + half
    at = np.arange(JUMP_PARTS + 1.0)
    inside = (np.clip(at, begin, end) - begin) ** 2 / (2.0 * (end - begin))
    return np.diff(inside + np.maximum(at - end, 0.0))


def divided(coefficients: np.ndarray, parts: int) -> np.ndarray:
    """Coefficients (steps * parts, 4) of the parts of steps (steps, 4) without jumps."""
    begin = np.arange(parts) / parts
    a, b, c, d = coefficients.T[:, :, None]
    columns = [
        a + begin * (b + begin * (c + begin * d)), b + begin * (2 * c + 3 * begin * d), c + 3 * begin * d,
        d + 0 * begin,
    ]  # fmt: skip
    return np.stack(columns, axis=-1).reshape(-1, 4) / float(parts) ** np.arange(4)


def jumps_of(values: np.ndarray) -> np.ndarray:
    """Steps over which the drive jumps while it is slow on at least one side, for some samples: noise is not."""
    steps = np.abs(np.diff(values))
    if len(steps) < 4:
        return np.zeros(0, int)
    padded = np.pad(steps, JUMP_BESIDE, mode="edge")
    beside = maximum_filter1d(padded, JUMP_BESIDE, origin=-(JUMP_BESIDE // 2))  # of each value and those behind it
    around = np.minimum(beside[: len(steps)], beside[JUMP_BESIDE + 1 : JUMP_BESIDE + 1 + len(steps)])
    return np.flatnonzero((steps > MIN_JUMP * np.ptp(values)) & (steps > MIN_JUMP_RATIO * around))


def corners_of(values: np.ndarray) -> np.ndarray:
    """Samples at which a ramp begins or ends: the slope changes only there."""
    bends = np.abs(np.diff(values, 2))
    if len(bends) < 5:
        return np.zeros(0, int)
    padded = np.pad(bends, 2, mode="edge")
    beside = np.max([padded[:-4], padded[1:-3], padded[3:-1], padded[4:]], axis=0)
    found = np.flatnonzero((bends > MIN_CORNER * np.ptp(values)) & (bends > MIN_JUMP_RATIO * beside)) + 1
    return found[(found > 1) & (found < len(values) - 2)]
