"""Tuning on the engine: a line search for one free part, a simplex for more, without derivatives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from piezoharvest.design.drafts import Draft
from piezoharvest.design.minimax import Tuned
from piezoharvest.design.starts import Start
from piezoharvest.design.trial import Trial

_WIDTH = np.log(2.5)  # half of the first bracket, in e-folds: the closed forms are within 20 %
_ROUGH_WIDTH = np.log(10.0)  # where they are for another excitation
_EXPANSIONS = 6
_EDGE = 0.05  # of the bracket: an optimum this near its end is looked for beyond it
_ACCURACY = 5e-4  # of a part's logarithm; the merit is then flat to 1e-7
_SIMPLEX = 0.1
_SIMPLEX_ACCURACY = 2e-3
_MOST_SIMULATIONS = 120


def refine(trial: Trial, draft: Draft, start: Start, limit: float | None = None) -> Tuned:
    """Tune the free parts of a shunt from one start by simulation.

    Parameters
    ----------
    trial : Trial
    draft : Draft
    start : Start
    limit : float, optional
        Largest inductance, H.
    """
    names = list(draft.free)
    p = np.log([start.values[name] for name in names])
    top = np.array([np.log(limit) if limit and name == "inductance" else np.inf for name in names])
    before = trial.simulations

    def merit(q: np.ndarray) -> float:
        values = np.exp(np.minimum(q, top))
        return trial.merit(draft.with_values(dict(zip(names, map(float, values), strict=True))))

    if len(names) == 1:
        width = _WIDTH if trial.operation.apart else _ROUGH_WIDTH
        p, method = _line(lambda x: merit(np.array([x])), float(p[0]), width), "line search on the engine"
    else:
        p, method = _simplex(merit, p), "simplex search on the engine"
    shunt = draft.with_values(dict(zip(names, map(float, np.exp(np.minimum(p, top))), strict=True)))
    return Tuned(shunt, trial.merit(shunt), start.formula, method, trial.simulations - before)


def _line(merit: Callable[[float], float], start: float, width: float) -> np.ndarray:
    """Minimum along a line: bounded, the bracket moved on as long as the optimum sits at its edge."""
    centre, best, best_merit = start, start, merit(start)
    for _ in range(_EXPANSIONS):
        bounds = (centre - width, centre + width)
        found = minimize_scalar(merit, bounds=bounds, method="bounded", options={"xatol": _ACCURACY})
        if found.fun < best_merit:
            best, best_merit = float(found.x), float(found.fun)
        if min(found.x - bounds[0], bounds[1] - found.x) > _EDGE * width or found.x == centre:
            break
        centre = float(found.x)
    return np.array([best])


def _simplex(merit: Callable[[np.ndarray], float], start: np.ndarray) -> np.ndarray:
    """Minimum near a start that is good already."""
    corners = np.vstack((start, start + _SIMPLEX * np.eye(len(start))))
    options = {
        "initial_simplex": corners, "xatol": _SIMPLEX_ACCURACY, "fatol": 1e-7, "maxfev": _MOST_SIMULATIONS,
    }  # fmt: skip
    return minimize(merit, start, method="Nelder-Mead", options=options).x
