"""Parallel evaluation of all records of a problem for a model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.likelihood import Sums, Whitener
from piezoharvest.identify.fitting.measured_responses import FrequencyData, ResponseWeights
from piezoharvest.identify.fitting.model import Model, prediction_of
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.predict.circuit.setting import by_engine
from piezoharvest.progress import Stage, follower
from piezoharvest.threads import threads_for_records

R = TypeVar("R")

_LAST: WeakKeyDictionary[Problem, tuple[Any, tuple[Whitener | ResponseWeights, ...]]] = WeakKeyDictionary()


def whiteners(
    problem: Problem, model: Model, nuisance: Sequence[np.ndarray], noise: Noise
) -> tuple[Whitener | ResponseWeights, ...]:
    """Whiteners of all records, from a model that need not be the best.

    The last ones are kept: the next descent often begins where one has ended, and behind a switch they take as long.
    """
    kinds = model.relaxed, model.at_rest, model.felt
    what = model.transducer, kinds, noise, [each.tobytes() for each in nuisance]
    known, found = _LAST.get(problem, (None, ()))
    if known != what:
        found = tuple(
            ResponseWeights(noise.sigma[data.name], data)
            if isinstance(data, FrequencyData)
            else Whitener(prediction_of(model, data, mine), noise, data)
            for data, mine in zip(problem.data, nuisance, strict=True)
        )
        _LAST[problem] = what, found
    return found


def sums_of(
    problem: Problem, model: Model, nuisance: Sequence[np.ndarray], white: Sequence[Whitener | ResponseWeights]
) -> tuple[Sums, ...]:
    """Sums of all records.

    Raises
    ------
    PredictionError
        The model cannot follow a record.
    """
    for data in problem.data:
        if isinstance(data, Data) and not by_engine(data.setting):
            model.lowered(data)
    found = map_records(lambda each, mine: each.sums(model, mine), white, nuisance)
    model.forget()
    return found


def scattered_sums(
    model: Model, nuisance: Sequence[np.ndarray], white: Sequence[Whitener | ResponseWeights]
) -> tuple[Sums, ...]:
    """Sums of all records of a model that was evaluated before, with the scatter of the gradient."""
    found = map_records(lambda each, mine: each.sums(model, mine, scatter=True), white, nuisance)
    model.forget()
    return found


def map_records(function: Callable[..., R], *each: Iterable) -> tuple[R, ...]:
    """Results of a function for every record and its arguments, as many at a time as there are threads for them.

    Whoever follows the job (`progress.followed`) is told how many records are done.
    """
    arguments, threads = list(zip(*each, strict=True)), threads_for_records()
    stage = Stage(follower(), "comparing with the model", "records")
    if len(arguments) == 1 or threads == 1:  # a thread's memory is kept for the next one: it adds up for a long record
        return tuple(function(*some) for some in stage.over(arguments))
    with ThreadPoolExecutor(threads) as pool:
        return tuple(stage.over(pool.map(function, *zip(*arguments, strict=True)), len(arguments)))


def total_information(
    model: Model, nuisance: Sequence[np.ndarray], sums: Sequence[Sums]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Information, gradient and sum of squares of all records."""
    p, sizes = len(model.parameters), [len(mine) for mine in nuisance]
    total = p + sum(sizes)
    information, gradient, squares, at = np.zeros((total, total)), np.zeros(total), 0.0, p
    for size, part in zip(sizes, sums, strict=True):
        places = np.concatenate([np.arange(p), np.arange(at, at + size)])
        information[np.ix_(places, places)] += part.information.sum(axis=0)
        gradient[places] += part.gradient.sum(axis=0)
        squares += float(part.squares.sum())
        at += size
    return information, gradient, squares
