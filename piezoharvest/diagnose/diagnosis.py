"""From a campaign to a verdict: fit, residuals, effects, what they gain on records that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.diagnose.candidates import effect_line
from piezoharvest.diagnose.leftover import Leftover, leftovers, share_above_noise, significant
from piezoharvest.diagnose.scene import scene_of
from piezoharvest.diagnose.search import Search, Searcher
from piezoharvest.effects import Effect
from piezoharvest.identify.fit import Fit, Problem, covariance, fit
from piezoharvest.identify.identification import Estimate, Identification, Quality, identify, judged, prepared, together
from piezoharvest.identify.noise import Noise
from piezoharvest.predict.parameters import value_at
from piezoharvest.records.campaign import Campaign

STRUCTURE = 1e-5  # level at which residuals of the extended model are more than noise


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
    """

    effect: Effect
    p_value: float
    gain: float
    values: Mapping[str, tuple[float, float | None, str]]


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
    left : tuple of Leftover
        Where the extended model leaves structure.
    shown : tuple of Leftover
        Where the model without effects does.
    search : Search
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
    left: tuple[Leftover, ...]
    shown: tuple[Leftover, ...]
    search: Search


def diagnose(
    campaign: Campaign,
    tell: Callable[[str], None] = lambda text: None,
    library: Sequence[type[Effect]] | None = None,
) -> Diagnosis:
    """Diagnose a campaign.

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
    tell("fitting the model")
    before = identify(campaign, offsets=("displacement",))
    problem = Problem(prepared(campaign, "fit"), campaign.transducer, before.offsets)
    scene = scene_of(problem.data, before.found)
    tell("scoring the effects")
    search = Searcher(problem, scene, library, tell).run(before.found)
    final = search.final
    left = leftovers(problem, final)
    structure = significant(left, STRUCTURE)
    check = _Validation(campaign, problem, before)
    fits = [before.found, *search.nested]
    squares = [check.squares(each) for each in fits]
    named = tuple(_named(search, final, n, squares) for n in range(len(search.order)))
    alternatives = tuple(step.effects for step, _ in search.alternatives)
    after = check.squares(final)
    verdict = _verdict(bool(structure), named, alternatives)
    return Diagnosis(
        campaign, verdict, named, alternatives if verdict == "ambiguous" else (),
        tuple(_estimates(before, final)), before,
        check.quality(before.found), check.quality(final), max(0.0, (after[0] - after[1]) / after[0]),
        _experiment(search) if verdict == "ambiguous" else None, tuple(structure),
        tuple(significant(leftovers(problem, before.found), STRUCTURE)), search,
    )  # fmt: skip


def _verdict(structure: bool, named: Sequence[Named], alternatives: Sequence) -> str:
    if structure:
        return "unexplained"
    if not named:
        return "adequate"
    return "ambiguous" if alternatives else "effect"


class _Validation:
    """Records that were not fitted, or all where there are none of these."""

    def __init__(self, campaign: Campaign, fitted: Problem, before: Identification) -> None:
        data = prepared(campaign, "validate")
        self.problem = Problem(data, campaign.transducer, fitted.offset_channels) if data else fitted
        self.noise = Noise({**self.problem.noise().sigma, **before.noise.sigma})

    def _own(self, found: Fit) -> Fit:
        """Fit of the records' own numbers alone."""
        return fit(self.problem, replace(found.model, parameters=()), None, self.noise, estimate_noise=False)

    def squares(self, found: Fit) -> tuple[float, float]:
        """Sum of squares of the whitened residuals, and their number."""
        return share_above_noise(self.problem, self._own(found))

    def quality(self, found: Fit) -> Quality:
        """Residuals and noise by channel."""
        return together(judged(self.problem.data, self._own(found)))


def _named(search: Search, final: Fit, n: int, squares: Sequence[tuple[float, float]]) -> Named:
    """The n-th effect with its gain and its parameters."""
    (before, count), (after, _) = squares[n], squares[n + 1]
    total = squares[0][0] - count
    gain = (before - after) / total if total > 0 else 0.0
    std = np.sqrt(np.diag(covariance(final)))
    values: dict[str, tuple[float, float | None, str]] = {}
    for k, parameter in enumerate(final.model.parameters):
        if parameter.path[:2] == ("effects", n):
            value = float(np.real(value_at(final.model.transducer, parameter.path)))
            inner = parameter.inner(value) if value else 0.0
            slope = value**2 if parameter.scaling == "reciprocal" else parameter.slope(inner)
            values[str(parameter.path[2])] = (value, float(slope * std[k]), parameter.unit)
    effect = search.order[n]
    if effect_line(effect):
        values["amplitude"] = (_amplitude(final, n), None, "")
    return Named(
        effect, search.p_values[n] if n < len(search.p_values) else 0.0, float(np.clip(gain, -1.0, 1.0)), values
    )


def _amplitude(final: Fit, n: int) -> float:
    """Root mean square over records of a line's amplitude."""
    sizes = [np.hypot(*mine[-2:]) for mine in final.own if len(mine) >= 2]
    return float(np.sqrt(np.mean(np.square(sizes))))


def _estimates(before: Identification, final: Fit):
    """Parameters of the extended model, in the order of those before."""
    std = np.sqrt(np.diag(covariance(final)))
    places = {parameter.path: k for k, parameter in enumerate(final.model.parameters)}
    for estimate in before.estimates:
        k = places.get(estimate.parameter.path)
        if k is None:
            yield estimate
            continue
        value = float(np.real(value_at(final.model.transducer, estimate.parameter.path)))
        slope = estimate.parameter.slope(estimate.parameter.inner(value))
        yield replace(estimate, value=value, std=float(slope * std[k]))


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
