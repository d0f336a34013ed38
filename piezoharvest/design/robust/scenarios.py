"""Several points of a box at once, for the tuning of one design that is best in the worst of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.goal import DesignFigures, Goal
from piezoharvest.design.linear_view import Levels, LinearView
from piezoharvest.design.operation import Operation
from piezoharvest.design.robust.space import ToleranceSpace, worst_of
from piezoharvest.design.trial import Tangent, Trial
from piezoharvest.engine import NoGradientError


@dataclass(frozen=True, eq=False)
class ScenarioView:
    """The two-port at several points, in the form that `minimax.tune` takes: levels of all, figures of the worst.

    Attributes
    ----------
    space : ToleranceSpace
    points : sequence of (d,) array
    """

    space: ToleranceSpace
    points: Sequence[np.ndarray]

    @cached_property
    def views(self) -> list[LinearView]:
        """The two-port at each point."""
        return [self.space.view(p) for p in self.points]

    @property
    def goal(self) -> Goal:
        """Goal of the design."""
        return self.space.nominal.goal

    @property
    def operation(self) -> Operation:
        """Operation of the study, as at the middle of the box."""
        return self.space.nominal.operation

    @property
    def shorted(self) -> float:
        """Reference displacement of attenuations, m."""
        return self.space.nominal.shorted

    def levels(self, shunt: Shunt, grid: np.ndarray, *, power: bool) -> Levels:
        """Levels at all points side by side: power (..., s), displacement and voltage (..., s g)."""
        band, found = self.operation.band, []
        for view, p in zip(self.views, self.points, strict=True):
            at = grid if band is not None else view.operation.frequencies if view.operation.apart else grid
            found.append(view.levels(self.space.shunt_at(p, shunt), at, power=power))
        powers = np.stack([x.power for x in found], axis=-1)
        return Levels(powers, *(np.concatenate(x, axis=-1) for x in list(zip(*found, strict=True))[1:]))

    def grid(self, shunt: Shunt) -> np.ndarray:
        """Frequencies in Hz of the peaks at any of the points."""
        found = [v.grid(self.space.shunt_at(p, shunt)) for v, p in zip(self.views, self.points, strict=True)]
        return np.unique(np.concatenate(found))

    def merit(self, shunt: Shunt) -> float:
        """Merit of the worst of the figures at all points."""
        return self.goal.merit(self.figures(shunt, power=self.goal.counts_power))

    def figures(self, shunt: Shunt, *, power: bool = True) -> DesignFigures:
        """The worst of the figures at all points."""
        each = zip(self.views, self.points, strict=True)
        return worst_of(v.figures(self.space.shunt_at(p, shunt), power=power) for v, p in each)

    def survey(self, shunt: Shunt) -> np.ndarray:
        """Frequencies in Hz at which shunts that resemble one are compared, of all points."""
        each = zip(self.views, self.points, strict=True)
        return np.unique(np.concatenate([v.survey(self.space.shunt_at(p, shunt)) for v, p in each]))

    def sampled(self, batch: Shunt, grid: np.ndarray) -> list[DesignFigures]:
        """The worst figures of each of a batch of designs, at the frequencies of a grid (Hz)."""
        each = zip(self.views, self.points, strict=True)
        found = [v.sampled(self.space.shunt_at(p, batch), grid) for v, p in each]
        return [worst_of(figures) for figures in zip(*found, strict=True)]


@dataclass
class ScenarioTrial:
    """Simulations at several points, in the form that `refine` takes: figures of the worst, no common gradient.

    Attributes
    ----------
    space : ToleranceSpace
    points : sequence of (d,) array
    simulations : int
        Points simulated so far.
    """

    space: ToleranceSpace
    points: Sequence[np.ndarray]
    simulations: int = 0
    _trials: list[Trial] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._trials = [Trial(self.space.view(p), left=self.space.work.left) for p in self.points]

    @property
    def view(self) -> LinearView:
        """The study's transducer in its operation."""
        return self.space.nominal

    def merit(self, shunt: Shunt) -> float:
        """Merit of the worst figures."""
        return self.view.goal.merit(self.figures(shunt))

    def figures(self, shunt: Shunt) -> DesignFigures:
        """The worst of the figures at all points."""
        each = zip(self._trials, self.points, strict=True)
        return worst_of(self._spend(t, lambda t=t, p=p: t.figures(self.space.shunt_at(p, shunt))) for t, p in each)

    def tangents(self, shunt: Shunt, parts: tuple[str, ...], tied: Mapping[str, str]) -> list[Tangent]:
        """Figures and slopes by the parts at each point; the box changes a load by a factor, which keeps logarithms.

        Raises
        ------
        NoGradientError
            The simulation has none.
        """
        each = zip(self._trials, self.points, strict=True)
        return [self._spend(t, lambda t=t, p=p: t.tangent(self.space.shunt_at(p, shunt), parts, tied)) for t, p in each]

    def tangent(self, shunt: Shunt, parts: tuple[str, ...], tied: Mapping[str, str] = MappingProxyType({})) -> Tangent:
        """None: the worst of several figures has kinks."""
        raise NoGradientError("the worst of several figures has no gradient")

    def _spend(self, trial: Trial, run):
        """Run with a trial on the common budget."""
        self.simulations += 1
        trial.left = self.space.work.left
        try:
            return run()
        finally:
            self.space.work.left = trial.left
