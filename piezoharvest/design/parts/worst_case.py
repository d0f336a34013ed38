"""Worst case of a design within a box: of its parts' tolerance, or of intervals of all that surrounds it.

A figure is sampled over the box, its corners among the samples, and raised from the worst ones along its gradient
(L-BFGS-B): a worst case may lie within the box, where the tolerance is wide enough to hold a resonance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import DesignFigures, Goal, Slopes
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.trial import Trial

_MOST, _MOST_SIMULATED = 256, 9  # samples of parts: in a batch, or simulated one by one
_MOST_SIDE, _MOST_SIDE_SIMULATED = 65, 5  # of one part
_STARTS, _STARTS_SIMULATED = 4, 2  # local searches
_STEPS = 8  # of a bounded search without gradient: to 3 % of the distance between samples, at a maximum that is flat
_ACCURACY = {"maxiter": 30, "ftol": 1e-9}


class Measure(NamedTuple):
    """A number that is larger for worse figures, and its slope from theirs."""

    value: Callable[[DesignFigures], float]
    slope: Callable[[Slopes], np.ndarray]


class Space(Protocol):
    """A design anywhere in a box, itself at zero."""

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Smallest and largest coordinates."""
        ...

    @property
    def batched(self) -> bool:
        """True if many points are sampled at once."""
        ...

    @property
    def most(self) -> int:
        """Number of samples of a first look."""
        ...

    def figures(self, point: np.ndarray) -> DesignFigures:
        """Figures at a point (d,)."""
        ...

    def tangent(self, point: np.ndarray) -> tuple[DesignFigures, Slopes]:
        """Figures at a point and their slopes (d,); raises `ArithmeticError` where there are none."""
        ...

    def sampled(self, points: np.ndarray) -> list[DesignFigures]:
        """Figures at points (n, d), roughly; only if `batched`."""
        ...


@dataclass(frozen=True)
class PartsSpace:
    """The tolerance of a shunt's parts: logarithms of values over those bought.

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
    """

    draft: Draft
    tolerance: float
    judge: LinearView | Trial
    view: LinearView | None

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Smallest and largest coordinates."""
        one = (float(np.log1p(-self.tolerance)), float(np.log1p(self.tolerance)))
        return [one] * len(self.draft.free)

    @property
    def batched(self) -> bool:
        """True if many points are sampled at once."""
        return self.view is not None

    @property
    def most(self) -> int:
        """Number of samples of a first look."""
        return _MOST if self.batched else _MOST_SIMULATED

    def figures(self, point: np.ndarray) -> DesignFigures:
        """Figures at a point (d,)."""
        return self.judge.figures(self.shunt(point))

    def tangent(self, point: np.ndarray) -> tuple[DesignFigures, Slopes]:
        """Figures at a point and their slopes (d,)."""
        return self.judge.tangent(self.shunt(point), self.draft.free)

    def sampled(self, points: np.ndarray) -> list[DesignFigures]:
        """Figures at points (n, d), by a batch on the two-port."""
        assert self.view is not None
        columns = (self._nominal * np.exp(points)).T
        batch = self.draft.with_values({n: x[:, None] for n, x in zip(self.draft.free, columns, strict=True)})
        return self.view.sampled(batch, self.view.survey(self.draft.shunt))

    def shunt(self, point: np.ndarray) -> Shunt:
        """The shunt at a point."""
        values = map(float, self._nominal * np.exp(point))
        return self.draft.with_values(dict(zip(self.draft.free, values, strict=True)))

    @property
    def _nominal(self) -> np.ndarray:
        return np.array(list(self.draft.first().values()))


@dataclass
class WorstCase:
    """Search for the worst point of a box.

    Attributes
    ----------
    space : Space
    measure : Measure
        Of what is worst.
    affordable : callable
        True as long as more simulations may be made.
    converged : bool
        True after a search in which all simulations were reliable and none was left out.
    """

    space: Space
    measure: Measure
    affordable: Callable[[], bool]
    converged: bool = True
    _scores: dict[tuple[float, ...], float] = field(default_factory=dict)

    def run(self) -> np.ndarray:
        """The worst point found."""
        self.bounds = self.space.bounds
        self._score(np.zeros(len(self.bounds)))
        if any(high > 0 for _, high in self.bounds):
            samples = self._samples()
            starts = _STARTS if self.space.batched else _STARTS_SIMULATED
            for start in self._worst_first(samples)[:starts]:
                self._climb(start, samples)
        return self.known

    def climb_from(self, point: np.ndarray) -> None:
        """Go on from a point (d,) that another search has found to be worse."""
        self._climb(point, point[None])

    @property
    def known(self) -> np.ndarray:
        """The worst point found so far."""
        return np.array(max(self._scores, key=self._scores.__getitem__))

    @property
    def worst(self) -> float:
        """The largest measure found."""
        return max(self._scores.values())

    def _samples(self) -> np.ndarray:
        """Points (m, n) of a lattice that includes the corners."""
        n, side = len(self.bounds), _MOST_SIDE if self.space.batched else _MOST_SIDE_SIMULATED
        count = min(int(self.space.most ** (1 / n) + 1e-9), side)
        if count < 2:  # so many parts that the gradient has to find the corner from the middle
            return np.zeros((1, n))
        count = count - 1 + count % 2 if count > 2 else 2  # an odd number has the middle, too
        return np.array(list(product(*(np.linspace(low, high, count) for low, high in self.bounds))))

    def _worst_first(self, samples: np.ndarray) -> np.ndarray:
        """Samples in order of their score, by a batch or one by one."""
        if self.space.batched:
            scores = [self.measure.value(f) for f in self.space.sampled(samples)]
        else:
            scores = [self._score(p) for p in samples]
        return samples[np.argsort(np.negative(np.nan_to_num(scores, nan=-np.inf)), kind="stable")]

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
        figures, slopes = self.space.tangent(p)
        score = self._note(p, self.measure.value(figures), figures.converged)
        return -score, -self.measure.slope(slopes)

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
        figures = self.space.figures(p)
        return self._note(p, self.measure.value(figures), figures.converged)

    def _note(self, p: np.ndarray, score: float, converged: bool) -> float:
        """Keep the score of a point, of the others the least where it is not to be trusted."""
        if not (converged and np.isfinite(score)):
            self.converged, score = False, min(self._scores.values(), default=-np.inf)
        self._scores.setdefault(tuple(map(float, p)), score)
        return score


def objective_of(goal: Goal) -> Measure:
    """The objective of a goal."""
    return Measure(goal.score, goal.score_slope)
