"""Preferred values for the best worst case in a tolerance.

Rounded for a few points of the box, the parts have their worst points elsewhere: these are added, and the parts rounded
again, until none is worse (the exchange method of `hardening`). The parts that are best without a tolerance are judged
with them, so that the worst case of those taken is at least as good.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import DesignFigures
from piezoharvest.design.parts.rounding import Judge, RoundedParts
from piezoharvest.design.parts.series import Series
from piezoharvest.design.robust.hardening import WorstPoints, is_new
from piezoharvest.design.robust.scenarios import ScenarioView
from piezoharvest.design.robust.space import ToleranceSpace, worst_of
from piezoharvest.design.tuning.region import Region
from piezoharvest.progress import silent

_ROUNDS = 4  # each adds the worst points of another choice; those of neighbouring values are mostly the same
_GAIN = 1e-4  # in merit, 0.01 % of power: for less no point is added


@dataclass(frozen=True, eq=False)
class WorstFigures:
    """The worst figures of a design at some points of a box, by simulation.

    Attributes
    ----------
    space : ToleranceSpace
    points : list of (d,) array
    """

    space: ToleranceSpace
    points: list[np.ndarray]

    def figures(self, shunt: Shunt) -> DesignFigures:
        """The worst of the figures at all points."""
        space = self.space.with_shunt(shunt)
        return worst_of(space.figures(point) for point in self.points)


@dataclass
class RobustParts:
    """Search for the preferred values whose worst case is the best.

    Attributes
    ----------
    space : ToleranceSpace
    region : Region or None
        Values that the tuning may take; None for circuits with switches.
    worst_points : callable
        Gives the worst points of the box for a shunt: of the objective and of each limit.
    affordable : callable
        True as long as more simulations may be made.
    progress : callable
        Takes messages on the progress.
    complete : bool
        True after a search that was not ended by the budget.
    """

    space: ToleranceSpace
    region: Region | None
    worst_points: WorstPoints
    affordable: Callable[[], bool]
    progress: Callable[[str], object] = silent
    complete: bool = True

    def run(self, draft: Draft, series: Series, known: dict[str, float]) -> tuple[dict[str, float], Judge]:
        """Values of the parts, with what has judged them.

        Parameters
        ----------
        draft : Draft
            The shunt as tuned; `draft.free` holds the parts to round.
        series : Series
        known : dict
            The values that are best without a tolerance.
        """
        points = [np.zeros(len(self.space.box.names))]
        self._add(points, draft.shunt)
        tried = [known]
        for _ in range(_ROUNDS):
            new = self._add(points, draft.with_values(tried[-1]))
            if len(tried) > 1 and not new:
                break
            values = self._rounded(draft, series, points)
            if values in tried:
                break
            tried.append(values)
        judge, goal = self._judge(points), self.space.nominal.goal
        return min(tried, key=lambda values: goal.merit(judge.figures(draft.with_values(values)))), judge

    def _add(self, points: list[np.ndarray], shunt: Shunt) -> bool:
        """Add the worst points for a shunt that are worse than those there are; True if there is one."""
        goal = self.space.nominal.goal
        least = goal.merit(self._judge(points).figures(shunt))
        new = [
            p
            for p in self.worst_points(shunt)
            if is_new(p, points) and goal.merit(self._judge([p]).figures(shunt)) > least + _GAIN
        ]
        points += new
        return bool(new)

    def _judge(self, points: list[np.ndarray]) -> Judge:
        return ScenarioView(self.space, points) if self.space.exact else WorstFigures(self.space, points)

    def _rounded(self, draft: Draft, series: Series, points: list[np.ndarray]) -> dict[str, float]:
        """The best preferred values for some points."""
        judge, goal = self._judge(points), self.space.nominal.goal
        view = ScenarioView(self.space, points) if isinstance(draft.shunt, LinearShunt) else None
        rounding = RoundedParts(
            draft, series, view if view and self.space.exact else judge, view, self.region, goal, self.affordable,
            progress=self.progress,
        )  # fmt: skip
        values = rounding.run()
        self.complete = self.complete and rounding.complete
        return values
