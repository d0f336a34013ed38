"""Levenberg-Marquardt with bounds on the likelihood of all records."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from piezoharvest.identify.evaluation import sums_of, whiteners, whole
from piezoharvest.identify.model import Model, inner_values, moved
from piezoharvest.identify.noise import Noise
from piezoharvest.identify.problem import Problem, prior_of
from piezoharvest.identify.sums import Sums
from piezoharvest.parameters import ParameterError
from piezoharvest.predict.prediction import PredictionError

ITERATIONS = 60  # at most
UNFINISHED = "too many iterations"  # message of a descent that was still on its way
ROUGH = 1e-3  # of the cost, that an iteration of a rough descent may still promise at its end
FINE = 1e-5  # the same for any other, of the cost above that of noise
QUIET = 2  # iterations in a row that gain less than is enough, after which no more is hoped for
HELD = 0.9  # share of what it promised that a step holds; with less, or as much more, the curvature is looked at
RIPPLE = 10.0  # times what is enough, which a step may promise in vain
PACE, AHEAD = 8, 10  # iterations that tell the pace of a descent, and for how many more it is trusted
LEAP = 0.5  # of a logarithm in one iteration: what the data hardly shows must not run away meanwhile
FAR, NEAR = 1e-4, 1e-6  # damping at first, of a rough fit and of one that goes on from there
LEAST = 1e-12  # relative eigenvalue of an information matrix


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    model : Model
    own : tuple of (o,) array
        For each record its states at the start, jumps and offsets.
    noise : Noise
    cost : float
        -2 ln L but for a constant: squares of the residuals, whitened by the model itself, and of the priors.
    sums : tuple of Sums
        For each record at the solution.
    information, prior : (p, p) array
        Of all parameters, those of the records behind those of the model.
    converged : bool
    iterations : int
    message : str
    """

    model: Model
    own: tuple[np.ndarray, ...]
    noise: Noise
    cost: float
    sums: tuple[Sums, ...]
    information: np.ndarray
    prior: np.ndarray
    converged: bool
    iterations: int
    message: str


def descend(
    problem: Problem, model: Model, own: Sequence[np.ndarray], noise: Noise, tell: Callable[[str], None],
    *, loose: bool, enough: float, aim: float, most: int,
) -> Fit:  # fmt: skip
    """Levenberg-Marquardt with bounds, from a model and the records' own numbers.

    Parameters
    ----------
    problem : Problem
    model : Model
    own : sequence of (o,) array
    noise : Noise
        As it is throughout.
    tell : callable
        Told about every iteration that gains.
    loose : bool
        A rough descent: the noise of a drive that is not known is passed on by a model that is not fitted yet.
    enough : float
        Of -2 ln L that an iteration may still promise at the end of any other.
    aim : float
        Of -2 ln L: a descent that at its pace will not come to this is given up.
    most : int
        Iterations.
    """
    limits = problem.own_limits(model)
    lower = np.concatenate([[p.lower for p in model.parameters], -limits])
    upper = np.concatenate([[p.upper for p in model.parameters], limits])
    leap = np.array([LEAP if p.scaling == "log" else np.inf for p in model.parameters] + [np.inf] * sum(map(len, own)))
    mean, precision = prior_of(problem, model, own)
    values = np.concatenate([inner_values(model), *own])
    white = whiteners(problem, model, noise, rough=loose)
    sums = sums_of(problem, model, own, white, scatter=not loose)
    information, gradient, squares = whole(model, own, sums)
    cost = squares + float(precision @ (values - mean) ** 2)
    damping, converged, message = FAR if loose else NEAR, False, UNFINISHED
    iteration, quiet, first, bend = 0, 0, model, np.zeros_like(information)
    costs, rejected, count = [cost], False, sum(float(part.count.sum()) for part in sums)
    for iteration in range(1, most + 1):
        total = information + np.diag(precision) + bend
        slope = gradient - precision * (values - mean)
        shown = _shown(information, precision, sums, len(model.parameters))
        step, promise = _step(
            total, slope, damping, np.maximum(lower - values, -leap), np.minimum(upper - values, leap), shown
        )
        limit = max(1.0, ROUGH * squares) if loose else max(enough, FINE * (squares - count))
        if promise < limit:
            converged, message = True, "converged"
            break
        trial = values + step
        try:
            new_model, new_own = moved(model, trial[: len(model.parameters)]), _split(trial, model, own)
            new_sums = sums_of(problem, new_model, new_own, white)
            new_information, new_gradient, squares = whole(new_model, new_own, new_sums)
            new_cost = squares + float(precision @ (trial - mean) ** 2)
        except (PredictionError, ParameterError, np.linalg.LinAlgError, OverflowError):
            new_cost = np.inf
        if new_cost < cost:
            gained = (cost - new_cost) / promise
            quiet = quiet + 1 if cost - new_cost < limit else 0
            model, own, sums, values, cost = new_model, new_own, new_sums, trial, new_cost
            information, gradient = new_information, new_gradient
            if gained < HELD:
                change = slope - (gradient - precision * (values - mean))
                bend = _bent(bend, information + np.diag(precision), step, change)
            elif gained > 1.0 / HELD:
                bend = np.zeros_like(information)  # of a place that is left behind: it only makes steps too short here
            # What was too little damping a moment ago is so still.
            relief = 1.0 if rejected else 0.1
            damping = max(damping * (relief if gained > 0.5 else 1.0 if gained > 0.1 else 4.0), 1e-12)
            rejected = False
            tell(f"iteration {iteration}: {cost:.6g}")
        else:
            # Corners of the operators leave ripples in the cost, below which no step keeps what it promises.
            quiet = quiet + 1 if promise < RIPPLE * limit else 0
            damping, rejected = max((100.0 if rejected else 10.0) * damping, 1e-6), True
            if damping > 1e10:
                message = "no step improves the fit"
                converged = promise < 1.0
                break
        if quiet == QUIET:
            converged, message = True, "converged"
            break
        costs.append(cost)
        if len(costs) > PACE and cost - AHEAD * (costs[-1 - PACE] - cost) / PACE > aim:
            message = "given up: it would not come to what others have reached"
            break
    if not loose and model is not first:
        # Models pass on the noise of the drive in their own ways: each is judged by residuals that its own way makes
        # white.
        sums = sums_of(problem, model, own, whiteners(problem, model, noise), scatter=True)
        information, _, squares = whole(model, own, sums)
        cost = squares + float(precision @ (values - mean) ** 2)
    return Fit(model, tuple(own), noise, cost, sums, information, np.diag(precision), converged, iteration, message)


def _shown(information: np.ndarray, precision: np.ndarray, sums: Sequence[Sums], p: int) -> np.ndarray:
    """Whether the records show a parameter better than its prior does, each for itself.

    What the noise of the drive adds to the products of the derivatives says nothing about a parameter, but scatters the
    slope: pushed by that, one that nothing else tells would run away.
    """
    own, noisy = np.diag(information).copy(), np.zeros(len(precision))
    noisy[:p] = sum(np.diag(part.noisy.sum(axis=0))[:p] for part in sums)
    return (own != 0.0) & ((own > 0.0) & (own**2 >= precision * (own + noisy)) | (noisy == 0.0))


def _bent(bend: np.ndarray, information: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """What the curvature of the cost has beyond the information, as the change of the slope over a step shows it.

    A secant of rank one (Dennis, Gay & Welsch, ACM Transactions on Mathematical Software 7(3), 348-368, 1981, on why:
    without it steps are too long where the noise that a model passes on depends on the parameters). It is only added:
    the curvature stays that of a minimum.
    """
    miss = change - (information + bend) @ step
    along = float(miss @ step)
    return bend + np.outer(miss, miss) / along if along > 0 else bend


def _split(values: np.ndarray, model: Model, own: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    ends = np.cumsum([len(model.parameters), *(len(mine) for mine in own)])
    return tuple(values[begin:end] for begin, end in itertools.pairwise(ends))


def _step(information, slope, damping, lower, upper, alive) -> tuple[np.ndarray, float]:
    """Step within bounds, and by how much it should lower the cost; what is not `alive` stays as it is."""
    step = np.zeros(len(slope))
    step[alive], promise = _bounded_step(
        information[np.ix_(alive, alive)], slope[alive], damping, lower[alive], upper[alive]
    )
    return step, promise


def _bounded_step(information, slope, damping, lower, upper) -> tuple[np.ndarray, float]:
    """Step within bounds, and by how much it should lower the cost."""
    size = np.sqrt(np.maximum(np.abs(np.diag(information)), 1e-300))
    # Without what the noise of the drive adds, the information in a direction that the data hardly shows may come out
    # negative.
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    values = np.maximum(values, LEAST)
    curvature = (vectors * values) @ vectors.T * np.outer(size, size)
    factor = np.linalg.cholesky((vectors * (values + damping)) @ vectors.T)
    right = np.linalg.solve(factor, slope / size)
    low, high = lower * size, upper * size
    step = np.linalg.solve(factor.T, right)
    if np.any(step < low) or np.any(step > high):
        free = low < high
        step = lsq_linear(factor.T, right, (np.where(free, low, -1e-300), np.where(free, high, 1e-300)), tol=1e-12).x
    step = step / size
    return step, float(2.0 * slope @ step - step @ curvature @ step)
