"""Result of a diagnosis: the effects that were found, the extended model, and the measurement that would tell more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from piezoharvest.description.effects import Effect
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.result import Discovery
from piezoharvest.diagnose.experiments.planning import PlannedRecord, Planner, parameter_named
from piezoharvest.diagnose.residual_structure.residual_regression import Hint, hints
from piezoharvest.diagnose.residual_structure.residual_tests import ResidualTest
from piezoharvest.diagnose.scanning.signs import OtherSign
from piezoharvest.diagnose.selection.stepwise_selection import Search
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identifiability import relative_error
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.result import Estimate, Identification, Quality
from piezoharvest.identify.saving import save
from piezoharvest.notebook import Shown, axes_for
from piezoharvest.records.campaign import Campaign


@dataclass(frozen=True)
class Named:
    """An effect that was found.

    Attributes
    ----------
    effect : Effect
        With its fitted values.
    p_value : float
        p-value of adding it, corrected for the number of effects tried.
    gain : float
        Share of the validation error above the noise that it removes.
    values : mapping of str to (value, std, unit)
    spoils : bool
        True if records that were not fitted are worse with it: it compensates for something else.
    other_sign : OtherSign or None
        The value with the other sign, where the records do not tell the sign; the standard error covers both.
    """

    effect: Effect
    p_value: float
    gain: float
    values: Mapping[str, tuple[float, float | None, str]]
    spoils: bool
    other_sign: OtherSign | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Shown):
    """Result of a diagnosis.

    Attributes
    ----------
    campaign : Campaign
    verdict : "adequate", "effect", "new_effect", "ambiguous" or "unexplained"
    effects : tuple of Named
    alternatives : tuple of tuple of str
        Sets of effects that the data cannot distinguish from `effects`.
    estimates : tuple of Estimate
        Parameters of the extended model.
    before : Identification
        The model without effects.
    validation_before, validation_after : Quality
        For the records that were not fitted (or all, where there are none).
    unexplained : float
        Share of the residual variance, after the extension, above the noise.
    told_by : str or None
        Measurements that distinguish the alternatives on any bench.
    shown : tuple of ResidualTest
        Residual tests that the model without effects fails.
    search : Search
    unseen : tuple of ResidualTest
        Residual tests that the extended model fails on records that were not fitted.
    also_fitted : tuple of str
        Validation records that were fitted after all, since they show what no other record does.
    cut : tuple of str
        Records whose drive saturated; they are used up to that time.
    deviating : tuple of Estimate
        Parameters of the extended model whose estimates are far from their nominal values.
    unpredicted : tuple of str
        Validation records that a model with effects cannot follow.
    discovery : tuple of Discovery
        Laws without a name that explain what no effect does.
    """

    campaign: Campaign
    verdict: str
    effects: tuple[Named, ...]
    alternatives: tuple[tuple[str, ...], ...]
    estimates: tuple[Estimate, ...]
    before: Identification
    validation_before: Quality
    validation_after: Quality
    unexplained: float
    told_by: str | None
    shown: tuple[ResidualTest, ...]
    search: Search
    unseen: tuple[ResidualTest, ...] = ()
    also_fitted: tuple[str, ...] = ()
    cut: tuple[str, ...] = ()
    deviating: tuple[Estimate, ...] = ()
    unpredicted: tuple[str, ...] = ()
    discovery: tuple[Discovery, ...] = ()

    @property
    def heading(self) -> str:
        """The verdict and the effects."""
        found = [named.effect.name for named in self.effects]
        return f"{self.verdict}{': ' + ', '.join(found) if found else ''}"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The parameters of the effects, one a row."""
        return [
            {"effect": named.effect.name, "parameter": name, "value": value, "std": std, "unit": unit,
             "gain": named.gain, "p_value": named.p_value}
            for named in self.effects
            for name, (value, std, unit) in named.values.items()
        ]  # fmt: skip

    def plot(self, ax: Any = None) -> Any:
        """Draw the validation error over the noise of each channel, before and after, into axes of matplotlib.

        Returns
        -------
        Axes
        """
        (axes,) = axes_for(ax)
        before, after = self.validation_before, self.validation_after
        channels = [name for name in before.rms if after.rms.get(name) and before.noise.get(name)]
        for label, quality, marker in (("before", before, "o"), ("after", after, "x")):
            axes.plot(channels, [quality.ratio(name) for name in channels], marker, label=label)
        axes.axhline(1.0, color="0.4", linestyle="--", label="noise")
        axes.set(ylabel="rms of the error over that of the noise", yscale="log")
        axes.legend()
        return axes

    @property
    def extended(self) -> bool:
        """True if the final model has more than the lumped one: effects, or laws without a name."""
        return bool(self.effects or self.discovery)

    @property
    def experiment(self) -> str | None:
        """The measurement that would tell most, in words; None where nothing is open that one could tell."""
        return self.plan.sentence if self.plan is not None else self.told_by

    @cached_property
    def plan(self) -> PlannedRecord | None:
        """The planned record that would tell most, within the limits of the bench that the campaign shows or states.

        Between alternatives; where something is left unexplained between the last effect and none, or the two that
        score highest; else for a parameter that is not identifiable. None where no record would tell.
        """
        search, planner = self.search, self.planner
        if self.verdict == "ambiguous" and search.alternatives:
            return planner.for_sets(search.final, search.alternatives[0][0].found)
        if self.verdict == "unexplained" and search.nested:
            return planner.for_sets(search.final, search.before_last)
        if self.verdict == "unexplained":
            return planner.for_suspects(search.first)
        open_ = [e.parameter for e in self.estimates if not e.identifiable and e.std is None]
        plans = (planner.for_parameter(parameter) for parameter in open_)
        return next((plan for plan in plans if plan and plan.after < thresholds.MAX_RELATIVE_ERROR), None)

    def plan_for(self, name: str | None = None) -> PlannedRecord | None:
        """The planned record for a parameter, or without a name `plan`, or else that for the least certain parameter.

        Raises
        ------
        ParameterError
            There is no such parameter.
        """
        known = [estimate.parameter for estimate in self.estimates]
        if name is not None:
            return self.planner.for_parameter(parameter_named(self.search.final, known, name))
        told = [e for e in self.estimates if e.std is not None]
        weakest = max(told, key=lambda e: relative_error(e.value, e.std or 0.0), default=None)
        return self.plan or (weakest and self.planner.for_parameter(weakest.parameter))

    @cached_property
    def problem(self) -> Problem:
        """The records that were fitted."""
        return Problem(prepared(self.campaign, "fit"), self.before.campaign.transducer, self.before.offsets)

    @cached_property
    def planner(self) -> Planner:
        """Planner of further records."""
        return Planner(self.campaign, self.problem, self.search.final)

    @cached_property
    def hints(self) -> list[Hint]:
        """Functions of the signals that describe what no effect explains; none for any other verdict."""
        return hints(self.problem, self.search.final) if self.verdict == "unexplained" else []

    def save(self, path: str | Path) -> None:
        """Write the specimen file, which a study takes by `transducer = "FILE"`; raises `OutputError`."""
        final, source = self.search.final, dict[str, Any](command="diagnose", verdict=self.verdict)
        save(final, self.estimates, self.campaign, path, **source, trusted=final.converged)

    @property
    def left(self) -> tuple[ResidualTest, ...]:
        """Residual tests that the extended model fails."""
        return self.search.left
