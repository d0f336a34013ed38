"""Levenberg-Marquardt with bounds on the likelihood of all records."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import lsq_linear

from piezoharvest.description.parameters import ParameterError
from piezoharvest.identify.fitting.evaluation import sums_of, whiteners, whole
from piezoharvest.identify.fitting.likelihood import Sums, Whitener
from piezoharvest.identify.fitting.measured_responses import FrequencyData, ResponseWeights
from piezoharvest.identify.fitting.model import Model, inner_values, moved
from piezoharvest.identify.fitting.problem import Problem, prior_of
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.predict.prediction import PredictionError

ITERATIONS = 60  # at most
UNFINISHED = "too many iterations"  # message of a descent that was still on its way
ROUGH = 1e-3  # of the cost, that an iteration of a rough descent may still promise at its end
FINE = 1e-5  # the same for any other, of the cost above that of noise
QUIET = 2  # iterations in a row that gain less than is enough, after which no more is hoped for
HELD = 0.9  # share of what it promised that a step holds; with less, or as much more, the curvature is looked at
RIPPLE = 10.0  # times what is enough, which a step may promise in vain
PACE, AHEAD = 8, 10  # iterations that tell the pace of a descent, and for how many more it is trusted
HOPES = 3  # iterations whose promises tell the same, of those that no failed step has damped
LEAP = 0.5  # of a logarithm in one iteration: what the data hardly shows must not run away meanwhile
FAR, NEAR = 1e-4, 1e-6  # damping at first, of a rough fit and of one that goes on from there
LEAST = 1e-12  # relative eigenvalue of an information matrix
UNDAMPED = 1e-12  # the least damping
RELIEFS = 4  # times that damping is taken away in vain
RETURNS = 2  # steps back to the bottom of a valley

White: TypeAlias = tuple[Whitener | ResponseWeights, ...]


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
    white : tuple of Whitener or ResponseWeights
        For each record what made its residuals white.
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
    white: White
    converged: bool
    iterations: int
    message: str


def descend(
    problem: Problem, model: Model, own: Sequence[np.ndarray], noise: Noise, tell: Callable[[str], None],
    *, white: White | None, loose: bool, enough: float, aim: float, most: int,
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
    white : tuple of Whitener or ResponseWeights, optional
        Kept to the end. Without them the model's own way makes residuals white: at the start, and again at the end.
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
    delaying = np.array([p.path[-1] == "damping" for p in model.parameters] + [False] * sum(map(len, own)))
    mean, precision = prior_of(problem, model)
    judge = _Judge(problem, white or whiteners(problem, model, own, noise), mean, precision)
    here = judge.at(model, own, np.concatenate([inner_values(model), *own]))
    damping, converged, message = FAR if loose else NEAR, False, UNFINISHED
    iteration, quiet, reliefs, bend = 0, 0, 0, np.zeros_like(here.information)
    costs, hopes, rejected = [here.cost], list[float](), False
    count = sum(float(part.count.sum()) for part in here.sums)
    # Responses have no corners that would leave ripples in the cost: what a step promises there, it holds.
    smooth = all(isinstance(data, FrequencyData) for data in problem.data)
    for iteration in range(1, most + 1):
        values = here.values
        step, promise = _step(
            here.information + np.diag(precision) + bend, here.slope, damping,
            np.maximum(lower - values, -leap), np.minimum(upper - values, leap), np.diag(here.information) != 0.0,
        )  # fmt: skip
        limit = max(1.0, ROUGH * here.squares) if loose else max(enough, FINE * (here.squares - count))
        if smooth and promise < limit and damping > UNDAMPED and reliefs < RELIEFS:
            damping, reliefs = max(1e-3 * damping, UNDAMPED), reliefs + 1  # it may be this that promises so little
            continue
        if promise < limit or quiet == QUIET:
            converged, message = True, "converged"
            break
        hopes += [] if rejected else [promise]
        # Along the values, not their logarithms: what stands in for a delay follows that on a straight line.
        step = np.where(delaying, np.log1p(np.maximum(step, np.expm1(-LEAP))), step)
        there = judge.tried(here, np.clip(values + step, lower, upper))
        if smooth and there is not None and there.cost >= here.cost:
            there = _back_in_the_valley(judge, there, 100.0 * damping, lower, upper, leap, here.cost)
        if there is not None and there.cost < here.cost:
            gained = (here.cost - there.cost) / promise
            quiet = quiet + 1 if here.cost - there.cost < limit else 0
            if gained < HELD:
                gone = there.values - values
                bend = _bent(bend, there.information + np.diag(precision), gone, here.slope - there.slope)
            elif gained > 1.0 / HELD:
                bend = np.zeros_like(bend)  # of a place that is left behind: it only makes steps too short here
            here, reliefs = there, 0
            # What was too little damping a moment ago is so still.
            relief = 1.0 if rejected else 0.1
            damping = max(damping * (relief if gained > 0.5 else 1.0 if gained > 0.1 else 4.0), UNDAMPED)
            rejected = False
            tell(f"iteration {iteration}: {here.cost:.6g}")
        else:
            # Corners of the operators leave ripples in the cost, below which no step keeps what it promises.
            quiet = quiet + 1 if promise < RIPPLE * limit else 0
            damping, rejected = max((100.0 if rejected else 10.0) * damping, 1e-6), True
            if damping > 1e10:
                message = "no step improves the fit"
                converged = promise < 1.0
                break
        costs.append(here.cost)
        if here.cost - AHEAD * _pace(costs, hopes) > aim:
            message = "given up: it would not come to what others have reached"
            break
    if not loose:
        judge, here = judge.in_the_end(here, white, noise)
    return Fit(
        here.model, here.own, noise, here.cost, here.sums, here.information, np.diag(precision), judge.white,
        converged, iteration, message,
    )  # fmt: skip


def _back_in_the_valley(
    judge: _Judge,
    there: _Place,
    damping: float,
    lower: np.ndarray,
    upper: np.ndarray,
    leap: np.ndarray,
    cost: float,
) -> _Place:
    """From a place that a straight step has come to, back to the bottom of a valley that bends.

    What circuits make of a sharp resonance can be exchanged for damping and stiffness along a bend whose sides are 1e10
    times as steep as its bottom. With more damping a step goes down the side alone.
    """
    for _ in range(RETURNS):
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


class _Place(NamedTuple):
    """A model on its way: what varies as one array, and what the records say there.

    The slope is that of half the cost, downwards.
    """

    model: Model
    own: tuple[np.ndarray, ...]
    values: np.ndarray
    sums: tuple[Sums, ...]
    information: np.ndarray
    slope: np.ndarray
    squares: float
    cost: float


class _Judge:
    """What records and priors say of a model, whitened by one that stays as it is."""

    def __init__(self, problem: Problem, white: White, mean: np.ndarray, precision: np.ndarray) -> None:
        self.problem, self.white, self.mean, self.precision = problem, white, mean, precision

    def at(self, model: Model, own: Sequence[np.ndarray], values: np.ndarray, scatter: bool = False) -> _Place:
        """Judge a model."""
        return self._judged(model, own, values, sums_of(self.problem, model, own, self.white, scatter))

    def tried(self, here: _Place, values: np.ndarray) -> _Place | None:
        """Judge a model with other values, which it may not be able to follow the records with."""
        try:
            model = moved(here.model, values[: len(here.model.parameters)])
            return self.at(model, _split(values, model, here.own), values)
        except (PredictionError, ParameterError, np.linalg.LinAlgError, ArithmeticError):
            return None

    def in_the_end(self, here: _Place, white: White | None, noise: Noise) -> tuple[_Judge, _Place]:
        """The same place with its scatter, of residuals that these whiteners make white, or else its own way does."""
        white = white or whiteners(self.problem, here.model, here.own, noise)
        judge = _Judge(self.problem, white, self.mean, self.precision)
        return judge, judge.at(here.model, here.own, here.values, scatter=True)

    def _judged(self, model: Model, own: Sequence[np.ndarray], values: np.ndarray, sums: tuple[Sums, ...]) -> _Place:
        information, gradient, squares = whole(model, own, sums)
        away = values - self.mean
        cost = squares + float(self.precision @ away**2)
        return _Place(model, tuple(own), values, sums, information, gradient - self.precision * away, squares, cost)


def _pace(costs: Sequence[float], hopes: Sequence[float]) -> float:
    """By how much an iteration may be expected to lower the cost, after those so far and what they promised."""
    gained = (costs[-1 - PACE] - costs[-1]) / PACE if len(costs) > PACE else np.inf
    return min(gained, max(hopes[-HOPES:]) if len(hopes) >= HOPES else np.inf)


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
    # Rounding may take the information in a direction that the data hardly shows below zero.
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    values = np.maximum(values, LEAST)
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
