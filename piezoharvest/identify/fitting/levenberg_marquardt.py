"""Levenberg-Marquardt with bounds on the likelihood of all records."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import lsq_linear

from piezoharvest.description.parameters import ParameterError
from piezoharvest.identify.fitting.evaluation import sums_of, total_information, whiteners
from piezoharvest.identify.fitting.likelihood import Sums, Whitener
from piezoharvest.identify.fitting.measured_responses import FrequencyData, ResponseWeights
from piezoharvest.identify.fitting.model import Model, inner_values, with_values
from piezoharvest.identify.fitting.problem import Problem, prior_of
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.predict.prediction import PredictionError

MAX_ITERATIONS = 60  # most iterations
NOT_CONVERGED = "too many iterations"  # message of a descent that has not converged
ROUGH_TOLERANCE = 1e-3  # of the cost: predicted decrease at which a rough descent ends
RELATIVE_TOLERANCE = 1e-5  # the same for any other, relative to the cost above that of noise
MAX_SMALL_DECREASES = 2  # iterations in a row with a decrease below the limit, after which the descent ends
MIN_GAIN_RATIO = (
    0.9  # least ratio of actual to predicted decrease; with less, or as much more, the curvature is updated
)
RIPPLE_FACTOR = 10.0  # times the limit: predicted decrease below which a failed step counts as converged
# Iterations from which the rate of a descent is estimated, and for which it is extrapolated.
RATE_ITERATIONS = 8
EXTRAPOLATED_ITERATIONS = 10
RATE_PREDICTIONS = 3  # predicted decreases used for the same, except after failed steps, which are damped
MAX_LOG_STEP = 0.5  # largest step of a logarithm: parameters that the data hardly determine must not diverge
ROUGH_INITIAL_DAMPING, INITIAL_DAMPING = 1e-4, 1e-6  # initial damping of a rough fit, and of one that continues from it
MIN_EIGENVALUE_RATIO = 1e-12  # relative eigenvalue of an information matrix
MIN_DAMPING = 1e-12  # least damping
MAX_DAMPING_REDUCTIONS = 4  # most reductions of the damping in a row without a gain
MAX_RETURN_STEPS = 2  # most steps back to the bottom of a valley

Whiteners: TypeAlias = tuple[Whitener | ResponseWeights, ...]


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    model : Model
    own : tuple of (o,) array
        Nuisance parameters of each record: initial states, jumps and offsets.
    noise : Noise
    cost : float
        -2 ln L up to a constant: squares of the residuals, whitened by the model itself, and of the priors.
    sums : tuple of Sums
        For each record at the solution.
    information, prior : (p, p) array
        Of all parameters, those of the records after those of the model.
    white : tuple of Whitener or ResponseWeights
        Whitener of each record's residuals.
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
    white: Whiteners
    converged: bool
    iterations: int
    message: str


def descend(
    problem: Problem, model: Model, own: Sequence[np.ndarray], noise: Noise, tell: Callable[[str], None],
    *, white: Whiteners | None, loose: bool, enough: float, aim: float, most: int,
) -> Fit:  # fmt: skip
    """Levenberg-Marquardt with bounds, from a model and the records' nuisance parameters.

    Parameters
    ----------
    problem : Problem
    model : Model
    own : sequence of (o,) array
    noise : Noise
        Fixed during the descent.
    tell : callable
        Called with a message for every successful iteration.
    white : tuple of Whitener or ResponseWeights, optional
        Kept to the end. By default they are computed from the model at the start, and again at the end.
    loose : bool
        A rough descent, as long as unknown noise of a drive is filtered by a model that is not fitted yet.
    enough : float
        Predicted decrease of -2 ln L at which any other descent ends.
    aim : float
        Value of -2 ln L: a descent that will not reach it at its present rate is stopped.
    most : int
        Most iterations.
    """
    limits = problem.own_limits(model)
    lower = np.concatenate([[p.lower for p in model.parameters], -limits])
    upper = np.concatenate([[p.upper for p in model.parameters], limits])
    leap = np.array(
        [MAX_LOG_STEP if p.scaling == "log" else np.inf for p in model.parameters] + [np.inf] * sum(map(len, own))
    )
    delaying = np.array([p.path[-1] == "damping" for p in model.parameters] + [False] * sum(map(len, own)))
    mean, precision = prior_of(problem, model)
    judge = _CostFunction(problem, white or whiteners(problem, model, own, noise), mean, precision)
    here = judge.at(model, own, np.concatenate([inner_values(model), *own]))
    damping, converged, message = ROUGH_INITIAL_DAMPING if loose else INITIAL_DAMPING, False, NOT_CONVERGED
    iteration, quiet, reliefs, bend = 0, 0, 0, np.zeros_like(here.information)
    costs, hopes, rejected = [here.cost], list[float](), False
    count = sum(float(part.count.sum()) for part in here.sums)
    # Responses have no corners that would make the cost uneven: a predicted decrease is achieved there.
    smooth = all(isinstance(data, FrequencyData) for data in problem.data)
    for iteration in range(1, most + 1):
        values = here.values
        step, promise = _step(
            here.information + np.diag(precision) + bend, here.slope, damping,
            np.maximum(lower - values, -leap), np.minimum(upper - values, leap), np.diag(here.information) != 0.0,
        )  # fmt: skip
        limit = (
            max(1.0, ROUGH_TOLERANCE * here.squares)
            if loose
            else max(enough, RELATIVE_TOLERANCE * (here.squares - count))
        )
        if smooth and promise < limit and damping > MIN_DAMPING and reliefs < MAX_DAMPING_REDUCTIONS:
            damping, reliefs = max(1e-3 * damping, MIN_DAMPING), reliefs + 1  # the damping may be the reason
            continue
        if promise < limit or quiet == MAX_SMALL_DECREASES:
            converged, message = True, "converged"
            break
        hopes += [] if rejected else [promise]
        # Linear in the values, not their logarithms: damping that compensates a delay is linear in the delay.
        step = np.where(delaying, np.log1p(np.maximum(step, np.expm1(-MAX_LOG_STEP))), step)
        there = judge.tried(here, np.clip(values + step, lower, upper))
        if smooth and there is not None and there.cost >= here.cost:
            there = _return_to_valley(judge, there, 100.0 * damping, lower, upper, leap, here.cost)
        if there is not None and there.cost < here.cost:
            gained = (here.cost - there.cost) / promise
            quiet = quiet + 1 if here.cost - there.cost < limit else 0
            if gained < MIN_GAIN_RATIO:
                gone = there.values - values
                bend = _updated_correction(bend, there.information + np.diag(precision), gone, here.slope - there.slope)
            elif gained > 1.0 / MIN_GAIN_RATIO:
                bend = np.zeros_like(bend)  # from an earlier point: it only makes steps too short here
            here, reliefs = there, 0
            # After a rejected step, the damping is not reduced.
            relief = 1.0 if rejected else 0.1
            damping = max(damping * (relief if gained > 0.5 else 1.0 if gained > 0.1 else 4.0), MIN_DAMPING)
            rejected = False
            tell(f"iteration {iteration}: {here.cost:.6g}")
        else:
            # Corners of the operators make the cost uneven, so that small predicted decreases are not achieved.
            quiet = quiet + 1 if promise < RIPPLE_FACTOR * limit else 0
            damping, rejected = max((100.0 if rejected else 10.0) * damping, 1e-6), True
            if damping > 1e10:
                message = "no step improves the fit"
                converged = promise < 1.0
                break
        costs.append(here.cost)
        if here.cost - EXTRAPOLATED_ITERATIONS * _expected_decrease(costs, hopes) > aim:
            message = "given up: it would not come to what others have reached"
            break
    if not loose:
        judge, here = judge.in_the_end(here, white, noise)
    return Fit(
        here.model, here.own, noise, here.cost, here.sums, here.information, np.diag(precision), judge.white,
        converged, iteration, message,
    )  # fmt: skip


def _return_to_valley(
    judge: _CostFunction,
    there: _Point,
    damping: float,
    lower: np.ndarray,
    upper: np.ndarray,
    leap: np.ndarray,
    cost: float,
) -> _Point:
    """Return from the end of a straight step to the bottom of a curved valley of the cost.

    The effect of a circuit on a sharp resonance can be exchanged for damping and stiffness along a curved valley whose
    sides are 1e10 times as steep as its bottom. With more damping, a step only goes down the side.
    """
    for _ in range(MAX_RETURN_STEPS):
        values = there.values
        information = there.information + np.diag(judge.precision)
        alive = np.diag(there.information) != 0.0
        low, high = np.maximum(lower - values, -leap), np.minimum(upper - values, leap)
        step, _ = _step(information, there.slope, damping, low, high, alive)
        lower_still = judge.tried(there, np.clip(values + step, lower, upper))
        if lower_still is None or lower_still.cost >= there.cost:
            break
        there = lower_still
        if there.cost < cost:
            break
    return there


class _Point(NamedTuple):
    """A point of the descent: the variables as one array, and the cost with its derivatives there.

    The slope is the negative gradient of half the cost.
    """

    model: Model
    own: tuple[np.ndarray, ...]
    values: np.ndarray
    sums: tuple[Sums, ...]
    information: np.ndarray
    slope: np.ndarray
    squares: float
    cost: float


class _CostFunction:
    """Cost of a model by records and priors, with fixed whiteners."""

    def __init__(self, problem: Problem, white: Whiteners, mean: np.ndarray, precision: np.ndarray) -> None:
        self.problem, self.white, self.mean, self.precision = problem, white, mean, precision

    def at(self, model: Model, own: Sequence[np.ndarray], values: np.ndarray, scatter: bool = False) -> _Point:
        """Evaluate a model."""
        return self._judged(model, own, values, sums_of(self.problem, model, own, self.white, scatter))

    def tried(self, here: _Point, values: np.ndarray) -> _Point | None:
        """Evaluate a model with other values; None if the records cannot be predicted with them."""
        try:
            model = with_values(here.model, values[: len(here.model.parameters)])
            return self.at(model, _split(values, model, here.own), values)
        except (PredictionError, ParameterError, np.linalg.LinAlgError, ArithmeticError):
            return None

    def in_the_end(self, here: _Point, white: Whiteners | None, noise: Noise) -> tuple[_CostFunction, _Point]:
        """Evaluate the final point with its scatter, with the given whiteners or those of its own model."""
        white = white or whiteners(self.problem, here.model, here.own, noise)
        judge = _CostFunction(self.problem, white, self.mean, self.precision)
        return judge, judge.at(here.model, here.own, here.values, scatter=True)

    def _judged(self, model: Model, own: Sequence[np.ndarray], values: np.ndarray, sums: tuple[Sums, ...]) -> _Point:
        information, gradient, squares = total_information(model, own, sums)
        away = values - self.mean
        cost = squares + float(self.precision @ away**2)
        return _Point(model, tuple(own), values, sums, information, gradient - self.precision * away, squares, cost)


def _expected_decrease(costs: Sequence[float], hopes: Sequence[float]) -> float:
    """Expected decrease of the cost per iteration, from the costs so far and the predicted decreases."""
    gained = (costs[-1 - RATE_ITERATIONS] - costs[-1]) / RATE_ITERATIONS if len(costs) > RATE_ITERATIONS else np.inf
    return min(gained, max(hopes[-RATE_PREDICTIONS:]) if len(hopes) >= RATE_PREDICTIONS else np.inf)


def _updated_correction(bend: np.ndarray, information: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Correction of the information to the curvature of the cost, from the change of the slope over a step.

    A secant of rank one (Dennis, Gay & Welsch, ACM Transactions on Mathematical Software 7(3), 348-368, 1981, on why:
    without it, steps are too long if the noise that a model filters depends on the parameters). It is only added:
    the curvature stays positive.
    """
    miss = change - (information + bend) @ step
    along = float(miss @ step)
    return bend + np.outer(miss, miss) / along if along > 0 else bend


def _split(values: np.ndarray, model: Model, own: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    ends = np.cumsum([len(model.parameters), *(len(mine) for mine in own)])
    return tuple(values[begin:end] for begin, end in itertools.pairwise(ends))


def _step(information, slope, damping, lower, upper, alive) -> tuple[np.ndarray, float]:
    """Step within bounds, and the predicted decrease of the cost; variables that are not `alive` are fixed."""
    step = np.zeros(len(slope))
    step[alive], promise = _bounded_step(
        information[np.ix_(alive, alive)], slope[alive], damping, lower[alive], upper[alive]
    )
    return step, promise


def _bounded_step(information, slope, damping, lower, upper) -> tuple[np.ndarray, float]:
    """Step within bounds, and the predicted decrease of the cost."""
    size = np.sqrt(np.maximum(np.abs(np.diag(information)), 1e-300))
    # Rounding may make the information negative in a direction that the data hardly determine.
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    values = np.maximum(values, MIN_EIGENVALUE_RATIO)
    curvature = (vectors * values) @ vectors.T * np.outer(size, size)
    factor = np.linalg.cholesky((vectors * (values + damping)) @ vectors.T)
    right = np.linalg.solve(factor, slope / size)
    low, high = lower * size, upper * size
    step = np.linalg.solve(factor.T, right)
    if np.any(step < low) or np.any(step > high):
        free = low < high
        bounds = np.where(free, low, -1e-300), np.where(free, high, 1e-300)
        step = lsq_linear(factor.T, right, bounds, "bvls", 1e-12).x
    step = step / size
    return step, float(2.0 * slope @ step - step @ curvature @ step)
