"""Tuning by simulation: a line search for one free part, gradient-based sequential quadratic programming for more.

One part takes 7 to 11 simulations in a bounded search and 5 to 9 gradients as the root of the derivative, each of which
takes as long as two to four simulations; from two parts on, gradients are cheaper. A simplex search is used where there
are none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import MARGIN, PENALTY
from piezoharvest.design.trial import Tangent, Trial
from piezoharvest.design.tuning.minimax import Tuned
from piezoharvest.design.tuning.region import Region, coordinates, values_at
from piezoharvest.design.tuning.starts import Start
from piezoharvest.progress import Stage

_WIDTH = np.log(2.5)  # half of the first bracket, in e-folds: the closed forms are within 20 %
_ROUGH_WIDTH = np.log(10.0)  # the same for an excitation that the closed forms are not derived for
_EXPANSIONS = 3
_EDGE_SHARE = 0.05  # of the bracket: an optimum this close to its end is sought beyond it
_ACCURACY = 1e-3  # of a part's logarithm; the merit is then flat to 1e-6
_TRUST_RADIUS, _ROUNDS = 3.0, 3  # e-folds about the start of a round
_DESCENT: dict[str, Any] = {"maxiter": 40, "ftol": 1e-8}
_SIMPLEX, _SIMPLEX_ACCURACY, _SIMPLEX_MERIT = 0.1, 5e-3, 1e-5
_MAX_STEPS = 60
_RESTARTS, _SIMPLEX_GAIN = 6, 5e-5  # of a simplex search: at most, and the merit that one more has to bring


def refine(trial: Trial, draft: Draft, start: Start, region: Region | None = None, stage: Stage | None = None) -> Tuned:
    """Tune the free parts of a shunt from one start by simulation, within a region where one is given.

    `stage` tells how far descents by the gradient are.
    """
    before, p = trial.simulations, coordinates({name: start.values[name] for name in draft.free})

    def shunt_at(p: np.ndarray) -> Shunt:
        return draft.with_values(values_at(draft.free, p if region is None else region.clip(p)))

    def merit(p: np.ndarray) -> float:
        return trial.merit(shunt_at(p))

    if region is None and len(p) > 1:
        p, method = simplex(merit, p), "simplex search with the simulator"
    elif region is None or len(p) == 1:
        width = _WIDTH if trial.view.operation.apart else _ROUGH_WIDTH
        p, method = _line(lambda x: merit(np.array([x])), float(p[0]), width), "line search with the simulator"
    else:
        found = _EngineProgram(trial, draft, region, stage).solve(p)
        p, method = found if found is not None else (simplex(merit, p), "simplex search with the simulator")
    return Tuned(shunt_at(p), merit(p), start.formula, method, trial.simulations - before)


@dataclass(frozen=True)
class _EngineProgram:
    """The nonlinear program on simulated figures.

    Variables are the logarithms p of the parts and the slack of each limit, penalised in the merit.
    """

    trial: Trial
    draft: Draft
    region: Region
    stage: Stage | None = None
    _steps: Iterator[int] = field(default_factory=lambda: count(1))

    def solve(self, start: np.ndarray) -> tuple[np.ndarray, str] | None:
        """Minimum near a start; None if the simulation has no derivatives on the way, or the program fails."""
        answer = None
        for _ in range(_ROUNDS):
            try:
                found = self._descend(start)
            except ArithmeticError:  # NoGradientError, or the simulation cannot go on
                break
            if not found.success:
                break
            p, _ = self._split(found.x)
            answer = p, "SLSQP with the gradient of the simulator"
            # On the edge of its reach is within it as often as not, by rounding.
            if np.all(np.abs(p - start) < _TRUST_RADIUS - _ACCURACY):
                break
            start = p
        return answer

    def _descend(self, start: np.ndarray) -> Any:
        """Minimum within a trust region about a start: linearised constraints mislead further away."""
        low, high = (
            np.maximum(self.region.lower, start - _TRUST_RADIUS),
            np.minimum(self.region.upper, start + _TRUST_RADIUS),
        )
        concessions = np.maximum(0.0, self._excess(start))
        bounds = [*zip(low, high, strict=True), *[(0.0, None)] * len(concessions)]
        constraints = {"type": "ineq", "fun": self._constraints, "jac": self._constraints_slope}
        return minimize(
            self._objective, np.append(start, concessions), jac=True, bounds=bounds, method="SLSQP",
            constraints=constraints if len(concessions) + len(self.region.coil) else (), options=_DESCENT,
            callback=self.stage and (lambda _: self._tell()),
        )  # fmt: skip

    def _tell(self) -> None:
        assert self.stage is not None
        self.stage.reached(next(self._steps), _ROUNDS * _DESCENT["maxiter"])

    def _tangent(self, p: np.ndarray) -> Tangent:
        return self.trial.tangent(self.draft.with_values(self.region.values(p)), self.draft.free, self.draft.tied)

    def _excess(self, p: np.ndarray) -> np.ndarray:
        return np.array(list(self.trial.view.goal.excess(self._tangent(p)[0]).values())) + MARGIN

    def _split(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return y[: len(self.draft.free)], y[len(self.draft.free) :]

    def _objective(self, y: np.ndarray) -> tuple[float, np.ndarray]:
        p, concessions = self._split(y)
        (figures, slopes), goal = self._tangent(p), self.trial.view.goal
        slope = np.append(goal.score_slope(slopes), np.full(len(concessions), PENALTY))
        return goal.score(figures) + PENALTY * float(np.sum(concessions)), slope

    def _constraints(self, y: np.ndarray) -> np.ndarray:
        """Constraints that have to be non-negative: distances to each limit, and to the coil quality."""
        p, concessions = self._split(y)
        return np.append(concessions - self._excess(p), self.region.coil @ p - self.region.offset)

    def _constraints_slope(self, y: np.ndarray) -> np.ndarray:
        p, concessions = self._split(y)
        slopes = -self.trial.view.goal.excess_slopes(self._tangent(p)[1])
        coil = np.pad(self.region.coil, ((0, 0), (0, len(concessions))))
        return np.vstack((np.hstack((slopes, np.eye(len(concessions)))), coil))


def _line(merit: Callable[[float], float], start: float, width: float) -> np.ndarray:
    """Minimum along a line by a bounded search; the bracket is moved while the optimum is at its edge."""
    centre, best, best_merit = start, start, merit(start)
    for _ in range(_EXPANSIONS):
        bounds = (centre - width, centre + width)
        found: Any = minimize_scalar(merit, bounds=bounds, method="bounded", options={"xatol": _ACCURACY})
        if found.fun < best_merit:
            best, best_merit = float(found.x), float(found.fun)
        if min(found.x - bounds[0], bounds[1] - found.x) > _EDGE_SHARE * width or found.x == centre:
            break
        centre, width = float(found.x), 2 * width
    return np.array([best])


def simplex(merit: Callable[[np.ndarray], float], start: np.ndarray, steps: int | None = None) -> np.ndarray:
    """Minimum near a good start, by simplex searches that begin anew where the last one ended.

    One alone collapses before the optimum where the merit has an edge, as where the periodic motion ends. With
    `steps` there is one search, of so many at most.
    """
    p, lowest, size = start, merit(start), _SIMPLEX
    for _ in range(_RESTARTS if steps is None else 1):
        corners = np.vstack((p, p + size * np.eye(len(p))))
        options = {
            "initial_simplex": corners, "xatol": _SIMPLEX_ACCURACY, "fatol": _SIMPLEX_MERIT,
            "maxfev": steps or _MAX_STEPS,
        }  # fmt: skip
        found: Any = minimize(merit, p, method="Nelder-Mead", options=options)
        gain = lowest - found.fun
        p, lowest, size = found.x, found.fun, -0.5 * size
        if gain < _SIMPLEX_GAIN:
            break
    return p
