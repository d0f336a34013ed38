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
from piezoharvest.identify.sums import Sums
from piezoharvest.predict.prediction import PredictionError

Tell = Callable[[str], None]

LOADED = 0.1  # of its threshold: a stop that is nearer to zero at the beginning of a record has no history,
CERTAIN = 4.0  # standard errors, nor one that is nearer than these
POOR = 1.05  # mean square of a record's whitened residuals, above which its stops may have begun elsewhere
BETTER = 20.0  # of -2 ln L, by which they have to
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
    """The records' own numbers, where some record is plainly explained better by stops that began at an end.

    No small step may lead there: a stop that slips at once hides where it was, and the charge at the beginning stands
    in for it. Only records that are left with more than noise are asked.

    Parameters
    ----------
    problem : Problem
    found : Fit

    Returns
    -------
    tuple of (o,) array, or None where nothing is better
    """
    bare = replace(found.model, parameters=())
    own = [
        _recalled(problem, bare, found, k) if _excess(found.sums[k]) > POOR else mine
        for k, mine in enumerate(found.own)
    ]
    return None if all(new is old for new, old in zip(own, found.own, strict=True)) else tuple(own)


def held(
    problem: Problem, model: Model, own: Sequence[np.ndarray] | None, noise: Noise, tell: Tell = lambda text: None
) -> Fit:
    """Fit of the records' own numbers alone."""
    bare = replace(model, parameters=())
    found = fit(problem, bare, own, noise, estimate_noise=False, tell=tell)
    begun = recalled(problem, found)
    return found if begun is None else fit(problem, bare, begun, noise, estimate_noise=False, tell=tell)


def _recalled(problem: Problem, bare: Model, found: Fit, k: int) -> np.ndarray:
    """Own numbers of one record, the best that is found from both ends of the stops' range."""
    data, best = problem.data[k], found.own[k]
    history = _histories(problem, bare, data)
    if not isinstance(data, Data) or not np.any(history):
        return best
    alone = Problem([data], problem.nominal, problem.offset_channels)
    cost = float(found.sums[k].squares.sum() + prior_of(alone, bare)[1] @ best**2) - BETTER
    states = np.isin(problem.own_names(bare, data), data.setting.free)
    for end in ENDS:
        start = np.where(history, end, np.where(states, 0.0, found.own[k]))
        try:
            other = fit(alone, bare, [start], found.noise, estimate_noise=False)
        except (PredictionError, np.linalg.LinAlgError):
            continue
        if other.cost < cost:
            best, cost = other.own[0], other.cost
    return best


def _excess(sums: Sums) -> float:
    """Mean square of a record's whitened residuals."""
    return float(sums.squares.sum() / max(sums.count.sum(), 1.0))


def _histories(problem: Problem, model: Model, data: Data | FrequencyData) -> np.ndarray:
    """Which of a record's own numbers say where a stop was."""
    return np.array([name.startswith("history") for name in problem.own_names(model, data)], bool)
