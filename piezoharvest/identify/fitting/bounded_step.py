"""Step of a least-squares fit within the bounds of its variables."""

from __future__ import annotations

import contextlib
import warnings

import numpy as np

MIN_EIGENVALUE_RATIO = 1e-12  # relative eigenvalue of an information matrix
MAX_BLOCK_STEPS = 3  # without fewer unknowns at a wrong bound (Judice & Pires take 3 to 10)
SOLVER_TOLERANCE = 1e-10  # of a step that only has to decrease the cost; it is solved for again from where it leads


def bounded_step(
    information: np.ndarray, slope: np.ndarray, damping: float, low: np.ndarray, high: np.ndarray, alive: np.ndarray
) -> tuple[np.ndarray, float]:
    """Step of Levenberg and Marquardt within bounds, and the predicted decrease of the cost.

    Parameters
    ----------
    information : (p, p) array
    slope : (p,) array
        Negative gradient of half the cost.
    damping : float
        Added to the information, over its diagonal.
    low, high : (p,) array
        Bounds of the step.
    alive : (p,) array of bool
        False for variables that are fixed.
    """
    step = np.zeros(len(slope))
    step[alive], predicted = _step(information[np.ix_(alive, alive)], slope[alive], damping, low[alive], high[alive])
    return step, predicted


def _step(
    information: np.ndarray, slope: np.ndarray, damping: float, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, float]:
    size = np.sqrt(np.maximum(np.abs(np.diag(information)), 1e-300))
    # Rounding may make the information negative in a direction that the data hardly determine.
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    values = np.maximum(values, MIN_EIGENVALUE_RATIO)
    curvature = (vectors * values) @ vectors.T * np.outer(size, size)
    low, high = lower * size, upper * size
    step = vectors @ (vectors.T @ (slope / size) / (values + damping))
    if np.any(step < low) or np.any(step > high):
        step = least_within((vectors * (values + damping)) @ vectors.T, slope / size, low, high)
    step = step / size
    return step, float(2.0 * slope @ step - step @ curvature @ step)


def least_within(curvature: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Minimum of x^T C x/2 - b^T x with low <= x <= high, for a positive definite C.

    Block principal pivoting (Judice & Pires, Computers & Operations Research 21(5), 587-596, 1994): all unknowns whose
    bound is wrong change sides at once, which takes a few steps for hundreds of unknowns. Where that does not make them
    fewer, an interior-point method takes over (SciPy's bounded-variable least squares ends far from the minimum where
    C is nearly singular, and takes minutes for hundreds of unknowns).

    Parameters
    ----------
    curvature : (p, p) array
        C.
    slope : (p,) array
        b.
    low, high : (p,) array
        Bounds, which may be infinite or equal.
    """
    movable, fewest, fails = low < high, len(slope) + 1, 0
    side = np.where(movable, 0, -1)  # 0: between the bounds, -1: at the lower one, 1: at the upper one
    while fails < MAX_BLOCK_STEPS:
        free = side == 0
        x = np.where(side > 0, high, low)
        loads = slope[free] - curvature[np.ix_(free, ~free)] @ x[~free]
        x[free] = np.linalg.solve(curvature[np.ix_(free, free)], loads)
        pull = slope - curvature @ x
        inside, outside = np.where(x > high, 1, np.where(x < low, -1, 0)), np.where(pull * side < 0, 0, side)
        new = np.where(movable, np.where(free, inside, outside), -1)
        wrong = np.count_nonzero(new != side)
        if not wrong:
            return x
        fails = 0 if wrong < fewest else fails + 1
        side, fewest = new, min(fewest, wrong)
    return _interior_point(curvature, slope, low, high)


def _interior_point(curvature: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    import cvxpy as cp

    unit = np.max(np.abs(slope))
    low, high, y = low / unit, high / unit, cp.Variable(len(slope))
    cost = cp.quad_form(y, cp.psd_wrap(curvature)) / 2 - (slope / unit) @ y
    below, above = np.isfinite(low), np.isfinite(high)
    limits: list[cp.Constraint] = [y[below] >= low[below], y[above] <= high[above]]
    tolerances = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), SOLVER_TOLERANCE)
    with warnings.catch_warnings(), contextlib.suppress(cp.SolverError):
        warnings.filterwarnings("ignore", "Solution may be inaccurate", UserWarning)
        cp.Problem(cp.Minimize(cost), limits).solve(solver=cp.CLARABEL, **tolerances)
    if y.value is None:
        raise np.linalg.LinAlgError("no step was found within the bounds")
    return np.clip(y.value, low, high) * unit
