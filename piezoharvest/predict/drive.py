"""The imposed channel between its samples: a cubic spline, with jumps told from what a spline can follow."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

JUMP = 0.1  # of the range: more than this from one sample to the next is a jump where the rest is slower
CALM = 8.0  # times as far as the samples beside it go
PIECE = 1 << 18  # samples whose spline is made at a time: making that of millions takes several times its memory
FORGETS = 32  # samples further on, a spline has forgotten a value: (2 - sqrt 3)^32 of it is left

BUMP = np.array([3.0, -6.0, 3.0, 0.0])  # 3 (1 - s)^2: of unit area, with neither value nor slope at the end of the step


class Drive(NamedTuple):
    """A drive as polynomials.

    Attributes
    ----------
    coefficients : (samples - 1, 4) array
        In powers of the share of the step.
    jumps : (jumps,) array of int
        Steps in which it jumps, at an instant that nobody knows.
    """

    coefficients: np.ndarray
    jumps: np.ndarray


def drive_of(values: np.ndarray) -> Drive:
    """Interpolate the samples of a drive.

    A spline, not straight lines: these lose (w h)^2/12 of a sine of angular frequency w between samples h apart, which
    a record of ten thousand samples shows. At a jump the spline is broken, for it would ring.
    """
    jumps = jumps_of(values)
    coefficients = np.zeros((len(values) - 1, 4))
    coefficients[:, 0], coefficients[:, 1] = values[:-1], np.diff(values)
    # After a jump, whose instant is a number of the record's own, the drive is at its new value: at rest, not on a
    # ramp.
    coefficients[jumps] = (
        values[jumps + 1, None] * np.eye(4)[0] + 0.5 * (values[jumps] - values[jumps + 1])[:, None] * BUMP
    )
    for begin, end in zip([0, *(jumps + 1)], [*jumps, len(values) - 1], strict=True):
        if end - begin >= 3:
            for a, b in pairwise([begin, *range(begin + PIECE, end - PIECE // 2, PIECE), end]):
                first, last = max(a - FORGETS, begin), min(b + FORGETS, end)
                spline = CubicSpline(np.arange(last - first + 1.0), values[first : last + 1])
                coefficients[a:b] = spline.c[::-1, a - first : b - first].T
    return Drive(coefficients, jumps)


def jumps_of(values: np.ndarray) -> np.ndarray:
    """Steps over which the drive jumps while it is calm on at least one side."""
    steps = np.abs(np.diff(values))
    if len(steps) < 4:
        return np.zeros(0, int)
    padded = np.pad(steps, 2, mode="edge")
    around = np.minimum(np.maximum(padded[:-4], padded[1:-3]), np.maximum(padded[3:-1], padded[4:]))
    return np.flatnonzero((steps > JUMP * np.ptp(values)) & (steps > CALM * around))
