"""Tuning on the engine: a line search for one free part, a simplex for more, without derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from piezoharvest.design.drafts import Draft
from piezoharvest.design.minimax import Tuned
from piezoharvest.design.region import Region
from piezoharvest.design.starts import Start
from piezoharvest.design.trial import Trial
from piezoharvest.shunts import Shunt

_WIDTH = np.log(2.5)  # half of the first bracket, in e-folds: the closed forms are within 20 %
_ROUGH_WIDTH = np.log(10.0)  # where they are for another excitation
_EXPANSIONS = 3
_EDGE = 0.05  # of the bracket: an optimum this near its end is looked for beyond it
_ACCURACY = 1e-3  # of a part's logarithm; the merit is then flat to 1e-6
_SIMPLEX, _SIMPLEX_ACCURACY, _SIMPLEX_MERIT = 0.1, 5e-3, 1e-5
_MOST_STEPS = 60


def refine(trial: Trial, draft: Draft, start: Start, region: Region | None = None) -> Tuned:
    """Tune the free parts of a shunt from one start by simulation, within a region where one is given."""
    names, before = list(draft.free), trial.simulations

    def shunt_at(p: np.ndarray) -> Shunt:
        p = p if region is None else region.clip(p)
        return draft.with_values({name: float(np.exp(x)) for name, x in zip(names, p, strict=True)})

    def merit(p: np.ndarray) -> float:
        return trial.merit(shunt_at(p))

    p = np.log([start.values[name] for name in names])
    if len(names) == 1:
        width = _WIDTH if trial.view.operation.apart else _ROUGH_WIDTH
        p, method = _line(lambda x: merit(np.array([x])), float(p[0]), width), "line search on the engine"
    else:
        p, method = _simplex(merit, p), "simplex search on the engine"
    return Tuned(shunt_at(p), merit(p), start.formula, method, trial.simulations - before)


def _line(merit: Callable[[float], float], start: float, width: float) -> np.ndarray:
    """Minimum along a line: bounded, the bracket moved on as long as the optimum sits at its edge."""
    centre, best, best_merit = start, start, merit(start)
    for _ in range(_EXPANSIONS):
        bounds = (centre - width, centre + width)
        found: Any = minimize_scalar(merit, bounds=bounds, method="bounded", options={"xatol": _ACCURACY})
        if found.fun < best_merit:
            best, best_merit = float(found.x), float(found.fun)
        if min(found.x - bounds[0], bounds[1] - found.x) > _EDGE * width or found.x == centre:
            break
        centre, width = float(found.x), 2 * width
    return np.array([best])


def _simplex(merit: Callable[[np.ndarray], float], start: np.ndarray) -> np.ndarray:
    """Minimum near a start that is good already."""
    corners = np.vstack((start, start + _SIMPLEX * np.eye(len(start))))
    options = {
        "initial_simplex": corners, "xatol": _SIMPLEX_ACCURACY, "fatol": _SIMPLEX_MERIT, "maxfev": _MOST_STEPS,
    }  # fmt: skip
    found: Any = minimize(merit, start, method="Nelder-Mead", options=options)
    return found.x
