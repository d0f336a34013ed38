"""Records that were not fitted: what models leave of them, and what they show that no fitted record does."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from piezoharvest.diagnose.residual_tests import Leftover, structure
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit, White
from piezoharvest.identify.fitting.likelihood import Sums
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem, carried
from piezoharvest.identify.identification import Identification, prepared
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.campaign import Campaign

# Of the sum of squares: an effect that is there makes records that were not fitted no worse than that, and than this
# share of what it gains on those that were.
SPOILED, SHARE = 20.0, 0.1
ENOUGH = 0.1  # of -2 ln L that an iteration may still promise
FAR = 10.0  # times as many squares above noise
PLAIN = 100.0  # squares above noise, far more than the errors of fitted parameters leave of a record that was not


def validated(campaign: Campaign, before: Identification, found: Sequence[Fit]) -> tuple[Problem, list[Fit]]:
    """Records that were not fitted, or all where there are none of these, with fits of their own numbers alone.

    Records that one of the models cannot follow are left out: see `not_followed`.

    Parameters
    ----------
    campaign : Campaign
    before : Identification
        Its noise is kept.
    found : sequence of Fit
        Models that are held.
    """
    campaign = replace(campaign, transducer=before.campaign.transducer)  # quasi-static, if it was found to be
    data = prepared(campaign, "validate")
    with suppress(PredictionError):
        return _validated(data or prepared(campaign, "fit"), before, found)
    followed = tuple(each for each in data if _follow(each, before, found))
    return _validated(followed or prepared(campaign, "fit"), before, found)


def not_followed(campaign: Campaign, unseen: Problem) -> tuple[str, ...]:
    """Records that were not fitted, and that a model cannot follow."""
    followed = {data.name for data in unseen.data}
    return tuple(record.name for record in campaign.of_role("validate") if record.name not in followed)


def _follow(data: Data | FrequencyData, before: Identification, found: Sequence[Fit]) -> bool:
    """Whether models can follow a record."""
    try:
        _validated([data], before, found)
    except PredictionError:
        return False
    return True


def _validated(
    data: Sequence[Data | FrequencyData], before: Identification, found: Sequence[Fit]
) -> tuple[Problem, list[Fit]]:
    """Records with fits of their own numbers alone."""
    problem = Problem(data, before.campaign.transducer, before.offsets)
    noise = Noise({**problem.noise().sigma, **before.noise.sigma})
    fits: list[Fit] = []
    for each in found:
        model = replace(each.model, parameters=())
        starts = [
            carried(problem, fits[-1].model, fits[-1].own, model) if fits else _identified(problem, before, model)
        ]
        if any(len(one.setting.jumps) for one in data if isinstance(one, Data)):
            starts.append(problem.start(model))  # when a drive jumped may be caught beside the instant
        white = fits[0].white if fits else None
        try:
            fits.append(_best(problem, model, starts, noise, white))
        except PredictionError:
            if any(one.role != "fit" for one in data):
                raise
            fits.append(_best(problem, model, [each.own], noise, white))  # from where it has followed them
    return problem, fits


def _best(
    problem: Problem, model: Model, starts: Sequence[tuple[np.ndarray, ...]], noise: Noise, white: White | None
) -> Fit:
    """The best fit of the records' own numbers from several starts."""
    tried = (fit(problem, model, own, noise, white=white, estimate_noise=False, enough=ENOUGH) for own in starts)
    return min(tried, key=lambda each: each.cost)


def _identified(problem: Problem, before: Identification, model: Model) -> tuple[np.ndarray, ...]:
    """Own numbers of the records as they were identified."""
    known = {record.name: record.own for record in before.records}
    return tuple(
        np.array([known.get(data.name, {}).get(name, 0.0) for name in problem.own_names(model, data)])
        for data in problem.data
    )


def shown_by(unseen: Problem, check: Fit) -> tuple[Leftover, ...]:
    """Where records that were not fitted are plainly more than noise."""
    places = (place for place in structure(unseen, check) if place.above > PLAIN)
    return tuple(places) if any(data.role == "validate" for data in unseen.data) else ()


def overshadowing(before: Identification) -> str | None:
    """The record that was not fitted in which far more is left than in all that were, if there is one."""
    campaign, found = before.campaign, before.found
    if not campaign.of_role("validate"):
        return None
    unseen, (check,) = validated(campaign, before, [found])
    above = {data.name: _above(sums) for data, sums in zip(unseen.data, check.sums, strict=True)}
    name = max(above, key=lambda each: above[each])
    scatter = np.sqrt(2.0 * sum(float(sums.count.sum()) for sums in found.sums))
    return name if above[name] > FAR * max(sum(map(_above, found.sums)), scatter) else None


def _above(sums: Sums) -> float:
    """Squares above those that noise has."""
    return float(sums.squares.sum() - sums.count.sum())


def plainest(campaign: Campaign, unseen: Sequence[Leftover]) -> str:
    """The record that was not fitted of which most is left."""
    above = dict.fromkeys((record.name for record in campaign.of_role("validate")), 0.0)
    for place in unseen:
        if place.record in above:  # and not "all"
            above[place.record] = max(above[place.record], place.above)
    return max(above, key=lambda name: above[name])


def with_fitted(campaign: Campaign, name: str) -> Campaign:
    """The campaign with one more of its records fitted."""
    records = (replace(each, role="fit") if each.name == name else each for each in campaign.records)
    return replace(campaign, records=tuple(records))


def spoils(before: float, after: float, gain: float) -> bool:
    """Whether records that were not fitted become worse by an effect that gains so much on those that were."""
    return after > before + max(SPOILED, SHARE * gain)
