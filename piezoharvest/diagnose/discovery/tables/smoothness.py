"""Smoothness of a law by marginal likelihood, from the normal equations of its kinks.

Source: Wood, Generalized Additive Models, 2017, section 6.2 (REML).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

RANGE = 12.0  # of the natural logarithm of the deviation, about the size of the kinks without a prior


class Smoothness(NamedTuple):
    """Prior deviation of the kinks, and what it makes of -2 ln L.

    Attributes
    ----------
    deviation : float
        Standard deviation of the kinks.
    gain : float
        Decrease of -2 ln of the marginal likelihood by the law.
    """

    deviation: float
    gain: float


def smoothness(information: np.ndarray, slope: np.ndarray) -> Smoothness:
    """The deviation of largest marginal likelihood.

    Parameters
    ----------
    information : (k, k) array
        Of the kinks, other parameters projected out.
    slope : (k,) array
        Right side, such that the kinks are its solution.
    """
    values, vectors = np.linalg.eigh(information)
    values, along = np.maximum(values, 0.0), vectors.T @ slope
    shown = values > 1e-12 * values.max()
    values, along = values[shown], along[shown]
    if not values.size or not np.any(along):
        return Smoothness(1.0, 0.0)

    def loss(log_deviation: float) -> float:
        precision = np.exp(-2.0 * log_deviation)
        return float(np.sum(np.log1p(values / precision)) - np.sum(along**2 / (values + precision)))

    centre = 0.5 * np.log(np.mean((along / values) ** 2))
    grid = centre + np.linspace(-RANGE, RANGE, 49)
    best = grid[int(np.argmin([loss(each) for each in grid]))]
    step = grid[1] - grid[0]
    found: Any = minimize_scalar(loss, bounds=(best - step, best + step), method="bounded")
    return Smoothness(float(np.exp(found.x)), max(0.0, -float(found.fun)))


def projected(
    information: np.ndarray, gradient: np.ndarray, prior: np.ndarray, own: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Information and gradient of some parameters, the others, with their prior, projected out."""
    weight = information + prior
    rest = [k for k in range(len(weight)) if k not in set(own) and weight[k, k] > 0.0]
    size = np.sqrt(np.diag(weight)[rest])
    left, right = information[np.ix_(rest, own)] / size[:, None], gradient[rest] / size
    matrix = weight[np.ix_(rest, rest)] / np.outer(size, size)
    solved = np.linalg.lstsq(matrix, np.column_stack([left, right]), 1e-13)[0]
    inside = information[np.ix_(own, own)] - left.T @ solved[:, :-1]
    return 0.5 * (inside + inside.T), gradient[own] - left.T @ solved[:, -1]
