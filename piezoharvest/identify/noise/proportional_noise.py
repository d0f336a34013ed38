"""Noise that grows with the reading: a part of it is a share of what is read, as of a gain that scatters."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from piezoharvest.identify.noise.differences import OF_VARIANCE, STANDARD_DEVIATIONS, white_squares
from piezoharvest.identify.noise.noise_levels import is_smooth
from piezoharvest.records.record import Record

# Of the mean variance: no sensor is without noise at a reading of zero, and a fit that begins far off would follow
# nothing but the samples near it.
LEAST_CONSTANT_SHARE = 0.1
ROUNDS = 10  # of weighted least squares, each with the variance that the one before has found


def relative_variance(record: Record, channel: str) -> np.ndarray | None:
    """Variance of a channel's noise in each sample over its mean, (samples,); None where it is constant.

    The variance is a constant and a share of the square of the reading. Both follow from the squares of what is noise
    alone, by weighted least squares (Davidian & Carroll, Journal of the American Statistical Association 82, 1079-1091,
    1987).
    """
    values = record[channel]
    squares = white_squares(values) if is_smooth(record, channel) else None
    if squares is None:
        return None
    mean, reading = squares.mean(), values**2 / np.mean(values**2)
    off = reading - 1.0
    deviation = OF_VARIANCE * mean / np.sqrt(np.sum(off**2))
    if np.sum((squares - mean) * off) / np.sum(off**2) < STANDARD_DEVIATIONS * deviation:
        return None
    terms, variance = np.column_stack([np.ones(len(values)), reading]), np.full(len(values), mean)
    for _ in range(ROUNDS):
        parts = nnls(terms / variance[:, None], squares / variance)[0]
        variance = terms @ np.maximum(parts, [LEAST_CONSTANT_SHARE * mean, 0.0])
    return variance / variance.mean()
