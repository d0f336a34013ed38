"""Choice of the parts of a tuned candidate: preferred values, what rounding costs, and the worst case."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.parts.rounding import Judge, RoundedParts
from piezoharvest.design.parts.series import Series, series_of
from piezoharvest.design.parts.worst_case import PartsSpace, WorstCase, objective_of
from piezoharvest.design.places import unit_at, value_at
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.region import Region
from piezoharvest.progress import silent

_BOUGHT_UNITS = ("ohm", "F", "H")
# Of the work left when a candidate's parts are chosen: the next candidates have to be tuned, too.
_SHARE = 0.5
RobustChoice = Callable[[Draft, Series, dict[str, float]], tuple[dict[str, float], Judge | None, bool]]


@dataclass(frozen=True)
class PartsChoice:
    """Parts of a candidate as they are bought.

    Attributes
    ----------
    shunt : Shunt
        The circuit with preferred values.
    series : str
        Their series, E3 to E192.
    ideal, values : dict
        Values as tuned and as bought, by key, in SI units.
    cost : float
        Loss of the objective by rounding: 1 - P/P_ideal, for damping the rise of the displacement in dB. With
        `worst_case` of a tolerance, that of its worst case.
    tolerance : float
        Relative half-width within which each part varies.
    objective : str
        Key of the figure that `worst` holds: "harvested_power" (W) or "attenuation_db".
    worst : float
        The worst figure within the tolerance, by simulation.
    worst_values : dict
        Values of the parts there.
    converged : bool
        True if the search for the worst case was complete and all its simulations were reliable.
    complete : bool
        True if the search for the best values was not ended by the budget of the design.
    """

    shunt: Shunt
    series: str
    ideal: dict[str, float]
    values: dict[str, float]
    cost: float
    tolerance: float
    objective: str
    worst: float
    worst_values: dict[str, float]
    converged: bool
    complete: bool

    def as_json(self) -> dict[str, Any]:
        """Choice as a table of the JSON output."""
        worst = {self.objective: self.worst, "values": self.worst_values, "converged": self.converged}
        names = ("series", "ideal", "values", "cost", "tolerance")
        return {**{name: getattr(self, name) for name in names}, "worst_case": worst}

    @property
    def remark(self) -> str:
        """Remark on a search that is not complete, in words; else empty."""
        if not self.complete:
            return "the parts may not be the best: rounding them needs more simulations than one design is allowed"
        return "" if self.converged else "the worst case of the parts is uncertain: not all of it could be simulated"


@dataclass(frozen=True)
class PartsChooser:
    """Chooses the parts of a tuned candidate.

    Attributes
    ----------
    trial : Trial
        Its budget is shared with all that follows.
    goal : Goal
    view : LinearView or None
        The two-port of linear shunts, at the amplitude of the tuned one; None for circuits with switches.
    exact : bool
        True if the two-port is as good as the simulation, and decides.
    region : Region or None
        Values that the tuning may take.
    progress : callable
        Takes messages on the progress.
    robust : callable or None
        Chooses for the worst case in a tolerance: of a draft, a series and the values that are best without one, gives
        the values, what has judged them (None: as without), and True if the search was not ended by the budget.
    """

    trial: Trial
    goal: Goal
    view: LinearView | None
    exact: bool
    region: Region | None
    progress: Callable[[str], object] = silent
    robust: RobustChoice | None = None

    def choose(self, draft: Draft, tuned: Shunt) -> PartsChoice | None:
        """Round the parts of a tuned draft together; None for a draft without parts that are tuned."""
        options = self.goal.options
        names = tuple(n for n in draft.free if unit_at(tuned, n) in _BOUGHT_UNITS)
        if options.parts is None or not names:
            return None
        series = series_of(options.parts)
        tolerance = series.tolerance if options.parts_tolerance is None else options.parts_tolerance
        judge, affordable = self.view if self.exact and self.view else self.trial, self._budget()
        ideal = dataclasses.replace(draft, shunt=tuned, free=names)
        rounding = RoundedParts(
            ideal, series, judge, self.view, self.region, self.goal, affordable, progress=self.progress
        )
        values = rounding.run()
        complete, by = rounding.complete, judge
        if self.robust is not None:
            values, of_worst, entire = self.robust(ideal, series, values)
            complete, by = complete and entire, of_worst or judge
        # The assumed smoothing capacitance is chosen with the load and keeps its value when the load varies.
        bought = dataclasses.replace(ideal, shunt=ideal.with_values(values), smoothing=None)
        space = PartsSpace(bought, tolerance, judge, self.view if self.exact else None)
        worst_case = WorstCase(space, objective_of(self.goal), affordable)
        worst = space.shunt(worst_case.run())
        loss = self.goal.score(by.figures(bought.shunt)) - self.goal.score(by.figures(tuned))
        figure, converged = self._simulated(worst)
        return PartsChoice(
            shunt=bought.shunt, series=series.name, ideal=ideal.first(), values=values,
            cost=loss * 20 / np.log(10) if self.goal.damping else float(-np.expm1(-loss)), tolerance=tolerance,
            objective="attenuation_db" if self.goal.damping else "harvested_power", worst=figure,
            worst_values={name: value_at(worst, name) for name in names},
            converged=worst_case.converged and converged, complete=complete,
        )  # fmt: skip

    def _simulated(self, worst: Shunt) -> tuple[float, bool]:
        """The objective's figure of the worst shunt by simulation, and True if that is reliable."""
        # What was found by simulation has been simulated as finely as it was tuned.
        figures = self.trial.figures(worst, complete=self.exact)
        if not self.goal.damping:
            return figures.harvested_power, figures.converged
        return 20 * float(np.log10(figures.displacement_amplitude / self.trial.shorted)), figures.converged

    def _budget(self) -> Callable[[], bool]:
        """True until the work that the choice may take is done."""
        least = self.trial.left * (1 - _SHARE)
        return lambda: self.trial.left > least
