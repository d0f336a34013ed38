"""Means of correlated samples with the help of others whose expectation is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class MeanEstimate(NamedTuple):
    """A value and its standard error (NaN where there are too few samples for one)."""

    value: float
    standard_error: float


def controlled_mean(samples: np.ndarray, controls: np.ndarray, expected: np.ndarray) -> MeanEstimate:
    """Mean of samples by regression on control variates.

    Parameters
    ----------
    samples : (n,) array
        Averages over windows long enough to be independent of each other.
    controls : (n, c) array
        The same of quantities with known expectation, of the same windows.
    expected : (c,) array
        Their expectations.

    Notes
    -----
    The intercept of the least-squares fit of the samples to the controls' deviations from their expectations; the
    error is that of the regression (Glasserman, Monte Carlo Methods in Financial Engineering, 2003, section 4.1). Its
    bias falls as 1/n and is far below the error. Without controls the plain mean.
    """
    n, c = controls.shape
    if n < c + 3:
        return MeanEstimate(float(np.mean(samples)) if n else float("nan"), float("nan"))
    scale = np.where(expected != 0, np.abs(expected), 1.0)
    design = np.column_stack([np.ones(n), (controls - expected) / scale])
    fit, _, rank, _ = np.linalg.lstsq(design, samples, rcond=None)
    residual = samples - design @ fit
    variance = float(residual @ residual) / (n - rank)
    inverse = np.linalg.pinv(design.T @ design)
    return MeanEstimate(float(fit[0]), float(np.sqrt(variance * inverse[0, 0])))
