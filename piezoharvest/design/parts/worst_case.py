"""Worst case of a design within the tolerance of its parts.

The objective is sampled over the box of all values within their tolerance, its corners among the samples, and raised
from the worst ones along its gradient (L-BFGS-B): a worst case may lie within the box, where the tolerance is wide
enough to hold a resonance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.trial import Trial

_MOST, _MOST_SIMULATED = 256, 9  # samples: in a batch on the two-port, or simulated one by one
_MOST_SIDE, _MOST_SIDE_SIMULATED = 65, 5  # of one part
_STARTS, _STARTS_SIMULATED = 4, 2  # local searches
_STEPS = 8  # of a bounded search without gradient: to 3 % of the distance between samples, at a maximum that is flat
_ACCURACY = {"maxiter": 30, "ftol": 1e-9}


@dataclass
class WorstCase:
    """Search for the worst values within a tolerance.

    Attributes
    ----------
    draft : Draft
        The shunt as bought; `draft.free` holds the parts that vary, all else is kept.
    tolerance : float
        Relative half-width.
    judge : LinearView or Trial
        Gives the figures.
    view : LinearView or None
        Two-port on which samples are a batch; None where simulations decide.
    goal : Goal
    affordable : callable
        True as long as more simulations may be made.
    converged : bool
        True after a search in which all simulations were reliable and none was left out.
    """

    draft: Draft
    tolerance: float
    judge: LinearView | Trial
    view: LinearView | None
    goal: Goal
    affordable: Callable[[], bool]
    converged: bool = True
    _scores: dict[tuple[float, ...], float] = field(default_factory=dict)

    def run(self) -> Shunt:
        """The shunt with the worst values."""
        self.nominal = np.array(list(self.draft.first().values()))
        self.bounds = [(float(np.log1p(-self.tolerance)), float(np.log1p(self.tolerance)))] * len(self.nominal)
        self._score(np.zeros(len(self.nominal)))
        if self.tolerance > 0:
            samples = self._samples()
            starts = _STARTS if self.view else _STARTS_SIMULATED
            for start in self._worst_first(samples)[:starts]:
                self._climb(start, samples)
        known = max(self._scores, key=self._scores.__getitem__)
        return self._shunt(np.array(known))

    def _samples(self) -> np.ndarray:
        """Points (m, n) in logarithms relative to the nominal values: a lattice that includes the corners."""
        n = len(self.nominal)
        most, side = (_MOST, _MOST_SIDE) if self.view else (_MOST_SIMULATED, _MOST_SIDE_SIMULATED)
        count = min(int(most ** (1 / n) + 1e-9), side)
        if count < 2:  # so many parts that the gradient has to find the corner from the middle
            return np.zeros((1, n))
        low, high = self.bounds[0]
        places = np.linspace(low, high, count - 1 + count % 2 if count > 2 else 2)  # an odd number has the middle, too
        return np.array(list(product(places, repeat=n)))

    def _worst_first(self, samples: np.ndarray) -> np.ndarray:
        """Samples in order of their score, by a batch on the two-port or one by one."""
        if self.view is None:
            scores = [self._score(p) for p in samples]
        else:
            columns = (self.nominal * np.exp(samples)).T
            batch = self.draft.with_values({n: x[:, None] for n, x in zip(self.draft.free, columns, strict=True)})
            figures = self.view.sampled(batch, self.view.survey(self.draft.shunt))
            scores = [self.goal.score(f) for f in figures]
        return samples[np.argsort(np.negative(scores), kind="stable")]

    def _climb(self, start: np.ndarray, samples: np.ndarray) -> None:
        """Search from a start for a worse point within the box."""
        if not self.affordable():
            self.converged = False
            return
        self._score(start)
        try:
            minimize(self._falling, start, jac=True, method="L-BFGS-B", bounds=self.bounds, options=_ACCURACY)
        except ArithmeticError:  # NoGradientError, or a simulation that cannot go on
            self._search_inside(start, samples)

    def _falling(self, p: np.ndarray) -> tuple[float, np.ndarray]:
        """Negative score and its slope."""
        figures, slopes = self.judge.tangent(self._shunt(p), self.draft.free)
        score = self._note(p, self.goal.score(figures), figures.converged)
        return -score, -self.goal.score_slope(slopes)

    def _search_inside(self, start: np.ndarray, samples: np.ndarray) -> None:
        """Without a gradient: a bounded search along each part that is worst between its smallest and largest value."""
        p = start.copy()
        for k, (low, high) in enumerate(self.bounds):
            side = np.unique(samples[:, k])
            n = int(np.argmin(np.abs(side - start[k])))
            if n in (0, len(side) - 1) or not low < p[k] < high:
                continue

            def height(x: float, k: int = k) -> float:
                return -self._score(np.where(np.arange(len(p)) == k, x, p))

            found: Any = minimize_scalar(
                height, bounds=(side[n - 1], side[n + 1]), method="bounded", options={"maxiter": _STEPS}
            )
            p[k] = found.x

    def _score(self, p: np.ndarray) -> float:
        if tuple(p) in self._scores:
            return self._scores[tuple(p)]
        if self._scores and not self.affordable():
            self.converged = False
            return -np.inf
        figures = self.judge.figures(self._shunt(p))
        return self._note(p, self.goal.score(figures), figures.converged)

    def _note(self, p: np.ndarray, score: float, converged: bool) -> float:
        """Keep the score of a point, of the others the least where it is not to be trusted."""
        if not (converged and np.isfinite(score)):
            self.converged, score = False, min(self._scores.values(), default=-np.inf)
        self._scores.setdefault(tuple(map(float, p)), score)
        return score

    def _shunt(self, p: np.ndarray) -> Shunt:
        return self.draft.with_values(dict(zip(self.draft.free, map(float, self.nominal * np.exp(p)), strict=True)))
