"""Values that the search begins with where a missing constant would carry the parameters away.

A bias current that has just been switched on, or a sensor's zero that is off, is a drift that a fit without it makes of
the parameters it has: a capacitance and a coupling many times too large. With the offsets of all channels free the rest
of the records tells the parameters. The search then begins with these, held, and what the offsets had taken in is left
for the effects to explain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose import thresholds
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import inverse
from piezoharvest.identify.identification import identify, with_parameters_held
from piezoharvest.identify.result import Identification
from piezoharvest.predict.parameters import Parameter, value_at
from piezoharvest.progress import silent
from piezoharvest.records.campaign import Campaign


class StrayedError(Exception):
    """A fit leaves more than noise, with parameters far from their nominal values."""


def identified(
    campaign: Campaign,
    offsets: Sequence[str],
    progress: Callable[[str], None],
    near: Identification | None = None,
) -> Identification:
    """Identification of the model without effects, with which a search begins.

    Parameters
    ----------
    campaign : Campaign
    offsets : sequence of str
        Channels whose offset is free.
    progress : callable
        Called with messages about progress.
    near : Identification, optional
        Of some of the records, used as the start; where it holds its values, so does this one.
    """
    if near is not None and near.held:
        return with_parameters_held(identify(campaign, silent, near=near), offsets)
    if near is not None:
        return identify(campaign, silent, offsets=offsets, near=near)
    try:
        return identify(campaign, silent, offsets=offsets, poor=partial(_check, campaign.transducer))
    except StrayedError:
        free = identify(campaign, silent)
    if deviating(free.found, campaign.transducer):  # for another reason
        return identify(campaign, silent, offsets=offsets)
    progress("parameters leave their nominal values, but do not with free offsets: these values are held at first")
    return with_parameters_held(free, offsets)


def _check(nominal: Transducer, found: Fit) -> None:
    """Raise `StrayedError` if parameters of a poor fit are far from their nominal values."""
    if deviating(found, nominal):
        raise StrayedError


def deviating(found: Fit, nominal: Transducer) -> list[Parameter]:
    """Parameters whose estimates are far from their nominal values: they may compensate for a missing effect.

    The rise of the cost on their way back is estimated from their covariance, along the values instead of their
    logarithms: a value close to zero has a large change of its logarithm that makes no difference.
    """
    places, shifts = [], []
    for k, p in enumerate(found.model.parameters):
        if p.scaling == "log" and p.path[0] != "effects":
            back = p.inner(value_at(nominal, p.path)) - p.inner(value_at(found.model.transducer, p.path))
            if abs(back) > thresholds.MIN_DEVIATION:
                places.append(k)
                shifts.append(np.expm1(back))
    if not places:
        return []
    covariance = inverse(found.information + found.prior)[np.ix_(places, places)]
    wanted = np.dot(shifts, np.linalg.solve(covariance, shifts)) > thresholds.MIN_DEVIATION_GAIN
    return [found.model.parameters[k] for k in places] if wanted else []
