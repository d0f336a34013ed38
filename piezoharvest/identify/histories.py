"""Where stops are when a record begins: nobody has recorded what came before it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from piezoharvest.identify.data import Data
from piezoharvest.identify.descent import Fit
from piezoharvest.identify.fit import fit, inverse
from piezoharvest.identify.model import Model
from piezoharvest.identify.noise import Noise
from piezoharvest.identify.problem import Problem, prior_of
from piezoharvest.identify.responses import FrequencyData
from piezoharvest.predict.prediction import PredictionError

Tell = Callable[[str], None]

LOADED = 0.1  # of its threshold: a stop that is nearer to zero at the beginning of a record has no history,
CERTAIN = 4.0  # standard errors, nor one that is nearer than these
BETTER = 4.0  # of -2 ln L, by which a record has to fit better for that
ENDS = (1.0, -1.0)  # of a stop's range, to which any large load before the record has taken it


def remembers(problem: Problem, found: Fit) -> bool:
    """Whether stops of some record plainly were not at zero when it began.

    Nearly all are told by a few samples, and take as much time as parameters do: where they are not needed, they go.
    """
    own = np.concatenate(found.own)
    std = np.sqrt(np.diag(inverse(found.information + found.prior)))[len(found.model.parameters) :]
    std[np.abs(own) >= problem.own_limits(found.model)] = 0.0  # a stop that slips there hides how surely it does
    history = np.concatenate([_histories(problem, found.model, data) for data in problem.data])
    return not np.any(history) or bool(np.any(np.abs(own) > np.maximum(LOADED, CERTAIN * std), where=history))


def recalled(problem: Problem, found: Fit) -> tuple[np.ndarray, ...] | None:
    """The records' own numbers, where some record is explained better by stops that began at an end of their range.

    No small step may lead there: a stop that slips at once hides where it was, and the charge at the beginning stands
    in for it.

    Parameters
    ----------
    problem : Problem
    found : Fit

    Returns
    -------
    tuple of (o,) array, or None where nothing is better
    """
    bare = replace(found.model, parameters=())
    history = [_histories(problem, bare, data) for data in problem.data]
    if not any(map(np.any, history)):
        return None
    states = [
        np.isin(problem.own_names(bare, data), data.setting.free if isinstance(data, Data) else ())
        for data in problem.data
    ]
    own, costs = list(found.own), [cost - BETTER for cost in _costs(problem, bare, found)]
    for end in ENDS:
        start = [
            np.where(past, end, np.where(moved, 0.0, mine))
            for past, moved, mine in zip(history, states, found.own, strict=True)
        ]
        try:
            other = fit(problem, bare, start, found.noise, estimate_noise=False)
        except (PredictionError, np.linalg.LinAlgError):
            continue
        for k, cost in enumerate(_costs(problem, bare, other)):
            if np.any(history[k]) and cost < costs[k]:
                own[k], costs[k] = other.own[k], cost
    return None if all(new is old for new, old in zip(own, found.own, strict=True)) else tuple(own)


def _costs(problem: Problem, bare: Model, found: Fit) -> list[float]:
    """-2 ln L of each record, with the priors of its own numbers."""
    precision = np.split(prior_of(problem, bare)[1], np.cumsum([len(mine) for mine in found.own])[:-1])
    return [
        float(sums.squares.sum() + weight @ mine**2)
        for sums, weight, mine in zip(found.sums, precision, found.own, strict=True)
    ]


def held(
    problem: Problem, model: Model, own: Sequence[np.ndarray] | None, noise: Noise, tell: Tell = lambda text: None
) -> Fit:
    """Fit of the records' own numbers alone."""
    bare = replace(model, parameters=())
    found = fit(problem, bare, own, noise, estimate_noise=False, tell=tell)
    begun = recalled(problem, found)
    return found if begun is None else fit(problem, bare, begun, noise, estimate_noise=False, tell=tell)


def _histories(problem: Problem, model: Model, data: Data | FrequencyData) -> np.ndarray:
    """Which of a record's own numbers say where a stop was."""
    return np.array([name.startswith("history") for name in problem.own_names(model, data)], bool)
