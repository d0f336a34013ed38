"""The imposed channel between its samples: a cubic spline, with jumps told from what a spline can follow.

A step with a jump is taken in many small ones: elements turn and slip within it, as what rings overshoots.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

JUMP = 0.1  # of the range: more than this from one sample to the next is a jump where the rest is slower
CALM = 8.0  # times as far as the samples beside it go
CORNER = 1e-3  # of the range: by so much the slope changes in a sample at a corner
PIECE = 1 << 18  # samples whose spline is made at a time: making that of millions takes several times its memory
FORGETS = 32  # samples further on, a spline has forgotten a value: (2 - sqrt 3)^32 of it is left

FINE = 512  # small steps that one with a jump is taken in
RISE = 8.0  # of these, that a jump is first taken to last
TINY = 1e-4  # by which derivatives of a rise are taken


class Drive(NamedTuple):
    """A drive as polynomials.

    Attributes
    ----------
    coefficients : (samples - 1, 4) array
        In powers of the share of the step.
    jumps : (jumps,) array of int
        Steps in which it jumps, when and how fast nobody knows.
    """

    coefficients: np.ndarray
    jumps: np.ndarray


def drive_of(values: np.ndarray) -> Drive:
    """Interpolate the samples of a drive.

    A spline, not straight lines: these lose (w h)^2/12 of a sine of angular frequency w between samples h apart, which
    a record of ten thousand samples shows. At a jump the spline is broken, and at a corner, for it would ring.
    """
    jumps = jumps_of(values)
    coefficients = np.zeros((len(values) - 1, 4))
    coefficients[:, 0], coefficients[:, 1] = values[:-1], np.diff(values)
    corners = np.setdiff1d(corners_of(values), [jumps, jumps + 1])
    begins = np.union1d(np.concatenate([[0], jumps + 1]), corners)
    ends = np.union1d(np.concatenate([jumps, [len(values) - 1]]), corners)
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        if end - begin >= 3:
            for a, b in pairwise([begin, *range(begin + PIECE, end - PIECE // 2, PIECE), end]):
                first, last = max(a - FORGETS, begin), min(b + FORGETS, end)
                spline = CubicSpline(np.arange(last - first + 1.0), values[first : last + 1])
                coefficients[a:b] = spline.c[::-1, a - first : b - first].T
    return Drive(coefficients, jumps)


def rising(line: np.ndarray, late: float, rise: float) -> tuple[np.ndarray, np.ndarray]:
    """The small steps of a step in which a drive rises, between two samples to which it is level.

    How long that takes is felt by what overshoots, hence by operators that turn back with it: not at all where it takes
    longer than what rings.

    Parameters
    ----------
    line : (4,) array
        Its coefficients, as if it went straight.
    late : float
        By how many small steps the middle of the rise comes after that of the step: half of them at most.
    rise : float
        Logarithm of its duration over `RISE` small steps.

    Returns
    -------
    (FINE, 4) array
        Coefficients of the small steps: the mean in each.
    (FINE, 2) array
        Derivatives of these means to the integral over the step, in small steps, and to `rise`.
    """
    found = np.zeros((FINE, 4))
    found[:, 0] = line[0] + line[1] * _risen(late, rise)
    to_late = (_risen(late + TINY, rise) - _risen(late - TINY, rise)) / (2.0 * TINY)
    to_rise = (_risen(late, rise + TINY) - _risen(late, rise - TINY)) / (2.0 * TINY)
    return found, np.column_stack([-to_late, line[1] * to_rise])


def _risen(late: float, rise: float) -> np.ndarray:
    """Share of a rise that is done, as the mean over each small step; it lies between the samples as a whole."""
    half = max(min(0.5 * RISE * np.exp(rise), FINE / 2 - abs(late)), TINY)
    begin, end = FINE / 2 + late - half, FINE / 2 + late + half
    at = np.arange(FINE + 1.0)
    inside = (np.clip(at, begin, end) - begin) ** 2 / (2.0 * (end - begin))
    return np.diff(inside + np.maximum(at - end, 0.0))


def divided(coefficients: np.ndarray, parts: int) -> np.ndarray:
    """The small steps (steps * parts, 4) of steps (steps, 4) in which a drive does not jump."""
    begin = np.arange(parts) / parts
    a, b, c, d = coefficients.T[:, :, None]
    columns = [
        a + begin * (b + begin * (c + begin * d)), b + begin * (2 * c + 3 * begin * d), c + 3 * begin * d,
        d + 0 * begin,
    ]  # fmt: skip
    return np.stack(columns, axis=-1).reshape(-1, 4) / float(parts) ** np.arange(4)


def jumps_of(values: np.ndarray) -> np.ndarray:
    """Steps over which the drive jumps while it is calm on at least one side."""
    steps = np.abs(np.diff(values))
    if len(steps) < 4:
        return np.zeros(0, int)
    padded = np.pad(steps, 2, mode="edge")
    around = np.minimum(np.maximum(padded[:-4], padded[1:-3]), np.maximum(padded[3:-1], padded[4:]))
    return np.flatnonzero((steps > JUMP * np.ptp(values)) & (steps > CALM * around))


def corners_of(values: np.ndarray) -> np.ndarray:
    """Samples at which a ramp begins or ends: the slope changes there alone."""
    bends = np.abs(np.diff(values, 2))
    if len(bends) < 5:
        return np.zeros(0, int)
    padded = np.pad(bends, 2, mode="edge")
    beside = np.max([padded[:-4], padded[1:-3], padded[3:-1], padded[4:]], axis=0)
    found = np.flatnonzero((bends > CORNER * np.ptp(values)) & (bends > CALM * beside)) + 1
    return found[(found > 1) & (found < len(values) - 2)]
