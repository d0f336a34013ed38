"""Where stops are when a record begins: nobody has recorded what came before it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from scipy.stats import chi2

from piezoharvest.identify.fitting.data import Data, data_of
from piezoharvest.identify.fitting.evaluation import at_once
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.likelihood import Sums, Whitener
from piezoharvest.identify.fitting.measured_responses import FrequencyData, ResponseWeights
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit, inverse
from piezoharvest.identify.fitting.problem import Problem, prior_of, renamed
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.identify.noise.spectra import in_time
from piezoharvest.predict.prediction import PredictionError

Tell = Callable[[str], None]

LOADED = 0.1  # of its threshold: a stop that is nearer to zero at the beginning of a record has no history,
CERTAIN = 4.0  # standard errors, nor one that is nearer than these
BETTER = 4.0  # of -2 ln L, by which a record has to fit better for that
NEARLY = 0.9  # of its threshold: next to the end of its range, where any large load has taken a stop
ROUGHLY, FEW = 1.0, 15  # of -2 ln L that may still be promised, and iterations, of what only leads to the next fit
VAGUE = 0.3  # of its threshold: standard error of a stop that the beginning of a record hardly tells
UNDECIDED = 10.0  # of -2 ln L of its beginning, that a history may cost more and still be the record's
BRIEF, WIPED = 1000, 0.95  # samples of a record after its drive has gone through a part of its range
SCALES = (1, 8, 64)  # samples, whose sums show what is too slow, or too short, for the sum of all squares
SUSPECT = 1e-3  # chance that noise alone leaves so much of the beginning of a record


def memories(problem: Problem, model: Model) -> bool:
    """Whether some record may begin with stops that are not at zero."""
    return any(np.any(_histories(problem, model, data)) for data in problem.data)


def remembers(problem: Problem, found: Fit) -> bool:
    """Whether stops of some record plainly were not at zero when it began.

    Nearly all are told by a few samples, and take as much time as parameters do: where they are not needed, they go.
    """
    own = np.concatenate(found.own)
    std = np.sqrt(np.diag(inverse(found.information + found.prior)))[len(found.model.parameters) :]
    std[np.abs(own) >= problem.own_limits(found.model)] = 0.0  # a stop that slips there hides how surely it does
    history = np.concatenate([_histories(problem, found.model, data) for data in problem.data])
    return bool(np.any(np.abs(own) > np.maximum(LOADED, CERTAIN * std), where=history))


def recalled(problem: Problem, found: Fit) -> tuple[np.ndarray, ...] | None:
    """The records' own numbers, where some record is explained better by stops that began elsewhere.

    No small step may lead there: a stop that slips at once hides where it was, and the charge at the beginning stands
    in for it. Where other starts come to is tried on the beginnings of the records, and on the whole of those where
    these do not decide.

    Parameters
    ----------
    problem : Problem
    found : Fit

    Returns
    -------
    tuple of (o,) array, or None where nothing is better
    """
    bare = replace(found.model, parameters=())

    def better(one: Problem, mine: np.ndarray, sums: Sums, white: Whitener | ResponseWeights) -> np.ndarray:
        if not np.any(_histories(one, bare, one.data[0])) or not _suspect(one.data[0], bare, mine, white):
            return mine
        cost = float(sums.squares.sum() + prior_of(one, bare)[1] @ mine**2)
        try:
            starts = _begun(one, bare, mine, found.noise)
        except PredictionError:  # the beginning, cut off, is another problem, which may have no solution
            return mine
        again = _ends(one, bare, starts, found.noise, white=(white,))
        return again[0].own[0] if again and again[0].cost < cost - BETTER else mine

    own = _apart(better, problem, found.own, found.sums, found.white)
    return None if all(new is old for new, old in zip(own, found.own, strict=True)) else own


def _begun(one: Problem, bare: Model, own: np.ndarray, noise: Noise) -> list[np.ndarray]:
    """Own numbers of a record that several histories lead to, those between which its beginning does not decide.

    A load that turned before it came to the record has left small stops at one end and large ones at the other.
    """
    short = Problem([_beginning(one.data[0], one)], one.nominal, one.offset_channels)
    near = _alone(short, bare, renamed(one, [own], short, bare)[0], noise, enough=ROUGHLY)
    past = _histories(short, bare, short.data[0])
    states = np.isin(short.own_names(bare, short.data[0]), _free(short))
    alike = product((0,), (1.0, -1.0), (0.0,))  # and at rest
    several = product(range(np.count_nonzero(past)), (1.0, -1.0), (1.0,))
    starts = []
    for turned, sign, kept in (*alike, *several):
        starts.append(np.where(states, kept * near.own[0], near.own[0]))
        starts[-1][past] = NEARLY * sign * np.where(np.arange(np.count_nonzero(past)) < turned, -1.0, 1.0)
    ends = [near, *_ends(short, bare, starts, noise, white=near.white, enough=ROUGHLY, most=FEW)]
    ends.sort(key=lambda each: each.cost)
    apart: list[Fit] = []
    for end in ends:
        new = all(np.abs(end.own[0] - other.own[0])[past].max() > LOADED for other in apart)
        if new and end.cost < ends[0].cost + UNDECIDED:
            apart.append(end)
    found = [each.own[0] for each in apart]
    # A stop that has not slipped looks like an offset, and stays where it is: it may still come to its end.
    vague = past & (np.sqrt(np.diag(inverse(apart[0].information + apart[0].prior))) > VAGUE)
    if np.any(vague):
        found += [np.where(vague, sign * NEARLY, found[0]) for sign in (1.0, -1.0)]
    return [renamed(short, [each], one, bare, [own])[0] for each in found]


def _suspect(data: Data | FrequencyData, bare: Model, own: np.ndarray, white: Whitener | ResponseWeights) -> bool:
    """Whether the beginning of a record leaves more than noise: another history explains nothing else."""
    if not isinstance(data, Data) or not isinstance(white, Whitener):
        return False
    _, residual, spectrum = next(white.left(bare, own))
    values = in_time(spectrum, len(residual))[: _brief(data)]
    for scale in (scale for scale in SCALES if scale <= len(values)):
        sums = values[: len(values) // scale * scale].reshape(-1, scale, values.shape[1]).sum(axis=1) / np.sqrt(scale)
        squares = np.cumsum((sums**2).sum(axis=1))
        ends = np.unique(np.append(2 ** np.arange(np.log2(len(squares))).astype(int), len(squares)))
        if np.any(chi2.sf(squares[ends - 1], ends * values.shape[1]) < SUSPECT):
            return True
    return False


def _beginning(data: Data | FrequencyData, problem: Problem) -> Data | FrequencyData:
    """First part of a record, until its drive has moved far enough to take all stops to an end of their range."""
    if not isinstance(data, Data):
        return data
    count = _brief(data)
    return data_of(data.record.beginning(count), problem.nominal) if count < len(data) else data


def _brief(data: Data) -> int:
    """Samples of the first part."""
    drive = data.record[data.drive]
    moved = np.maximum.accumulate(drive) - np.minimum.accumulate(drive)
    return BRIEF + int(np.argmax(moved > WIPED * moved[-1]))


def held(
    problem: Problem, model: Model, own: Sequence[np.ndarray] | None, noise: Noise, tell: Tell = lambda text: None
) -> Fit:
    """Fit of the records' own numbers alone."""
    bare = replace(model, parameters=())

    def fitted(own: Sequence[np.ndarray]) -> Fit:
        each = _apart(lambda one, mine: _alone(one, bare, mine, noise).own[0], problem, own)
        return fit(problem, bare, each, noise, estimate_noise=False, tell=tell)

    found = fitted(problem.start(bare) if own is None else own)
    begun = recalled(problem, found)
    return found if begun is None else fitted(begun)


def _apart(function: Callable[..., np.ndarray], problem: Problem, *each: Sequence) -> tuple[np.ndarray, ...]:
    """What a function says of every record, and of what belongs to it: no record knows of another's own numbers."""
    alone = [Problem([data], problem.nominal, problem.offset_channels) for data in problem.data]
    return at_once(function, alone, *each)


def _alone(one: Problem, bare: Model, own: np.ndarray, noise: Noise, **options: Any) -> Fit:
    return fit(one, bare, [own], noise, estimate_noise=False, **options)


def _ends(one: Problem, bare: Model, starts: Sequence[np.ndarray], noise: Noise, **options: Any) -> list[Fit]:
    """Fits of a record's own numbers from several starts, but for those that it cannot be followed from; best first."""
    found = []
    for start in starts:
        with suppress(PredictionError, np.linalg.LinAlgError):
            found.append(_alone(one, bare, start, noise, **options))
    return sorted(found, key=lambda each: each.cost)


def _free(one: Problem) -> tuple[str, ...]:
    """States of a record whose start is free."""
    return one.data[0].setting.free if isinstance(one.data[0], Data) else ()


def _histories(problem: Problem, model: Model, data: Data | FrequencyData) -> np.ndarray:
    """Which of a record's own numbers say where a stop was."""
    return np.array([name.startswith("history") for name in problem.own_names(model, data)], bool)
