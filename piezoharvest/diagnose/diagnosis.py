"""Diagnosis of a campaign: fit, residual tests, effects, and their gain on records that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from piezoharvest.description.effects import Clipping, Effect
from piezoharvest.description.parameters import check_kind
from piezoharvest.description.transducer import INERT, Transducer
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.other_places import rivals
from piezoharvest.diagnose.discovery.search import can_search
from piezoharvest.diagnose.discovery.verdict import explained
from piezoharvest.diagnose.extended_estimates import estimates_with_effects, is_elsewhere, is_implausible
from piezoharvest.diagnose.final_weights import finally_weighted
from piezoharvest.diagnose.named_effects import last_is_chance, last_is_idle, named_effect, named_effects
from piezoharvest.diagnose.preparation.drive_saturation import SaturatedDrive, find_saturated_drive
from piezoharvest.diagnose.preparation.held_values import identified
from piezoharvest.diagnose.preparation.voltage_offset import voltage_is_off
from piezoharvest.diagnose.residual_structure.residual_tests import whitened_squares
from piezoharvest.diagnose.result import Diagnosis, Named
from piezoharvest.diagnose.selection.candidate_fits import CandidateFits
from piezoharvest.diagnose.selection.effect_change import EffectChange, names_apart
from piezoharvest.diagnose.selection.growing_selection import select
from piezoharvest.diagnose.selection.stepwise_selection import Search
from piezoharvest.diagnose.validation import (
    dominant_record,
    failed_on,
    not_followed,
    validated,
    with_fitted,
    worst_record,
)
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.residual_quality import combined_quality, judged
from piezoharvest.identify.result import Identification, Quality
from piezoharvest.identify.start_values.quasi_static import as_quasi_static, is_better_left_out
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Step, log, silent
from piezoharvest.records.campaign import Campaign
from piezoharvest.threads import single_threaded

OFFSET_CHANNELS = ("displacement",)  # channels whose origin is arbitrary: where the sensor was mounted


@single_threaded
def diagnose(
    campaign: Campaign,
    progress: Callable[[str], None] = log,
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
        Called with messages on the progress; default: the logger `piezoharvest`, level INFO.
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
        return finally_weighted(_with_laws(found, campaign, progress) if library is None else found)
    progress(f"{', '.join(cut.records)}: the {cut.effect.channel} saturated; the samples after that are left out")
    try:
        found = _with_saturation(cut, _diagnose_all(cut.campaign, progress, library))
    except PredictionError as error:
        progress(f"the remaining samples cannot be fitted: {error}")
        found = None
    return finally_weighted(found or _diagnose_all(campaign, progress, library))


def _with_laws(found: Diagnosis, campaign: Campaign, progress: Callable[[str], None]) -> Diagnosis:
    """The diagnosis, where it ended unexplained, with a law without a name that explains what was left.

    Inertia and damping may have been left out only because they stood in for the law: it is sought with them first.
    """
    if found.verdict == "effect":
        return _beside_other_places(found, progress)
    if found.verdict != "unexplained":
        return found
    progress("no known effect explains the residuals: looking for a law without a name")
    progress(Step("looking for a law"))
    if found.campaign.transducer.quasi_static and not campaign.transducer.quasi_static:
        moving = _explained(_begun_anew(found, campaign.transducer), progress)
        if moving is not None:
            return moving
    explained_so = _explained(found, progress)
    if explained_so is None and found.before.held:  # what free offsets have shown of the parameters may be wrong
        explained_so = _explained(_begun_anew(found, found.campaign.transducer), progress)
    return explained_so or found


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
    """The diagnosis before anything was found, with all parameters of a transducer fitted.

    That model may be worse than the one that was judged: what laws explain has to be gone from that one, too.
    """
    before = identify(replace(found.campaign, transducer=transducer), silent, offsets=found.before.offsets)
    alone = replace(found.search, base=before.found, nested=(), order=(), p_values=(), alternatives=())
    return replace(found, campaign=before.campaign, before=before, search=alone)


def _explains(before: Quality, after: Quality, count: float) -> bool:
    """True if enough of what residuals had above the noise, as the better model shows it, is gone.

    The gain of a law weighs frequencies by their noise and begins at the model that it was sought from: a law may lower
    that much and leave the error that a user sees as it was. What noise alone may leave of `count` samples of all
    channels is allowed: where known effects have explained most, little more than that was above it.
    """
    had, has = (
        sum(replace(each, noise=after.noise).ratio(channel) ** 2 - 1.0 for channel in after.noise)
        for each in (before, after)
    )
    scatter = len(after.noise) * np.sqrt(2.0 / max(count, 1.0))  # of as many mean squares of as many samples each
    return bool(has <= (1.0 - thresholds.MIN_LAW_GAIN) * had + thresholds.NOISE_DEVIATIONS * scatter)


def _explained(found: Diagnosis, progress: Callable[[str], None]) -> Diagnosis | None:
    """The diagnosis with laws that explain what was left; None where none does."""
    trials = CandidateFits(found.problem, found.before.found, [], progress)
    more = explained(found.campaign, found.before, trials, found.search)
    if more is None:
        return None
    # A law that takes the place of effects that were found also has to explain what these have left.
    left = [found.validation_before, *([found.validation_after] if found.verdict == "unexplained" else [])]
    _, count = more.squares[-1]
    if not all(_explains(each, more.validation, count) for each in left):
        progress("the errors of the records that were not fitted are hardly smaller than without it")
        return None
    final = more.search.final
    estimates = tuple(estimates_with_effects(found.before, final))
    far = {parameter.path for parameter in trials.deviating(EffectChange(final))}
    deviating = tuple(estimate for estimate in estimates if estimate.parameter.path in far)
    if any(map(is_implausible, deviating)) or any(map(is_elsewhere, estimates)):
        return None
    laws = final.model.transducer.effects
    alternatives = tuple(names_apart(each.found.model.transducer.effects, laws) for each, _ in more.search.alternatives)
    gains = {each.effect.name: each.gain for each in found.effects}
    beside = (named_effect(trials.problem, more.search, n, more.squares) for n in range(len(more.kept)))
    named = (
        *(replace(each, gain=gains.get(each.effect.name, each.gain)) for each in beside),
        *(named_effect(trials.problem, more.search, n, more.squares) for n in more.known),
    )
    return replace(
        found, verdict=more.verdict, effects=named,
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
    converged, left_out = found.search.final.converged, before.campaign.transducer.quasi_static
    if left_out or before.campaign.drives_base or (converged and not _nominal_inertia_is_wrong(found)):
        return found
    why = "nominal mass and damping may be wrong" if converged else "the fit does not converge"
    progress(f"{why}: repeated without inertia and damping, which may be the cause")
    quasi_static = replace(campaign, transducer=as_quasi_static(campaign.transducer))
    other = _diagnose_extending_fit(identified(quasi_static, offsets, progress), progress, library)
    better = other.verdict != "unexplained" if converged else other.search.final.converged
    return other if better else found


def _nominal_inertia_is_wrong(found: Diagnosis) -> bool:
    """True where something is unexplained, and less would be without nominal mass and damping that were kept."""
    if found.verdict != "unexplained" or any(p.path[-1] in INERT for p in found.before.found.model.parameters):
        return False
    still = as_quasi_static(found.campaign.transducer)
    campaign = replace(found.campaign, transducer=still)
    problem = Problem(prepared(campaign, "fit"), still, found.before.offsets)
    return is_better_left_out(found.problem, problem, found.search.final)


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
    search = select(trials)
    progress(Step("predicting the records that were not fitted"))
    unseen, checks = validated(campaign, before, [before.found, *search.nested])
    squares = [whitened_squares(unseen, each) for each in checks]
    named = named_effects(campaign, before, trials, search, squares)
    while last_is_chance(trials, search, named) or last_is_idle(search, named, squares):
        progress(f"{search.order[-1].name} was chance: it does not improve the prediction of the records")
        search = search.without_last(trials.failed_tests_refitted(search.before_last))
        checks, squares = checks[:-1], squares[:-1]
        named = named_effects(campaign, before, trials, search, squares)
    alternatives = tuple(step.effects for step, _ in search.alternatives)
    after, final = squares[-1], search.final
    estimates = tuple(estimates_with_effects(before, final))
    far = {parameter.path for parameter in trials.deviating(EffectChange(final))}
    deviating = tuple(estimate for estimate in estimates if estimate.parameter.path in far)
    missing = bool(search.left) or any(each.spoils for each in named) or any(map(is_implausible, deviating))
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


def _verdict(missing: bool, named: Sequence[Named], alternatives: Sequence) -> str:
    if missing:
        return "unexplained"
    if not named:
        return "adequate"
    return "ambiguous" if alternatives else "effect"


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
