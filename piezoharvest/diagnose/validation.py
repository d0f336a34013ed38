"""Validation on records that were not fitted: their residuals, and features that no fitted record has."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.residual_structure.residual_tests import ResidualTest, failed_tests
from piezoharvest.identify.fitting.cost_function import Whiteners
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.likelihood import Sums
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit, mean_square
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.result import Identification
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.campaign import Campaign

FIT_TOLERANCE = 0.1  # of -2 ln L: predicted decrease at which a fit stops


def validated(campaign: Campaign, before: Identification, found: Sequence[Fit]) -> tuple[Problem, list[Fit]]:
    """Fits of only the nuisance parameters of the records that were not fitted, or of all where there are none.

    Records that one of the models cannot follow are left out: see `not_followed`.

    Parameters
    ----------
    campaign : Campaign
    before : Identification
        Provides the noise, which is not estimated anew.
    found : sequence of Fit
        Models, whose parameters stay fixed.
    """
    campaign = replace(campaign, transducer=before.campaign.transducer)  # quasi-static, if it was identified so
    data = prepared(campaign, "validate")
    with suppress(PredictionError):
        return _validated(data or prepared(campaign, "fit"), before, found)
    followed = tuple(each for each in data if _can_follow(each, before, found))
    return _validated(followed or prepared(campaign, "fit"), before, found)


def not_followed(campaign: Campaign, unseen: Problem) -> tuple[str, ...]:
    """Validation records that a model cannot follow."""
    followed = {data.name for data in unseen.data}
    return tuple(record.name for record in campaign.of_role("validate") if record.name not in followed)


def _can_follow(data: Data | FrequencyData, before: Identification, found: Sequence[Fit]) -> bool:
    """True if models can follow a record."""
    try:
        _validated([data], before, found)
    except PredictionError:
        return False
    return True


def _validated(
    data: Sequence[Data | FrequencyData], before: Identification, found: Sequence[Fit]
) -> tuple[Problem, list[Fit]]:
    """Records, with fits of their nuisance parameters alone."""
    problem = Problem(data, before.campaign.transducer, before.offsets)
    noise = Noise({**problem.noise().sigma, **before.noise.sigma})
    fits: list[Fit] = []
    for each in found:
        model = replace(each.model, parameters=())
        starts = [
            nuisance_for_model(problem, fits[-1].model, fits[-1].nuisance, model)
            if fits
            else _identified_nuisance(problem, before, model)
        ]
        # A local minimum beside the true time of a drive's jump is possible, and one in the motion that a model before
        # had, which was far off.
        jumps = any(len(one.setting.jumps) for one in data if isinstance(one, Data))
        starts += [problem.start(model)] if jumps or each is not before.found else []
        starts += [each.nuisance] if all(one.role == "fit" for one in data) else []
        fits.append(_best_fit(problem, model, starts, noise, fits[0].white if fits else None))
    return problem, fits


def _best_fit(
    problem: Problem, model: Model, starts: Sequence[tuple[np.ndarray, ...]], noise: Noise, white: Whiteners | None
) -> Fit:
    """The best fit of the nuisance parameters from several starts, as far as the first ones leave much.

    Raises
    ------
    PredictionError
        From none of them the model can follow the records.
    """
    tried: list[Fit] = []
    for n, nuisance in enumerate(starts):
        try:
            tried.append(fit(problem, model, nuisance, noise, white=white, estimate_noise=False, enough=FIT_TOLERANCE))
        except PredictionError:
            if n == len(starts) - 1 and not tried:
                raise
            continue
        if mean_square(tried[-1]) < 1.0 + thresholds.MUCH_LEFT:
            break
    return min(tried, key=lambda each: each.cost)


def _identified_nuisance(problem: Problem, before: Identification, model: Model) -> tuple[np.ndarray, ...]:
    """Nuisance parameters of the records as they were identified."""
    known = {record.name: record.own for record in before.records}
    return tuple(
        np.array(
            [
                known.get(data.name, {}).get(name, start)
                for name, start in zip(problem.nuisance_names(model, data), starts, strict=True)
            ]
        )
        for data, starts in zip(problem.data, problem.start(model), strict=True)
    )


def failed_on(unseen: Problem, check: Fit) -> tuple[ResidualTest, ...]:
    """Failed residual tests of records that were not fitted, far in excess of noise."""
    places = (place for place in failed_tests(unseen, check) if place.excess_squares > thresholds.MIN_UNSEEN_EXCESS)
    return tuple(places) if any(data.role == "validate" for data in unseen.data) else ()


def dominant_record(before: Identification) -> str | None:
    """The record that was not fitted whose excess is far larger than that of all fitted ones, if there is one."""
    campaign, found = before.campaign, before.found
    if not campaign.of_role("validate"):
        return None
    unseen, (check,) = validated(campaign, before, [found])
    above = {data.name: _excess(sums) for data, sums in zip(unseen.data, check.sums, strict=True)}
    name = max(above, key=lambda each: above[each])
    scatter = np.sqrt(2.0 * sum(float(sums.count.sum()) for sums in found.sums))
    return name if above[name] > thresholds.MIN_EXCESS_RATIO * max(sum(map(_excess, found.sums)), scatter) else None


def _excess(sums: Sums) -> float:
    """Sum of squares in excess of noise."""
    return float(sums.squares.sum() - sums.count.sum())


def worst_record(campaign: Campaign, unseen: Sequence[ResidualTest]) -> str:
    """The record that was not fitted with the largest excess in one residual test."""
    above = dict.fromkeys((record.name for record in campaign.of_role("validate")), 0.0)
    for place in unseen:
        if place.record in above:  # and not "all"
            above[place.record] = max(above[place.record], place.excess_squares)
    return max(above, key=lambda name: above[name])


def with_fitted(campaign: Campaign, name: str) -> Campaign:
    """The campaign with one more record in the role of being fitted."""
    records = (replace(each, role="fit") if each.name == name else each for each in campaign.records)
    return replace(campaign, records=tuple(records))


def spoils(before: float, after: float, gain: float) -> bool:
    """True if an effect with this gain on fitted records makes the others worse than chance would."""
    return after > before + max(thresholds.MAX_RISE, thresholds.MAX_RISE_OF_GAIN * gain)
