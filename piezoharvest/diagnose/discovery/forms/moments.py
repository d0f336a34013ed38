"""Moment of a change that comes at once: from a fit, the better of others that the likelihood has minima at.

A spring that changes while it is hardly stretched acts only once it is: as far before the instant at which it is
relaxed as after it, a change leaves nearly the same motion, so that a descent may end at the wrong one of the two.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezoharvest.description.effects.nameless.shapes import StepChange
from piezoharvest.diagnose.discovery.law_fits import LawFit
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.evaluation import sums_of
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.predict.parameters import put
from piezoharvest.predict.prediction import PredictionError

NEAREST, RATIO = 0.5, 1.4  # of distances that are looked at: the first, in samples, and from one to the next
LEAST = 1.0  # decrease of -2 ln L for which it is worth to begin anew


def better_moment(problem: Problem, found: LawFit, farthest: float) -> StepChange | None:
    """The step of a fit at the moment, no farther away than that, where -2 ln L is lowest; None if that is its own.

    Minima that are some way from each other are as wide as a part of it, so that distances grow by a ratio.

    Parameters
    ----------
    problem : Problem
    found : LawFit
        Of a `StepChange` over time.
    farthest : float
        In the unit of the time.
    """
    form, model = found.form, replace(found.found.model, parameters=())
    assert isinstance(form, StepChange)
    count = max(1, int(np.log(farthest / (NEAREST * form.finest)) / np.log(RATIO)))
    away = NEAREST * form.finest * RATIO ** np.arange(count + 1)
    widths = dict.fromkeys((float(form.width), form.finest))
    every = [replace(form, at=form.at + d, width=w) for w in widths for d in (0.0, *away, *-away)]
    some = [k for k, data in enumerate(problem.data) if _may_be_in(data, found.place.input, form.at, farthest)]
    part = Problem([problem.data[k] for k in some], problem.nominal, problem.offset_channels, problem.beliefs)
    nuisance, white = [found.found.nuisance[k] for k in some], [found.found.white[k] for k in some]
    path, costs = ("effects", found.index % len(model.transducer.effects), "form"), []
    for each in every:
        try:
            sums = sums_of(part, replace(model, transducer=put(model.transducer, path, each)), nuisance, white)
        except PredictionError:
            costs.append(np.inf)
            continue
        costs.append(sum(float(mine.squares.sum()) for mine in sums))
    best = int(np.argmin(costs))
    return every[best] if costs[best] < costs[0] - LEAST else None


def _may_be_in(data: Data | FrequencyData, time: str, at: float, farthest: float) -> bool:
    """True if a record shows a change at a moment or near it."""
    size = data.setting.size if isinstance(data, Data) else None
    if time != "campaign_time" or size is None:
        return True
    return size.begin - farthest < at < size.begin + size.length + farthest
