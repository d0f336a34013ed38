"""Diagnosis of a campaign: fit, residual tests, effects, and their gain on records that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.description.effects import Clipping, Effect
from piezoharvest.description.parameters import check_kind
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.candidate_fits import CandidateFits, EffectChange, line_amplitude
from piezoharvest.diagnose.discovery.other_places import rivals
from piezoharvest.diagnose.discovery.result import Discovery
from piezoharvest.diagnose.discovery.search import can_search
from piezoharvest.diagnose.discovery.verdict import explained
from piezoharvest.diagnose.experiments.planning import PlannedRecord, Planner, parameter_named
from piezoharvest.diagnose.preparation.drive_saturation import SaturatedDrive, find_saturated_drive
from piezoharvest.diagnose.preparation.held_values import identified
from piezoharvest.diagnose.preparation.voltage_offset import voltage_is_off
from piezoharvest.diagnose.residual_regression import Hint, hints
from piezoharvest.diagnose.residual_tests import ResidualTest, whitened_squares
from piezoharvest.diagnose.scanning.scan import Scan, spread
from piezoharvest.diagnose.scanning.signs import OtherSign
from piezoharvest.diagnose.score_tests import is_line
from piezoharvest.diagnose.stepwise_selection import (
    Search,
    Searcher,
    excess_of,
)
from piezoharvest.diagnose.validation import (
    dominant_record,
    failed_on,
    not_followed,
    spoils,
    validated,
    with_fitted,
    worst_record,
)
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import covariance
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identifiability import experiment, relative_error
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.residual_quality import combined_quality, judged
from piezoharvest.identify.result import Estimate, Identification, Quality
from piezoharvest.identify.saving import save
from piezoharvest.identify.start_values.quasi_static import as_quasi_static
from piezoharvest.notebook import Shown, axes_for
from piezoharvest.predict.parameters import value_at
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Step
from piezoharvest.records.campaign import Campaign
from piezoharvest.threads import single_threaded

OFFSET_CHANNELS = ("displacement",)  # channels whose origin is arbitrary: where the sensor was mounted
MIN_EXCESS = 9.0  # of the sum of squares: a smaller excess may be chance and is not divided between effects


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
            axes.plot(channels, [quality.rms[name] / quality.noise[name] for name in channels], marker, label=label)
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


@single_threaded
def diagnose(
    campaign: Campaign,
    progress: Callable[[str], None] = lambda text: None,
    library: Sequence[type[Effect]] | None = None,
) -> Diagnosis:
    """Diagnose a campaign.

    A validation record that shows what the fitted ones do not (a range that only it reaches) is fitted as well and
    named in `Diagnosis.also_fitted`. Samples after a drive has saturated are left out; `Diagnosis.cut` names these
    records.

    Parameters
    ----------
    campaign : Campaign
    progress : callable
        Called with messages on the progress.
    library : sequence of Effect classes, optional
        Effects to look for; default all that are registered, and where these leave something a law without a name.

    Raises
    ------
    CampaignError
        As `identify`.
    """
    check_kind("campaign", campaign, Campaign, 'load_campaign("campaign.toml") reads one')
    cut = find_saturated_drive(campaign) if library is None or Clipping in library else None
    if cut is None:
        found = _diagnose_all(campaign, progress, library)
        return _with_laws(found, campaign, progress) if library is None else found
    progress(f"{', '.join(cut.records)}: the {cut.effect.channel} saturated; the samples after that are left out")
    try:
        found = _with_saturation(cut, _diagnose_all(cut.campaign, progress, library))
    except PredictionError as error:
        progress(f"the remaining samples cannot be fitted: {error}")
        found = None
    return found or _diagnose_all(campaign, progress, library)


def _with_laws(found: Diagnosis, campaign: Campaign, progress: Callable[[str], None]) -> Diagnosis:
    """The diagnosis, where it ended unexplained, with a law without a name that explains what was left.

    Inertia and damping may have been left out only because they stood in for the law: it is sought with them first.
    """
    if found.verdict == "effect":
        return _beside_other_places(found, progress)
    if found.verdict != "unexplained":
        return found
    progress("no known effect explains the residuals: looking for a law without a name")
    if found.campaign.transducer.quasi_static and not campaign.transducer.quasi_static:
        moving = _explained(_begun_anew(found, campaign.transducer), progress)
        if moving is not None:
            return moving
    if found.before.held:
        return _explained(_begun_anew(found, found.campaign.transducer), progress) or found
    return _explained(found, progress) or found


def _beside_other_places(found: Diagnosis, progress: Callable[[str], None]) -> Diagnosis:
    """The diagnosis, where its effects are small, held against laws without a name at other places.

    A law that rules the effects out is what was missing, if it passes for one; else these records cannot tell.
    """
    search, problem = found.search, found.problem
    small = search.base.cost - search.final.cost < thresholds.MAX_DOUBTED_GAIN
    if not small or problem.needs_engine or not can_search(problem):
        return found
    trials = CandidateFits(problem, found.before.found, [], progress)
    starts = [search.base] if search.before_last is search.base else [search.base, search.before_last]
    others = rivals(problem, starts, search.final, search.order, trials.freedom, progress)
    if not others:
        return found
    if others[0][1] > thresholds.MIN_LOG_ODDS:
        more = _explained(found, progress)
        if more is not None:
            return more
    best: dict[tuple[str, ...], tuple[EffectChange, float]] = {}
    for law, odds in others:
        step = EffectChange(law.found)
        best.setdefault(step.effects, (step, -2.0 * odds))
    steps = tuple(best.values())
    told_by = "; ".join(effect.told_by for effect in search.order if effect.told_by) or None
    return replace(
        found, verdict="ambiguous", alternatives=tuple(step.effects for step, _ in steps), told_by=told_by,
        search=replace(search, alternatives=steps),
    )  # fmt: skip


def _begun_anew(found: Diagnosis, transducer: Transducer) -> Diagnosis:
    """The diagnosis before anything was found, with all parameters of a transducer fitted."""
    before = identify(replace(found.campaign, transducer=transducer), offsets=found.before.offsets)
    alone = replace(found.search, base=before.found, nested=(), order=(), p_values=(), alternatives=())
    return replace(found, campaign=before.campaign, before=before, search=alone)


def _explained(found: Diagnosis, progress: Callable[[str], None]) -> Diagnosis | None:
    """The diagnosis with laws that explain what was left; None where none does."""
    trials = CandidateFits(found.problem, found.before.found, [], progress)
    more = explained(found.campaign, found.before, trials, found.search)
    if more is None:
        return None
    final = more.search.final
    estimates = tuple(_estimates(found.before, final))
    far = {parameter.path for parameter in trials.deviating(EffectChange(final))}
    deviating = tuple(estimate for estimate in estimates if estimate.parameter.path in far)
    if any(map(_is_implausible, deviating)):
        return None
    alternatives = tuple(step.effects for step, _ in more.search.alternatives)
    named = tuple(_named(trials.problem, more.search, n, more.squares) for n in more.known)
    earlier = tuple(each for each in found.effects if each.effect.name in more.kept)
    return replace(
        found, verdict=more.verdict, effects=(*earlier, *named),
        alternatives=alternatives, estimates=estimates,
        validation_after=more.validation, unexplained=more.unexplained, told_by=None, search=more.search,
        unseen=more.unseen, deviating=deviating, discovery=more.discoveries,
    )  # fmt: skip


def _with_saturation(cut: SaturatedDrive, rest: Diagnosis) -> Diagnosis | None:
    """Diagnosis of the campaign up to the saturation, with it as an effect; None if the saturation did no harm."""
    p_value, share = cut.harm(rest.before, rest.search.final)
    if p_value > thresholds.MAX_HARMLESS_P_VALUE:
        return None
    unseen, (check,) = validated(cut.measured, rest.before, [rest.before.found])
    named = Named(cut.effect, p_value, share, {"limit": (cut.effect.limit, None, "")}, spoils=False)
    others = (replace(each, gain=(1.0 - share) * each.gain) for each in rest.effects)
    verdict = "effect" if rest.verdict == "adequate" else rest.verdict
    alternatives = tuple((cut.effect.name, *names) for names in rest.alternatives)
    return replace(
        rest, verdict=verdict, effects=(named, *others), alternatives=alternatives, cut=cut.records,
        validation_before=combined_quality(judged(unseen.data, check)),
    )  # fmt: skip


def _diagnose_all(
    campaign: Campaign, progress: Callable[[str], None], library: Sequence[type[Effect]] | None
) -> Diagnosis:
    """Diagnosis with all samples of a campaign."""
    progress(Step("fitting the model"))
    offsets = OFFSET_CHANNELS
    if voltage_is_off(campaign):
        progress("the voltage has an offset: its mean is larger with a smaller resistor, which no current can cause")
        offsets = (*OFFSET_CHANNELS, "voltage")
    before = identified(campaign, offsets, progress)
    found = _diagnose_extending_fit(before, progress, library)
    if found.search.final.converged or before.campaign.transducer.quasi_static or before.campaign.drives_base:
        return found
    progress("the fit does not converge: repeated without inertia and damping, which may be the cause")
    quasi_static = replace(campaign, transducer=as_quasi_static(campaign.transducer))
    other = _diagnose_extending_fit(identified(quasi_static, offsets, progress), progress, library)
    return other if other.search.final.converged else found


def _diagnose_extending_fit(
    before: Identification, progress: Callable[[str], None], library: Sequence[type[Effect]] | None
) -> Diagnosis:
    """Diagnosis with validation records added to the fit until it explains them."""
    name = dominant_record(before)
    if name is None:  # else the other records show little beside it, and a search among them is futile
        found = _diagnose_roles(before, progress, library)
        if found.left or not found.unseen:
            return found
        name = worst_record(found.campaign, found.unseen)
    progress(f"{name}: residuals are larger than in the fitted records, so it is fitted too")
    more = identified(with_fitted(before.campaign, name), before.offsets, progress, near=before)
    found = _diagnose_extending_fit(more, progress, library)
    return replace(found, also_fitted=(name, *found.also_fitted))


def _diagnose_roles(
    before: Identification, progress: Callable[[str], None], library: Sequence[type[Effect]] | None
) -> Diagnosis:
    """Diagnosis with the roles of the records as they are."""
    campaign = before.campaign
    problem = Problem(prepared(campaign, "fit"), campaign.transducer, before.offsets)
    progress(Step("scoring the effects"))
    trials = CandidateFits(problem, before.found, library, progress, before.held)
    search = Searcher(trials).run()
    unseen, checks = validated(campaign, before, [before.found, *search.nested])
    squares = [whitened_squares(unseen, each) for each in checks]
    named = _named_effects(campaign, before, trials, search, squares)
    while _last_is_chance(trials, search, named) or _last_is_idle(search, named, squares):
        progress(f"{search.order[-1].name} was chance: it does not improve records that were not fitted, or any")
        search = search.without_last(trials.failed_tests_refitted(search.before_last))
        checks, squares = checks[:-1], squares[:-1]
        named = _named_effects(campaign, before, trials, search, squares)
    alternatives = tuple(step.effects for step, _ in search.alternatives)
    after, final = squares[-1], search.final
    estimates = tuple(_estimates(before, final))
    far = {parameter.path for parameter in trials.deviating(EffectChange(final))}
    deviating = tuple(estimate for estimate in estimates if estimate.parameter.path in far)
    missing = bool(search.left) or any(each.spoils for each in named) or any(map(_is_implausible, deviating))
    verdict = _verdict(missing, named, alternatives)
    return Diagnosis(
        campaign, verdict, named, alternatives if verdict == "ambiguous" else (),
        estimates, before,
        combined_quality(judged(unseen.data, checks[0])), combined_quality(judged(unseen.data, checks[-1])),
        max(0.0, (after[0] - after[1]) / after[0]),
        _told_by(search) if verdict == "ambiguous" else None,
        trials.failed_tests(before.found, drive_noise=not named), search, failed_on(unseen, checks[-1]),
        deviating=deviating, unpredicted=not_followed(campaign, unseen),
    )  # fmt: skip


def _named_effects(
    campaign: Campaign,
    before: Identification,
    trials: CandidateFits,
    search: Search,
    squares: Sequence[tuple[float, float]],
) -> tuple[Named, ...]:
    """All effects of a search; none spoils unseen records if these would be worse without it."""
    named = (_named(trials.problem, search, n, squares) for n in range(len(search.order)))
    return tuple(
        replace(each, spoils=each.spoils and not _is_needed(campaign, before, trials, search, n))
        for n, each in enumerate(named)
    )


def _last_is_chance(trials: CandidateFits, search: Search, named: Sequence[Named]) -> bool:
    """True if no test fails without the last effect, and the effect is weak or makes unseen records worse."""
    without = search.before_last
    if not named or not (
        named[-1].spoils or without.cost - search.final.cost < thresholds.MIN_EXPLAINED_SHARE * excess_of(search.base)
    ):
        return False
    # A model that has no solution without the effect is replaced by the next larger one.
    return len(without.model.transducer.effects) - search.given_effects < len(
        named
    ) and not trials.failed_tests_refitted(without)


def _last_is_idle(search: Search, named: Sequence[Named], squares: Sequence[tuple[float, float]]) -> bool:
    """True if the last effect explains next to nothing of the excess on records that were not fitted.

    Where much is missing that no effect explains, any effect explains a little of it in the records it is fitted to.
    """
    with_it, without = (len(found.model.transducer.effects) for found in (search.final, search.before_last))
    if not named or named[-1].spoils or without == with_it:
        return False  # it is reported as spoiling, or there is no solution without it
    (first, count), (before, _), (after, _) = squares[0], squares[-2], squares[-1]
    scatter = thresholds.NOISE_DEVIATIONS * np.sqrt(2.0 * count)
    return before - after < min(
        thresholds.MIN_SHARE_OF_INITIAL * (first - count - scatter),
        thresholds.MIN_SHARE_OF_PRESENT * (before - count - scatter),
    )


def _is_implausible(estimate: Estimate) -> bool:
    """True if a parameter is so far from its nominal value that it compensates for something missing."""
    return not 1.0 / thresholds.MAX_DEVIATION < estimate.value / estimate.nominal < thresholds.MAX_DEVIATION


def _verdict(missing: bool, named: Sequence[Named], alternatives: Sequence) -> str:
    if missing:
        return "unexplained"
    if not named:
        return "adequate"
    return "ambiguous" if alternatives else "effect"


def _is_needed(campaign: Campaign, before: Identification, trials: CandidateFits, search: Search, n: int) -> bool:
    """True if records that were not fitted would be worse without an effect that seemed to spoil them.

    The first of several effects may have done so while it compensated for the others, too.
    """
    if n == len(search.order) - 1:
        return False
    less = trials.best_without(EffectChange(search.final), search.given_effects + n)
    if less is None:
        return True
    unseen, checks = validated(campaign, before, [less.found, search.final])
    without, full = (whitened_squares(unseen, each)[0] for each in checks)
    return not spoils(without, full, less.cost - search.final.cost)


def _named(problem: Problem, search: Search, n: int, squares: Sequence[tuple[float, float]]) -> Named:
    """The n-th effect with its gain and its parameters."""
    final, (before, _), (after, _) = search.final, squares[n], squares[n + 1]
    gain = (before - after) / max(squares[0][0] - _noise_squares(*squares[-1]), MIN_EXCESS)
    scatter = covariance(final)
    std = np.sqrt(np.diag(scatter))
    values: dict[str, tuple[float, float | None, str]] = {}
    for k, parameter in enumerate(final.model.parameters):
        if parameter.path[:2] == ("effects", search.given_effects + n):
            value = float(np.real(value_at(final.model.transducer, parameter.path)))
            inner = parameter.inner(value) if value else 0.0
            slope = value**2 if parameter.scaling == "reciprocal" else parameter.slope(inner)
            values[str(parameter.path[2])] = (value, float(slope * std[k]), parameter.unit)
    effect = search.order[n]
    if is_line(effect):
        values["amplitude"] = (*line_amplitude(problem, final, search.given_effects + n, scatter), "")
    if effect.scanned:
        field = type(effect).strength()
        scan = Scan(problem, final, search.given_effects + n)
        values[field.name] = (scan.value, spread(*scan.interval()), field.metadata["unit"])
    other = search.other_signs.get(effect.name)
    if other is not None:
        name = type(effect).strength().name
        value, error, unit = values[name]
        values[name] = (value, other.spread(value, error or 0.0), unit)
    costs = [search.base.cost, *(each.cost for each in search.nested)]
    spoiled = spoils(before, after, costs[n] - costs[n + 1])
    return Named(effect, search.p_values[n], float(np.clip(gain, -1.0, 1.0)), values, spoiled, other)


def _noise_squares(squares: float, count: float) -> float:
    """Part of a sum of squares that noise may explain: all of it, if it may be noise alone."""
    return squares if squares < count + thresholds.NOISE_DEVIATIONS * np.sqrt(2.0 * count) else count


def _estimates(before: Identification, final: Fit):
    """Estimates of the extended model, in the order of those before."""
    std = np.sqrt(np.diag(covariance(final)))
    places = {parameter.path: k for k, parameter in enumerate(final.model.parameters)}
    names = {parameter.name for parameter in final.model.parameters}
    for estimate in before.estimates:
        k = places.get(estimate.parameter.path)
        if k is None:  # the effects may explain what seemed to determine it
            nominal = replace(estimate, value=estimate.nominal, std=None, identifiable=False)
            yield replace(nominal, experiment=experiment(estimate.parameter)) if estimate.identifiable else estimate
            continue
        value = float(np.real(value_at(final.model.transducer, estimate.parameter.path)))
        slope = estimate.parameter.slope(estimate.parameter.inner(value))
        error = float(slope * std[k])
        identifiable = relative_error(value, error) < thresholds.MAX_RELATIVE_ERROR
        yield replace(
            estimate, value=value, std=error, identifiable=identifiable, combination="",
            experiment="" if identifiable else experiment(estimate.parameter),
            assumes=tuple(name for name in estimate.assumes if name not in names),
        )  # fmt: skip


def _told_by(search: Search) -> str | None:
    """The measurement that distinguishes the likeliest set from the next."""
    if not search.alternatives:
        return None
    step, _ = search.alternatives[0]
    other = [
        effect for effect in step.found.model.transducer.effects if effect.name not in {e.name for e in search.order}
    ]
    dropped = [effect for effect in search.order if effect.name not in step.effects]
    texts = [effect.told_by for effect in (*dropped, *other) if effect.told_by]
    return "; ".join(texts) or None


__all__ = ["Diagnosis", "Named", "diagnose"]
