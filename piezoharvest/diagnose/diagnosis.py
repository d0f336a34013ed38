"""From a campaign to a verdict: fit, residuals, effects, what they gain on records that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.description.effects import Clipping, Effect
from piezoharvest.diagnose.candidate_fits import EffectChange, Trials, amplitude_of
from piezoharvest.diagnose.drive_saturation import CHANCE, CutDrive, cut_off
from piezoharvest.diagnose.residual_tests import Leftover, share_above_noise
from piezoharvest.diagnose.score_tests import effect_line
from piezoharvest.diagnose.stepwise_selection import GOOD, SOME, Search, Searcher, above_noise
from piezoharvest.diagnose.validation import (
    not_followed,
    overshadowing,
    plainest,
    shown_by,
    spoils,
    validated,
    with_fitted,
)
from piezoharvest.diagnose.voltage_offset import voltage_is_off
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import covariance
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identifiability import UNKNOWN, experiment, relative_error
from piezoharvest.identify.identification import Estimate, Identification, Quality, identify, judged, prepared, together
from piezoharvest.identify.start_values.quasi_static import hidden
from piezoharvest.identify.threads import single_threaded
from piezoharvest.predict.parameters import value_at
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.campaign import Campaign

OFFSETS = ("displacement",)  # whose origin is where the sensor was put
ASTRAY = 5.0  # times or parts of its nominal value: what a parameter has there is not its own
CERTAINLY = 3.0  # standard deviations of what noise leaves, above which it is not noise alone
# Of the squares above noise that the model without effects leaves: three hundredths of the size of what was missing are
# within what the drive may have done between its samples and below its noise.
FAINT = 1e-3
LITTLE = 9.0  # of the sum of squares: less above the noise is not shared out, it may be chance


@dataclass(frozen=True)
class Named:
    """An effect that was found.

    Attributes
    ----------
    effect : Effect
        With its fitted values.
    p_value : float
        Of adding it, corrected for the number of effects tried.
    gain : float
        Share of the validation error above the noise that it removes.
    values : mapping of str to (value, std, unit)
    spoils : bool
        Whether records that were not fitted are worse with it: then it stands in for something else.
    """

    effect: Effect
    p_value: float
    gain: float
    values: Mapping[str, tuple[float, float | None, str]]
    spoils: bool


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What a campaign shows.

    Attributes
    ----------
    campaign : Campaign
    verdict : "adequate", "effect", "ambiguous" or "unexplained"
    effects : tuple of Named
    alternatives : tuple of tuple of str
        Sets of effects that the data cannot tell from `effects`.
    estimates : tuple of Estimate
        Parameters of the extended model.
    before : Identification
        The model without effects.
    validation_before, validation_after : Quality
        Of the records that were not fitted (or of all, where there are none).
    unexplained : float
        Share of the residual variance, after the extension, above the noise.
    experiment : str or None
        The measurement that would decide.
    shown : tuple of Leftover
        Where the model without effects leaves structure.
    search : Search
    unseen : tuple of Leftover
        Where the extended model leaves structure in records that were not fitted.
    also_fitted : tuple of str
        Records that were to be validated with, but were fitted: they show what no other record does.
    cut : tuple of str
        Records whose drive was cut off, after which they are left out.
    strayed : tuple of Estimate
        Parameters of the extended model that the data wants far from their nominal values.
    unpredicted : tuple of str
        Records that were to be validated with, but that a model with effects cannot follow.
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
    experiment: str | None
    shown: tuple[Leftover, ...]
    search: Search
    unseen: tuple[Leftover, ...] = ()
    also_fitted: tuple[str, ...] = ()
    cut: tuple[str, ...] = ()
    strayed: tuple[Estimate, ...] = ()
    unpredicted: tuple[str, ...] = ()

    @property
    def left(self) -> tuple[Leftover, ...]:
        """Where the extended model leaves structure."""
        return self.search.left


@single_threaded
def diagnose(
    campaign: Campaign,
    tell: Callable[[str], None] = lambda text: None,
    library: Sequence[type[Effect]] | None = None,
) -> Diagnosis:
    """Diagnose a campaign.

    Where a record that is not to be fitted shows what those fitted do not (a range that only it comes to), it is
    fitted, too: `Diagnosis.also_fitted` names it. What records hold after their drive was cut off is left out:
    `Diagnosis.cut` names these.

    Parameters
    ----------
    campaign : Campaign
    tell : callable
        Told about progress.
    library : sequence of Effect classes, optional
        Effects that are looked for; default all that are registered.

    Raises
    ------
    CampaignError
        As `identify`.
    """
    cut = cut_off(campaign) if library is None or Clipping in library else None
    if cut is None:
        return _whole(campaign, tell, library)
    tell(f"{', '.join(cut.records)}: the {cut.effect.channel} was cut off; what comes after that is left out")
    try:
        found = _with_cut(cut, _whole(cut.campaign, tell, library))
    except PredictionError as error:
        tell(f"what is left cannot be fitted: {error}")
        found = None
    return found or _whole(campaign, tell, library)


def _with_cut(cut: CutDrive, rest: Diagnosis) -> Diagnosis | None:
    """Diagnosis of what is left of the campaign, with the cut that made it; None where that did no harm."""
    p_value, share = cut.harm(rest.before, rest.search.final)
    if p_value > CHANCE:
        return None
    unseen, (check,) = validated(cut.measured, rest.before, [rest.before.found])
    named = Named(cut.effect, p_value, share, {"limit": (cut.effect.limit, None, "")}, spoils=False)
    others = (replace(each, gain=(1.0 - share) * each.gain) for each in rest.effects)
    verdict = "effect" if rest.verdict == "adequate" else rest.verdict
    alternatives = tuple((cut.effect.name, *names) for names in rest.alternatives)
    return replace(
        rest, verdict=verdict, effects=(named, *others), alternatives=alternatives, cut=cut.records,
        validation_before=together(judged(unseen.data, check)),
    )  # fmt: skip


def _whole(campaign: Campaign, tell: Callable[[str], None], library: Sequence[type[Effect]] | None) -> Diagnosis:
    """Diagnosis of all that a campaign holds."""
    tell("fitting the model")
    offsets = OFFSETS
    if voltage_is_off(campaign):
        tell("the zero of the voltage is off: its mean is larger on a smaller resistor, which no current makes it")
        offsets = (*OFFSETS, "voltage")
    before = identify(campaign, offsets=offsets)
    found = _extended(before, tell, library)
    if found.search.final.converged or before.campaign.transducer.quasi_static or before.campaign.drives_base:
        return found
    tell("the fit comes to no end: once more without inertia and damping, which may be what runs away")
    quiet = replace(campaign, transducer=hidden(campaign.transducer))
    other = _extended(identify(quiet, offsets=offsets), tell, library)
    return other if other.search.final.converged else found


def _extended(before: Identification, tell: Callable[[str], None], library: Sequence[type[Effect]] | None) -> Diagnosis:
    """Diagnosis with as many records fitted as it takes."""
    name = overshadowing(before)
    if name is None:  # else the others show little beside it, and a search among them is made in vain
        found = _diagnosed(before, tell, library)
        if found.left or not found.unseen:
            return found
        name = plainest(found.campaign, found.unseen)
    tell(f"{name}: more is left than in the records that were fitted, so that it is fitted, too")
    more = identify(with_fitted(before.campaign, name), offsets=before.offsets, near=before)
    found = _extended(more, tell, library)
    return replace(found, also_fitted=(name, *found.also_fitted))


def _diagnosed(
    before: Identification, tell: Callable[[str], None], library: Sequence[type[Effect]] | None
) -> Diagnosis:
    """Diagnosis with the records' roles as they are."""
    campaign = before.campaign
    problem = Problem(prepared(campaign, "fit"), campaign.transducer, before.offsets)
    tell("scoring the effects")
    trials = Trials(problem, before.found, library, tell)
    search = Searcher(trials).run()
    unseen, checks = validated(campaign, before, [before.found, *search.nested])
    squares = [share_above_noise(unseen, each) for each in checks]
    named = _all_named(campaign, before, trials, search, squares)
    while _chance(trials, search, named) or _idle(search, named, squares):
        tell(f"{search.order[-1].name} was chance: it does nothing for records that were not fitted, or for any")
        search = search.without_last(trials.left(search.before_last))
        checks, squares = checks[:-1], squares[:-1]
        named = _all_named(campaign, before, trials, search, squares)
    alternatives = tuple(step.effects for step, _ in search.alternatives)
    after, final = squares[-1], search.final
    estimates = tuple(_estimates(before, final))
    far = {parameter.path for parameter in trials.strayed(EffectChange(final))}
    strayed = tuple(estimate for estimate in estimates if estimate.parameter.path in far)
    missing = bool(search.left) or any(each.spoils for each in named) or any(map(_astray, strayed))
    verdict = _verdict(missing, named, alternatives)
    return Diagnosis(
        campaign, verdict, named, alternatives if verdict == "ambiguous" else (),
        estimates, before,
        together(judged(unseen.data, checks[0])), together(judged(unseen.data, checks[-1])),
        max(0.0, (after[0] - after[1]) / after[0]),
        _experiment(search) if verdict == "ambiguous" else None,
        trials.structure(before.found, scattered=not named), search, shown_by(unseen, checks[-1]),
        strayed=strayed, unpredicted=not_followed(campaign, unseen),
    )  # fmt: skip


def _all_named(
    campaign: Campaign,
    before: Identification,
    trials: Trials,
    search: Search,
    squares: Sequence[tuple[float, float]],
) -> tuple[Named, ...]:
    """All effects of a search; of those that seem to spoil records that were not fitted, none that these need."""
    told = (_named(trials.problem, search, n, squares) for n in range(len(search.order)))
    return tuple(
        replace(each, spoils=each.spoils and not _needed(campaign, before, trials, search, n))
        for n, each in enumerate(told)
    )


def _chance(trials: Trials, search: Search, named: Sequence[Named]) -> bool:
    """Whether nothing is left without the last effect, and it is faint, or unseen records are worse with it."""
    without = search.before_last
    if not named or not (named[-1].spoils or without.cost - search.final.cost < FAINT * above_noise(search.base)):
        return False
    # A model that has no solution without the effect has the next larger one in its place.
    return len(without.model.transducer.effects) - search.given < len(named) and not trials.left(without)


def _idle(search: Search, named: Sequence[Named], squares: Sequence[tuple[float, float]]) -> bool:
    """Whether the last effect explains next to nothing of what records that were not fitted plainly miss.

    Where much is missing that no effect explains, any of them takes a little of it off the records it is fitted to.
    """
    with_it, without = (len(found.model.transducer.effects) for found in (search.final, search.before_last))
    if not named or named[-1].spoils or without == with_it:
        return False  # it is told what it spoils; or there is no solution without it
    (first, count), (before, _), (after, _) = squares[0], squares[-2], squares[-1]
    scatter = CERTAINLY * np.sqrt(2.0 * count)
    return before - after < min(SOME * (first - count - scatter), GOOD * (before - count - scatter))


def _astray(estimate: Estimate) -> bool:
    """Whether a parameter is so far from its nominal value that it takes the place of what the model has not."""
    return not 1.0 / ASTRAY < estimate.value / estimate.nominal < ASTRAY


def _verdict(missing: bool, named: Sequence[Named], alternatives: Sequence) -> str:
    if missing:
        return "unexplained"
    if not named:
        return "adequate"
    return "ambiguous" if alternatives else "effect"


def _needed(campaign: Campaign, before: Identification, trials: Trials, search: Search, n: int) -> bool:
    """Whether records that were not fitted would be worse without an effect that seemed to spoil them.

    The first of several may have done so for as long as it stood in for the others, too.
    """
    if n == len(search.order) - 1:
        return False
    less = trials.without(EffectChange(search.final), search.given + n)
    if less is None:
        return True
    unseen, checks = validated(campaign, before, [less.found, search.final])
    without, full = (share_above_noise(unseen, each)[0] for each in checks)
    return not spoils(without, full, less.cost - search.final.cost)


def _named(problem: Problem, search: Search, n: int, squares: Sequence[tuple[float, float]]) -> Named:
    """The n-th effect with its gain and its parameters."""
    final, (before, _), (after, _) = search.final, squares[n], squares[n + 1]
    gain = (before - after) / max(squares[0][0] - _noise(*squares[-1]), LITTLE)
    scatter = covariance(final)
    std = np.sqrt(np.diag(scatter))
    values: dict[str, tuple[float, float | None, str]] = {}
    for k, parameter in enumerate(final.model.parameters):
        if parameter.path[:2] == ("effects", search.given + n):
            value = float(np.real(value_at(final.model.transducer, parameter.path)))
            inner = parameter.inner(value) if value else 0.0
            slope = value**2 if parameter.scaling == "reciprocal" else parameter.slope(inner)
            values[str(parameter.path[2])] = (value, float(slope * std[k]), parameter.unit)
    effect = search.order[n]
    if effect_line(effect):
        values["amplitude"] = (*amplitude_of(problem, final, search.given + n, scatter), "")
    costs = [search.base.cost, *(each.cost for each in search.nested)]
    spoiled = spoils(before, after, costs[n] - costs[n + 1])
    return Named(effect, search.p_values[n], float(np.clip(gain, -1.0, 1.0)), values, spoiled)


def _noise(squares: float, count: float) -> float:
    """Sum of squares that noise has in records where a model leaves so much: this, if it may be noise alone."""
    return squares if squares < count + CERTAINLY * np.sqrt(2.0 * count) else count


def _estimates(before: Identification, final: Fit):
    """Parameters of the extended model, in the order of those before."""
    std = np.sqrt(np.diag(covariance(final)))
    places = {parameter.path: k for k, parameter in enumerate(final.model.parameters)}
    told = {parameter.name for parameter in final.model.parameters}
    for estimate in before.estimates:
        k = places.get(estimate.parameter.path)
        if k is None:  # the effects may have taken what seemed to tell it
            nominal = replace(estimate, value=estimate.nominal, std=None, identifiable=False)
            yield replace(nominal, experiment=experiment(estimate.parameter)) if estimate.identifiable else estimate
            continue
        value = float(np.real(value_at(final.model.transducer, estimate.parameter.path)))
        slope = estimate.parameter.slope(estimate.parameter.inner(value))
        error = float(slope * std[k])
        told_now = relative_error(value, error) < UNKNOWN
        yield replace(
            estimate, value=value, std=error, identifiable=told_now, combination="",
            experiment="" if told_now else experiment(estimate.parameter),
            assumes=tuple(name for name in estimate.assumes if name not in told),
        )  # fmt: skip


def _experiment(search: Search) -> str | None:
    """The measurement that tells the likeliest set from the next."""
    if not search.alternatives:
        return None
    step, _ = search.alternatives[0]
    other = [
        effect for effect in step.found.model.transducer.effects if effect.name not in {e.name for e in search.order}
    ]
    mine = [effect for effect in search.order if effect.name not in step.effects]
    texts = [effect.told_by for effect in (*mine, *other) if effect.told_by]
    return "; ".join(texts) or None


__all__ = ["Diagnosis", "Named", "diagnose"]
