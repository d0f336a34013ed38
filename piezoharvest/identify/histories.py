"""Where stops are when a record begins: nobody has recorded what came before it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from piezoharvest.identify.data import Data, data_of
from piezoharvest.identify.descent import Fit
from piezoharvest.identify.fit import fit, inverse
from piezoharvest.identify.model import Model
from piezoharvest.identify.noise import Noise
from piezoharvest.identify.problem import Problem, prior_of, renamed
from piezoharvest.identify.responses import FrequencyData
from piezoharvest.predict.prediction import PredictionError

Tell = Callable[[str], None]

LOADED = 0.1  # of its threshold: a stop that is nearer to zero at the beginning of a record has no history,
CERTAIN = 4.0  # standard errors, nor one that is nearer than these
BETTER = 4.0  # of -2 ln L, by which a record has to fit better for that
NEARLY = 0.9  # of its threshold: next to the end of its range, where any large load has taken a stop
ROUGHLY, FEW = 1.0, 6  # of -2 ln L that may still be promised, and iterations, of what only leads to the next fit
BRIEF, MOVED = 1000, 0.05  # samples of a record after its drive has moved, by a part of its range


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
    """The records' own numbers, where some record is explained better by stops that began elsewhere.

    No small step may lead there: a stop that slips at once hides where it was, and the charge at the beginning stands
    in for it. Where other starts come to is tried on the beginnings of the records, which show nearly all of it.

    Parameters
    ----------
    problem : Problem
    found : Fit

    Returns
    -------
    tuple of (o,) array, or None where nothing is better
    """
    bare = replace(found.model, parameters=())
    if not any(np.any(_histories(problem, bare, data)) for data in problem.data):
        return None
    short = Problem([_beginning(data, problem) for data in problem.data], problem.nominal, problem.offset_channels)
    begun = renamed(problem, found.own, short, bare)
    near = fit(short, bare, begun, found.noise, estimate_noise=False, enough=ROUGHLY)
    own = renamed(short, _best(short, near), problem, bare, found.own)
    again = fit(problem, bare, own, found.noise, estimate_noise=False)
    costs = zip(_costs(problem, bare, again), _costs(problem, bare, found), strict=True)
    better = [new < old - BETTER for new, old in costs]
    if not any(better):
        return None
    return tuple(new if some else old for some, new, old in zip(better, again.own, found.own, strict=True))


def _beginning(data: Data | FrequencyData, problem: Problem) -> Data | FrequencyData:
    """First part of a record, until its drive has moved for some time."""
    if not isinstance(data, Data):
        return data
    drive = data.record[data.drive]
    count = BRIEF + int(np.argmax(np.abs(drive - drive[0]) > MOVED * np.ptp(drive)))
    return data_of(data.record.beginning(count), problem.nominal) if count < len(data) else data


def _best(problem: Problem, near: Fit) -> tuple[np.ndarray, ...]:
    """Own numbers of the records, the best that are found from several histories.

    A load that turned before it came to the record has left small stops at one end and large ones at the other.
    """
    bare = near.model
    history = [_histories(problem, bare, data) for data in problem.data]
    free = [np.isin(problem.own_names(bare, d), d.setting.free if isinstance(d, Data) else ()) for d in problem.data]
    own, costs = list(near.own), _costs(problem, bare, near)
    alike = product((0,), (1.0, -1.0), (0.0,))  # and at rest
    several = product(range(max(map(np.count_nonzero, history))), (1.0, -1.0), (1.0,))
    for turned, sign, kept in (*alike, *several):
        start = []
        for past, states, mine in zip(history, free, near.own, strict=True):
            begun = np.where(states, kept * mine, mine)
            begun[past] = NEARLY * sign * np.where(np.arange(np.count_nonzero(past)) < turned, -1.0, 1.0)
            start.append(begun)
        try:
            other = fit(problem, bare, start, near.noise, estimate_noise=False, enough=ROUGHLY, most=FEW)
        except (PredictionError, np.linalg.LinAlgError):
            continue
        for k, cost in enumerate(_costs(problem, bare, other)):
            if cost < costs[k]:
                own[k], costs[k] = other.own[k], cost
    return tuple(own)


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
