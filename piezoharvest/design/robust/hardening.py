"""Tuning for the worst case: minimax over a growing set of points of the box.

The design is tuned for the points found so far, the worst point of the box is sought for it and added, until the worst
is among them (outer approximation of a semi-infinite program; Blankenship & Falk, J. Optim. Theory Appl. 19(2),
261-281, 1976). On the two-port the set goes into `minimax.tune`. By simulation it is an epigraph program on the
engine's gradients at one frequency, and a zoom through batches over a band.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from scipy.optimize import minimize

from piezoharvest.counting import counted
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import Shunt
from piezoharvest.design.drafts import ANGLES, Draft
from piezoharvest.design.goal import MARGIN, PENALTY
from piezoharvest.design.robust.scenarios import ScenarioTrial, ScenarioView
from piezoharvest.design.robust.space import ToleranceSpace, worst_of
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.minimax import Tuned, tune
from piezoharvest.design.tuning.phase import zoom
from piezoharvest.design.tuning.refine import refine
from piezoharvest.design.tuning.region import Region, values_at
from piezoharvest.design.tuning.starts import Start
from piezoharvest.progress import Stage, silent

_ROUNDS = 8  # each adds a corner; few are ever active, one more than there are free parts
_GAIN = 1e-4  # in merit, 0.01 % of power: for less no point is added
_WIDTH = 0.3  # e-folds or rad about the nominal optimum, the first step of a zoom; it may walk on from there
_DESCENT = {"maxiter": 40, "ftol": 1e-7}

WorstPoints = Callable[[Shunt], list[np.ndarray]]  # the worst points of the box for a design, one for each measure


@dataclass
class Hardening:
    """Tuning of one draft for its worst case.

    Attributes
    ----------
    space : ToleranceSpace
    draft : Draft
    region : Region
    worst_points : callable
        Gives the worst points of the box for a shunt: of the objective and of each limit.
    affordable : callable
        True as long as more simulations may be made.
    starts : list of Start
        Start values beside the nominal optimum, which may lie where no small change helps against the tolerance.
    progress : callable
        Takes messages on the progress.
    """

    space: ToleranceSpace
    draft: Draft
    region: Region
    worst_points: WorstPoints
    affordable: Callable[[], bool]
    starts: list[Start] = field(default_factory=list)
    progress: Callable[[str], object] = silent

    def run(self, nominal: Tuned) -> Tuned:
        """The design with the best worst case found, at least the nominal one."""
        points, shunt, steps = [np.zeros(len(self.space.box.names))], nominal.shunt, 0
        best, least = nominal, np.inf
        for _ in range(_ROUNDS + 1):
            found = self.worst_points(shunt)
            merit = self._merit(shunt, [*points, *found])
            if merit < least:
                best, least = nominal._replace(shunt=shunt, merit=merit), merit
            new = [
                p for p in found if self._merit(shunt, [p]) > self._merit(shunt, points) - _GAIN and is_new(p, points)
            ]
            if not (new and merit > self._merit(shunt, points) + _GAIN) or not self.affordable():
                break
            points += new
            try:
                tuned = self._tune(points, best.shunt, nominal.shunt)
            except ParameterError:  # more to simulate than the budget has
                break
            shunt, steps = tuned.shunt, steps + tuned.iterations
        method = f"{nominal.method}, then minimax over {counted(len(points), 'point')} of the box"
        return best._replace(method=method, iterations=nominal.iterations + steps)

    def _merit(self, shunt: Shunt, points: list[np.ndarray]) -> float:
        space = self.space.with_shunt(shunt)
        return self.space.nominal.goal.merit(worst_of(space.figures(p) for p in points))

    def _tune(self, points: list[np.ndarray], *shunts: Shunt) -> Tuned:
        """Tune for some points, from each of some shunts and from the start values that are best for these points."""
        starts = [Start("nominal optimum", self.draft.values_of(s)) for s in dict.fromkeys(shunts)]
        if self.starts:
            starts.append(min(self.starts, key=lambda s: self._merit(self.draft.with_values(s.values), points)))
        name = f"{self.draft.kind}: tuning for the worst case of {counted(len(points), 'point')}"
        if self.space.exact:
            view, found = ScenarioView(self.space, points), []
            for start in starts:
                stage = Stage(self.progress, name, "steps", most=True)
                found.append(tune(view, self.draft, start, self.region, stage))
            return min(found, key=lambda tuned: tuned.merit)
        trial = ScenarioTrial(self.space, points)
        if self.space.nominal.operation.band is not None:
            return self._zoom(points, starts[0])
        found = _descend(trial, self.draft, self.region, starts[0])
        # It has all of a trial that tuning by figures asks for.
        return found or refine(cast(Trial, trial), self.draft, starts[0], self.region)

    def _zoom(self, points: list[np.ndarray], start: Start) -> Tuned:
        """Tune on batches of simulations of all designs of a stencil at all points."""
        goal, rounds = self.space.nominal.goal, 0

        def merits(p: np.ndarray, _: np.ndarray) -> np.ndarray:
            nonlocal rounds
            rounds += len(p) * len(points)
            batch = self.draft.with_values(values_at(self.draft.free, np.repeat(p, len(points), axis=0)))
            figures = self.space.many(batch, np.tile(points, (len(p), 1)))
            groups = (figures[n : n + len(points)] for n in range(0, len(figures), len(points)))
            return np.array([goal.merit(worst_of(group)) for group in groups])

        first = self.region.logs(start.values)[None]
        found, merit = zoom(merits, first, np.full(first.shape[1], _WIDTH), self.region)
        return Tuned(
            self.draft.with_values(self.region.values(found[0])),
            float(merit[0]),
            start.formula,
            "pattern search with the simulator",
            rounds,
        )


def is_new(point: np.ndarray, points: list[np.ndarray]) -> bool:
    """True for a point (d,) of the box that is none of some points."""
    return not any(np.allclose(point, p, rtol=0, atol=1e-9) for p in points)


def _descend(trial: ScenarioTrial, draft: Draft, region: Region, start: Start) -> Tuned | None:
    """Smallest t with the scores of all scenarios below it, by their gradients; None where there are none."""
    goal, size, first = trial.view.goal, len(draft.free), region.logs(start.values)

    def forms(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scores and excesses (m,) of all scenarios, and their slopes (m, n)."""
        shunt = draft.with_values(region.values(p))
        values, slopes = [], []
        for figures, slope in trial.tangents(shunt, draft.free, draft.tied):
            values.append([goal.score(figures), *(by + MARGIN for by in goal.excess(figures).values())])
            slopes.append(np.vstack((goal.score_slope(slope)[None], goal.excess_slopes(slope))))
        return np.concatenate(values), np.concatenate(slopes)

    def constraints(y: np.ndarray) -> np.ndarray:
        values, _ = forms(y[:size])
        return np.append(np.where(_is_score, y[-2], y[-1]) - values, region.coil @ y[:size] - region.offset)

    def slopes(y: np.ndarray) -> np.ndarray:
        _, rows = forms(y[:size])
        marks = np.column_stack((_is_score, ~_is_score)).astype(float)
        return np.vstack((np.hstack((-rows, marks)), np.pad(region.coil, ((0, 0), (0, 2)))))

    try:
        values, _ = forms(first)
        _is_score = np.arange(len(values)) % (len(values) // len(trial.points)) == 0
        y = np.append(first, [np.max(values[_is_score]), max(0.0, np.max(values[~_is_score], initial=0.0))])
        price = np.append(np.zeros(size), [1.0, PENALTY])
        reach = [3.0 if name in ANGLES else np.log(30.0) for name in draft.free]
        low, high = np.maximum(region.lower, first - reach), np.minimum(region.upper, first + reach)
        found: Any = minimize(
            lambda y: (float(price @ y), price), y, jac=True, method="SLSQP", options=_DESCENT,
            bounds=[*zip(low, high, strict=True), (None, None), (0.0, None)],
            constraints={"type": "ineq", "fun": constraints, "jac": slopes},
        )  # fmt: skip
    except ArithmeticError:  # NoGradientError, or a simulation that cannot go on
        return None
    if not np.all(np.isfinite(found.x)):
        return None
    shunt = draft.with_values(region.values(region.clip(found.x[:size])))
    return Tuned(shunt, trial.merit(shunt), start.formula, "SLSQP with gradients of the simulator", trial.simulations)
