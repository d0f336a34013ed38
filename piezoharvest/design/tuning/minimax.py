"""Tuning of linear shunts: sequential quadratic programming on logarithms, in the smooth epigraph form.

Displacement is minimised as the smallest t with log |x(f)| <= t at every frequency of a set, to which the exact peaks
of each solution are added until none exceeds it (exchange method for semi-infinite programs, Hettich & Kortanek, SIAM
Review 35(3), 380-429, 1993). A view of several scenarios has as many powers, whose least is raised likewise. Limits are
constraints with one common penalised slack, so that an infeasible goal still has a solution: the one that violates it
least.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.optimize import minimize

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import MARGIN, PENALTY, Goal
from piezoharvest.design.linear_view import Levels
from piezoharvest.design.operation import Operation
from piezoharvest.design.tuning.region import Region
from piezoharvest.design.tuning.starts import Start
from piezoharvest.progress import Stage

_TRUST_RADIUS = 3.0  # e-folds about the start of a round
_STEP = 1e-5  # of central differences, in e-folds: the error of the gradient is 1e-10
_ROUNDS, _STEPS = 15, 100  # of the exchange at most, and of each program
_MOST = _ROUNDS * _STEPS
_PEAK_TOLERANCE = 1e-6


class MinimaxView(Protocol):
    """What the tuning asks of a `LinearView`, or of one for several scenarios side by side."""

    @property
    def goal(self) -> Goal:
        """Goal of the design."""
        ...

    @property
    def operation(self) -> Operation:
        """Operation of the design."""
        ...

    @property
    def shorted(self) -> float:
        """Displacement with shorted electrodes, m."""
        ...

    def levels(self, shunt: Shunt, grid: np.ndarray, *, power: bool) -> Levels:
        """Levels of a shunt, or a batch, on a grid in Hz; power has an axis more for several scenarios."""
        ...

    def grid(self, shunt: Shunt) -> np.ndarray:
        """Frequencies in Hz at which levels are largest."""
        ...

    def merit(self, shunt: Shunt) -> float:
        """Merit of a shunt, with exact peaks."""
        ...


class Tuned(NamedTuple):
    """Result of a tuning: the shunt, its merit, its start and the iterations."""

    shunt: Shunt
    merit: float
    start: str
    method: str
    iterations: int


def tune(view: MinimaxView, draft: Draft, start: Start, region: Region, stage: Stage | None = None) -> Tuned:
    """Tune the free parts of a linear shunt from one start, within a region; `stage` tells how far it is."""
    program = MinimaxProgram(view, draft, region)
    best = region.logs(start.values)
    best_merit, iterations = program.merit(best), 0
    program.widen(best)
    for _ in range(_ROUNDS):
        p, steps = program.solve(best, stage and (lambda n, before=iterations: stage.reached(before + n, _MOST)))
        iterations += steps
        merit = program.merit(p)
        done = not program.widen(p) and merit >= best_merit - _PEAK_TOLERANCE
        if merit < best_merit:
            best, best_merit = p, merit
        if done:
            break
    return Tuned(program.shunt(best), best_merit, start.formula, "SLSQP on the two-port", iterations)


@dataclass
class MinimaxProgram:
    """The nonlinear program on one set of frequencies.

    Variables are the logarithms p of the parts, the level t and the common slack s.
    """

    view: MinimaxView
    draft: Draft
    region: Region
    grid: np.ndarray = field(default_factory=lambda: np.empty(0))
    _at: tuple = (None, None, None)

    def shunt(self, p: np.ndarray) -> Shunt:
        """The draft with parts p."""
        return self.draft.with_values(self.region.values(p))

    def merit(self, p: np.ndarray) -> float:
        """Merit at p, with exact peaks."""
        return self.view.merit(self.shunt(p))

    def widen(self, p: np.ndarray) -> bool:
        """Add the exact peaks at p to the set; True if one of them exceeded the level."""
        goal = self.view.goal
        if not self.view.operation.apart or not (goal.damping or goal.limits_levels):
            return False
        peaks = self.view.grid(self.shunt(p))
        before = self._heights(p, self.grid) if len(self.grid) else np.full(2, -np.inf)
        self.grid = np.union1d(self.grid, peaks)
        self._at = (None, None, None)
        return bool(np.any(self._heights(p, self.grid) > before + _PEAK_TOLERANCE))

    def _heights(self, p: np.ndarray, grid: np.ndarray) -> np.ndarray:
        levels = self.view.levels(self.shunt(p), grid, power=False)
        return np.log([np.max(levels.displacement), max(np.max(levels.voltage), 1e-300)])

    def solve(self, start: np.ndarray, told: Callable[[int], object] | None = None) -> tuple[np.ndarray, int]:
        """Solve on the present set of frequencies; returns p and the number of iterations, each of which is told."""
        n, region = len(start), self.region
        value, _ = self._forms(start)
        level = float(np.max(self._losses(*value))) if self._bounded(value) else 0.0
        y = np.concatenate((start, [level, 0.0]))
        y[-1] = max(0.0, -np.min(self._constraints(y), initial=0.0))
        low, high = np.maximum(region.lower, start - _TRUST_RADIUS), np.minimum(region.upper, start + _TRUST_RADIUS)
        levels = (level - 50, level + 50) if self._bounded(value) else (0.0, 0.0)
        bounds = [*zip(low, high, strict=True), levels, (0.0, None)]
        constraints = [{"type": "ineq", "fun": self._constraints, "jac": self._constraints_slope}]
        counted = count(1)
        found: Any = minimize(
            self._objective, y, jac=True, bounds=bounds, method="SLSQP", options={"maxiter": _STEPS, "ftol": 1e-10},
            constraints=constraints if len(self._constraints(y)) else (),
            callback=told and (lambda _: told(next(counted))),
        )  # fmt: skip
        return region.clip(found.x[:n]), int(found.nit)

    def _forms(self, p: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Logarithms of power, displacement and voltage at p, and their slopes by central differences in one batch."""
        if self._at[0] is None or not np.array_equal(p, self._at[0]):
            n = len(p)
            batch = p + _STEP * np.concatenate((np.zeros((1, n)), np.eye(n), -np.eye(n)))
            values = {name: np.exp(batch[:, k : k + 1]) for k, name in enumerate(self.draft.free)}
            shunts = self.draft.with_values(values)
            levels = self.view.levels(shunts, self.grid, power=self.view.goal.counts_power)
            power = levels.power.reshape(len(batch), -1)
            logs = [np.log(np.maximum(x, 1e-300)) for x in (power, levels.displacement, levels.voltage)]
            slopes = [(x[1 : n + 1] - x[n + 1 :]).T / (2 * _STEP) for x in logs]
            self._at = (p.copy(), [x[0] for x in logs], slopes)
        return self._at[1], self._at[2]

    def _bounded(self, forms: list[np.ndarray]) -> bool:
        """True if the objective is the largest of several numbers, which the level bounds."""
        return self.view.goal.damping or len(forms[0]) > 1

    def _losses(self, power: np.ndarray, displacement: np.ndarray, voltage: np.ndarray) -> np.ndarray:
        """The numbers, or slopes, whose largest is minimised."""
        return displacement if self.view.goal.damping else -power

    def _objective(self, y: np.ndarray) -> tuple[float, np.ndarray]:
        slope = np.zeros(len(y))
        slope[-1] = PENALTY
        value, gradient = self._forms(y[:-2])
        if self._bounded(value):
            slope[-2] = 1.0
            return float(y[-2] + PENALTY * y[-1]), slope
        slope[:-2] = -gradient[0][0]
        return float(-value[0][0] + PENALTY * y[-1]), slope

    def _constraints(self, y: np.ndarray) -> np.ndarray:
        value, _ = self._forms(y[:-2])
        parts = [y[-2] - self._losses(*value)] if self._bounded(value) else []
        for limit, sign, levels in self._limits(*value):
            parts.append(sign * (limit - levels) - MARGIN + y[-1])
        if len(self.region.coil):
            parts.append(self.region.coil @ y[:-2] - self.region.offset)
        return np.concatenate(parts) if parts else np.empty(0)

    def _constraints_slope(self, y: np.ndarray) -> np.ndarray:
        _, slopes = self._forms(y[:-2])
        parts = [_block(-self._losses(*slopes), 1.0, 0.0)] if self._bounded(slopes) else []
        parts += [_block(-sign * slope, 0.0, 1.0) for _, sign, slope in self._limits(*slopes)]
        if len(self.region.coil):
            parts.append(_block(self.region.coil, 0.0, 0.0))
        return np.concatenate(parts) if parts else np.empty((0, len(y)))

    def _limits(self, power, displacement, voltage):
        """Limits in e-folds, the side they are on (+1 from above) and the limited quantity."""
        options, found = self.view.goal.options, []
        if options.min_power:
            found.append((np.log(options.min_power), -1.0, power))
        largest = self.view.goal.largest_displacement(self.view.shorted)
        if np.isfinite(largest):
            found.append((np.log(largest), 1.0, displacement))
        if options.max_voltage is not None:
            found.append((np.log(options.max_voltage), 1.0, voltage))
        return found


def _block(slopes: np.ndarray, level: float, slack: float) -> np.ndarray:
    """Rows of the constraints' Jacobian: slopes in p, and in t and s."""
    extra = np.broadcast_to([level, slack], (len(slopes), 2))
    return np.hstack((slopes, extra))
