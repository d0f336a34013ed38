"""Levenberg-Marquardt with bounds on the likelihood of all records."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from piezoharvest.identify.fitting.bounded_step import bounded_step
from piezoharvest.identify.fitting.cost_function import CostFunction, Point, Whiteners
from piezoharvest.identify.fitting.evaluation import scattered_sums, whiteners
from piezoharvest.identify.fitting.likelihood import Sums
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model, inner_values
from piezoharvest.identify.fitting.problem import Problem, prior_of, starting
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.progress import Iteration

MAX_ITERATIONS = 60  # most iterations
NOT_CONVERGED = "too many iterations"  # message of a descent that has not converged
GIVEN_UP = "given up: this fit would not become as good as the others"
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
MIN_DAMPING = 1e-12  # least damping
MAX_DAMPING_REDUCTIONS = 4  # most reductions of the damping in a row without a gain
# Mean square of whitened residuals up to which valleys are followed: a trial fit of an effect that explains all ends at
# one; from 1e5, where a law was missing, a base fit went along one to where no law was found any more.
NEAR_NOISE = 10.0
SHARES = (1.0, 0.3, 0.1)  # of a step, tried where the records cannot be predicted after the whole one
MAX_RETURN_STEPS = 2  # most steps back to the bottom of a valley


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    model : Model
    nuisance : tuple of (o,) array
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
    nuisance: tuple[np.ndarray, ...]
    noise: Noise
    cost: float
    sums: tuple[Sums, ...]
    information: np.ndarray
    prior: np.ndarray
    white: Whiteners
    converged: bool
    iterations: int
    message: str

    @cached_property
    def scattered(self) -> tuple[Sums, ...]:
        """`sums` with what else scatters the gradient, made when asked for: behind a switch that takes long."""
        return scattered_sums(self.model, self.nuisance, self.white)


def descend(
    problem: Problem, model: Model, nuisance: Sequence[np.ndarray], noise: Noise, progress: Callable[[str], None],
    *, white: Whiteners | None, loose: bool, enough: float, aim: float, most: int,
) -> Fit:  # fmt: skip
    """Levenberg-Marquardt with bounds, from a model and the records' nuisance parameters.

    Parameters
    ----------
    problem : Problem
    model : Model
    nuisance : sequence of (o,) array
    noise : Noise
        Fixed during the descent.
    progress : callable
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
    judge = CostFunction(problem, white or whiteners(problem, model, nuisance, noise), *prior_of(problem, model))
    start = judge.at(model, nuisance, np.concatenate([inner_values(model), *nuisance]))
    descent = _Descent(judge, _Bounds.of(problem, model, nuisance), start, loose, enough, aim)
    for _ in range(most):
        if descent.advance():
            progress(Iteration(f"misfit (-2 ln L) {descent.here.cost:.6g}"))
        if descent.ended:
            break
    here = descent.here
    if not loose and white is None:
        judge, here = judge.by_its_own(here, noise)
    return Fit(
        here.model, here.nuisance, noise, here.cost, here.sums, here.information, np.diag(judge.precision), judge.white,
        descent.converged, descent.iteration, descent.message,
    )  # fmt: skip


class _Bounds(NamedTuple):
    """Bounds of the variables, the largest step of each, and masks of two kinds of them.

    Damping that compensates a delay is linear in the delay. Where a record behind a switch begins decides whether the
    switch acts at once.
    """

    lower: np.ndarray
    upper: np.ndarray
    largest_step: np.ndarray
    delaying: np.ndarray
    starting: np.ndarray

    @classmethod
    def of(cls, problem: Problem, model: Model, nuisance: Sequence[np.ndarray]) -> _Bounds:
        limits = problem.nuisance_limits(model)
        others = sum(map(len, nuisance))
        return cls(
            np.concatenate([[p.lower for p in model.parameters], -limits]),
            np.concatenate([[p.upper for p in model.parameters], limits]),
            np.array([MAX_LOG_STEP if p.scaling == "log" else np.inf for p in model.parameters] + [np.inf] * others),
            np.array([p.path[-1] == "damping" for p in model.parameters] + [False] * others),
            np.concatenate([np.zeros(len(model.parameters), bool), *starting(problem, model)]),
        )

    def step(
        self, here: Point, information: np.ndarray, damping: float, *, held: np.ndarray | None = None
    ) -> tuple[np.ndarray, float]:
        """Step from a point, and the predicted decrease of the cost; variables of a mask may be held."""
        alive = np.diag(here.information) != 0.0
        low = np.maximum(self.lower - here.values, -self.largest_step)
        high = np.minimum(self.upper - here.values, self.largest_step)
        return bounded_step(information, here.slope, damping, low, high, alive if held is None else alive & ~held)

    def moved(self, values: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Values after a step, within the bounds."""
        return np.clip(values + step, self.lower, self.upper)


class _Descent:
    """State of a descent from iteration to iteration."""

    def __init__(
        self, judge: CostFunction, bounds: _Bounds, start: Point, loose: bool, enough: float, aim: float
    ) -> None:
        self.judge, self.bounds, self.here, self.loose, self.enough, self.aim = judge, bounds, start, loose, enough, aim
        self.damping = ROUGH_INITIAL_DAMPING if loose else INITIAL_DAMPING
        self.correction = np.zeros_like(start.information)  # of the information to the curvature of the cost
        self.count = sum(float(part.count.sum()) for part in start.sums)
        # A switch that acts once more makes the cost uneven, and what a model lacks bends it by more than its valleys.
        # Elsewhere a predicted decrease is achieved in the end.
        responses = all(isinstance(data, FrequencyData) for data in judge.problem.data)
        self.smooth = responses or (not judge.problem.needs_engine and start.squares < NEAR_NOISE * self.count)
        self.iteration, self.small_decreases, self.reductions, self.rejected = 0, 0, 0, False
        self.costs, self.predictions = [start.cost], list[float]()
        self.ended, self.converged, self.message = False, False, NOT_CONVERGED

    def advance(self) -> bool:
        """Carry out one iteration; True if its step decreases the cost."""
        self.iteration += 1
        here = self.here
        information = here.information + np.diag(self.judge.precision) + self.correction
        limit = self._limit()
        try:
            step, predicted = self.bounds.step(here, information, self.damping)
        except np.linalg.LinAlgError:
            self._reject(np.inf, limit)
            return False
        can_reduce = self.damping > MIN_DAMPING and self.reductions < MAX_DAMPING_REDUCTIONS
        if self.smooth and predicted < limit and can_reduce:
            # The damping may be the reason.
            self.damping, self.reductions = max(1e-3 * self.damping, MIN_DAMPING), self.reductions + 1
            return False
        if predicted < limit or self.small_decreases == MAX_SMALL_DECREASES:
            self._end("converged", True)
            return False
        self.predictions += [] if self.rejected else [predicted]
        there, predicted = self._predictable(step, predicted)
        better = there is not None and there.cost < here.cost
        if not better and np.any(self.bounds.starting):
            # A switch that acts once more or less at the very beginning changes the cost by any amount.
            step, without = self.bounds.step(here, information, self.damping, held=self.bounds.starting)
            there = self._tried(step) if without >= limit else None
            better = there is not None and there.cost < here.cost
            predicted = without if better else predicted
        if there is not None and better:
            self._accept(there, predicted, limit)
        else:
            self._reject(predicted, limit)
            if self.ended:
                return False
        self.costs.append(self.here.cost)
        if self.here.cost - EXTRAPOLATED_ITERATIONS * _expected_decrease(self.costs, self.predictions) > self.aim:
            self._end(GIVEN_UP, False)
        return better

    def _end(self, message: str, converged: bool) -> None:
        self.ended, self.message, self.converged = True, message, converged

    def _limit(self) -> float:
        """Predicted decrease at which the descent ends."""
        if self.loose:
            return max(1.0, ROUGH_TOLERANCE * self.here.squares)
        return max(self.enough, RELATIVE_TOLERANCE * (self.here.squares - self.count))

    def _predictable(self, step: np.ndarray, predicted: float) -> tuple[Point | None, float]:
        """Point after a step, or after a share of it where the records cannot be predicted at its end; its decrease.

        A law that leaves what is possible, as a charge that falls with the voltage, tells nothing of its direction.
        """
        for share in SHARES:
            there = self._tried(share * step)
            if there is not None:
                return there, share * (2.0 - share) * predicted
        return None, predicted

    def _tried(self, step: np.ndarray) -> Point | None:
        """Point after a step; None if the records cannot be predicted there."""
        # Linear in the values, not their logarithms.
        linear = np.log1p(np.maximum(step, np.expm1(-MAX_LOG_STEP)))
        step = np.where(self.bounds.delaying, linear, step)
        there = self.judge.tried(self.here, self.bounds.moved(self.here.values, step))
        if self.smooth and there is not None and there.cost >= self.here.cost:
            return _return_to_valley(self.judge, self.bounds, there, 100.0 * self.damping, self.here.cost)
        return there

    def _accept(self, there: Point, predicted: float, limit: float) -> None:
        """Go to a point of lower cost."""
        here = self.here
        gain_ratio = (here.cost - there.cost) / predicted
        self.small_decreases = self.small_decreases + 1 if here.cost - there.cost < limit else 0
        if gain_ratio < MIN_GAIN_RATIO:
            information = there.information + np.diag(self.judge.precision)
            step, change = there.values - here.values, here.slope - there.slope
            self.correction = _updated_correction(self.correction, information, step, change)
        elif gain_ratio > 1.0 / MIN_GAIN_RATIO:
            # From an earlier point: it only makes steps too short here.
            self.correction = np.zeros_like(self.correction)
        self.here, self.reductions = there, 0
        # After a rejected step, the damping is not reduced.
        factor = (1.0 if self.rejected else 0.1) if gain_ratio > 0.5 else 1.0 if gain_ratio > 0.1 else 4.0
        self.damping, self.rejected = max(self.damping * factor, MIN_DAMPING), False

    def _reject(self, predicted: float, limit: float) -> None:
        """Stay, with more damping."""
        # Corners of the operators make the cost uneven, so that small predicted decreases are not achieved.
        self.small_decreases = self.small_decreases + 1 if predicted < RIPPLE_FACTOR * limit else 0
        self.damping, self.rejected = max((100.0 if self.rejected else 10.0) * self.damping, 1e-6), True
        if self.damping > 1e10:
            self._end("no step improves the fit", predicted < 1.0)


def _return_to_valley(judge: CostFunction, bounds: _Bounds, there: Point, damping: float, cost: float) -> Point:
    """Return from the end of a straight step to the bottom of a curved valley of the cost.

    The effect of a circuit on a sharp resonance can be exchanged for damping and stiffness along a curved valley whose
    sides are 1e10 times as steep as its bottom, as can a leakage for coupling and capacitance beside one load. With
    more damping, a step only goes down the side.
    """
    for _ in range(MAX_RETURN_STEPS):
        step, _ = bounds.step(there, there.information + np.diag(judge.precision), damping)
        lower_still = judge.tried(there, bounds.moved(there.values, step))
        if lower_still is None or lower_still.cost >= there.cost:
            break
        there = lower_still
        if there.cost < cost:
            break
    return there


def _expected_decrease(costs: Sequence[float], predictions: Sequence[float]) -> float:
    """Expected decrease of the cost per iteration, from the costs so far and the predicted decreases."""
    gained = (costs[-1 - RATE_ITERATIONS] - costs[-1]) / RATE_ITERATIONS if len(costs) > RATE_ITERATIONS else np.inf
    return min(gained, max(predictions[-RATE_PREDICTIONS:]) if len(predictions) >= RATE_PREDICTIONS else np.inf)


def _updated_correction(
    correction: np.ndarray, information: np.ndarray, step: np.ndarray, change: np.ndarray
) -> np.ndarray:
    """Correction of the information to the curvature of the cost, from the change of the slope over a step.

    A secant of rank one (Dennis, Gay & Welsch, ACM Transactions on Mathematical Software 7(3), 348-368, 1981, on why:
    without it, steps are too long if the noise that a model filters depends on the parameters). It is only added:
    the curvature stays positive.
    """
    miss = change - (information + correction) @ step
    along = float(miss @ step)
    return correction + np.outer(miss, miss) / along if along > 0 else correction
