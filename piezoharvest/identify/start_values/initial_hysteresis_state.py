"""Initial states of stop operators at the beginning of a record, from an unrecorded load history."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from scipy.stats import chi2

from piezoharvest.identify.fitting.data import Data, data_of
from piezoharvest.identify.fitting.evaluation import map_records
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.likelihood import Sums, Whitener
from piezoharvest.identify.fitting.measured_responses import FrequencyData, ResponseWeights
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit, inverse
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_problem, prior_of
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.identify.noise.spectra import in_time
from piezoharvest.predict.prediction import PredictionError

Progress = Callable[[str], None]

MIN_INITIAL_STATE = 0.1  # of its threshold: a stop nearer to zero at the beginning of a record has no history,
MIN_STANDARD_ERRORS = 4.0  # standard errors: nor has a stop nearer to zero than these
MIN_COST_DECREASE = 4.0  # of -2 ln L, by which another history must improve the fit of a record
LOADED_STATE = 0.9  # of its threshold: near the end of its range, to which any large load takes a stop
# Predicted decrease of -2 ln L at the end, and iterations, of preliminary fits.
ROUGH_TOLERANCE = 1.0
ROUGH_ITERATIONS = 15
UNCERTAIN_STATE_ERROR = (
    0.3  # of its threshold: standard error of a stop that the beginning of a record hardly determines
)
MAX_COST_EXCESS = 10.0  # of -2 ln L of a record's beginning: largest excess of a history that is still possible
# Samples of a beginning after the drive has covered this share of its range.
BEGINNING_SAMPLES = 1000
COVERED_RANGE = 0.95
SUM_LENGTHS = (1, 8, 64)  # samples per sum, to detect residuals too slow or short for the sum of all squares
FALSE_ALARM_PROBABILITY = 1e-3  # probability that noise alone leaves such residuals at the beginning of a record


def may_have_initial_states(problem: Problem, model: Model) -> bool:
    """True if some record may begin with stops that are not at zero."""
    return any(np.any(_history_mask(problem, model, data)) for data in problem.data)


def has_initial_states(problem: Problem, found: Fit) -> bool:
    """True if stops of some record clearly were not at zero when it began.

    Initial states affect a few samples only, but cost as much time as parameters: they are dropped if not needed.
    """
    nuisance = np.concatenate(found.nuisance)
    std = np.sqrt(np.diag(inverse(found.information + found.prior)))[len(found.model.parameters) :]
    std[np.abs(nuisance) >= problem.nuisance_limits(found.model)] = (
        0.0  # a stop at its limit has no valid standard error
    )
    history = np.concatenate([_history_mask(problem, found.model, data) for data in problem.data])
    return bool(np.any(np.abs(nuisance) > np.maximum(MIN_INITIAL_STATE, MIN_STANDARD_ERRORS * std), where=history))


def search_initial_states(problem: Problem, found: Fit) -> tuple[np.ndarray, ...] | None:
    """Nuisance parameters of the records, if some record is explained better by other initial states of its stops.

    Small steps may not lead there: a stop that slips at once hides its initial state, and the initial charge takes its
    place. Other starts are tried on the beginnings of the records, and on whole records if these do not decide.

    Parameters
    ----------
    problem : Problem
    found : Fit

    Returns
    -------
    tuple of (o,) array, or None if no other states are better
    """
    bare = replace(found.model, parameters=())

    def better(one: Problem, mine: np.ndarray, sums: Sums, white: Whitener | ResponseWeights) -> np.ndarray:
        if not np.any(_history_mask(one, bare, one.data[0])) or not _exceeds_noise(one.data[0], bare, mine, white):
            return mine
        cost = float(sums.squares.sum() + prior_of(one, bare)[1] @ mine**2)
        try:
            starts = _candidate_states(one, bare, mine, found.noise)
        except PredictionError:  # the beginning alone is another problem, which may have no solution
            return mine
        again = _fits_from(one, bare, starts, found.noise, white=(white,))
        return again[0].nuisance[0] if again and again[0].cost < cost - MIN_COST_DECREASE else mine

    nuisance = _for_each_record(better, problem, found.nuisance, found.sums, found.white)
    return None if all(new is old for new, old in zip(nuisance, found.nuisance, strict=True)) else nuisance


def _candidate_states(one: Problem, bare: Model, nuisance: np.ndarray, noise: Noise) -> list[np.ndarray]:
    """Nuisance parameters of a record for several histories between which its beginning does not decide.

    A load that reversed before the record has left stops with small thresholds at one end and others at the other.
    """
    short = Problem([_beginning(one.data[0], one)], one.nominal, one.offset_channels)
    near = _fit_record(
        short, bare, nuisance_for_problem(one, [nuisance], short, bare)[0], noise, enough=ROUGH_TOLERANCE
    )
    past = _history_mask(short, bare, short.data[0])
    states = np.isin(short.nuisance_names(bare, short.data[0]), _free_states(short))
    alike = product((0,), (1.0, -1.0), (0.0,))  # and at rest
    several = product(range(np.count_nonzero(past)), (1.0, -1.0), (1.0,))
    starts = []
    for turned, sign, kept in (*alike, *several):
        starts.append(np.where(states, kept * near.nuisance[0], near.nuisance[0]))
        starts[-1][past] = LOADED_STATE * sign * np.where(np.arange(np.count_nonzero(past)) < turned, -1.0, 1.0)
    ends = [
        near,
        *_fits_from(short, bare, starts, noise, white=near.white, enough=ROUGH_TOLERANCE, most=ROUGH_ITERATIONS),
    ]
    ends.sort(key=lambda each: each.cost)
    apart: list[Fit] = []
    for end in ends:
        new = all(np.abs(end.nuisance[0] - other.nuisance[0])[past].max() > MIN_INITIAL_STATE for other in apart)
        if new and end.cost < ends[0].cost + MAX_COST_EXCESS:
            apart.append(end)
    found = [each.nuisance[0] for each in apart]
    # A stop that has not slipped acts as an offset and keeps its state: it may still reach its end later.
    vague = past & (np.sqrt(np.diag(inverse(apart[0].information + apart[0].prior))) > UNCERTAIN_STATE_ERROR)
    if np.any(vague):
        found += [np.where(vague, sign * LOADED_STATE, found[0]) for sign in (1.0, -1.0)]
    return [nuisance_for_problem(short, [each], one, bare, [nuisance])[0] for each in found]


def _exceeds_noise(
    data: Data | FrequencyData, bare: Model, nuisance: np.ndarray, white: Whitener | ResponseWeights
) -> bool:
    """True if residuals at the beginning of a record exceed noise, as a wrong history would cause."""
    if not isinstance(data, Data) or not isinstance(white, Whitener):
        return False
    _, residual, spectrum = next(white.left(bare, nuisance))
    values = in_time(spectrum, len(residual))[: _beginning_samples(data)]
    for scale in (scale for scale in SUM_LENGTHS if scale <= len(values)):
        sums = values[: len(values) // scale * scale].reshape(-1, scale, values.shape[1]).sum(axis=1) / np.sqrt(scale)
        squares = np.cumsum((sums**2).sum(axis=1))
        ends = np.unique(np.append(2 ** np.arange(np.log2(len(squares))).astype(int), len(squares)))
        if np.any(chi2.sf(squares[ends - 1], ends * values.shape[1]) < FALSE_ALARM_PROBABILITY):
            return True
    return False


def _beginning(data: Data | FrequencyData, problem: Problem) -> Data | FrequencyData:
    """First part of a record, until its drive has moved far enough to bring all stops to an end of their range."""
    if not isinstance(data, Data):
        return data
    count = _beginning_samples(data)
    return data_of(data.record.beginning(count), problem.nominal, data.levels) if count < len(data) else data


def _beginning_samples(data: Data) -> int:
    """Number of samples of the first part."""
    drive = data.record[data.drive]
    moved = np.maximum.accumulate(drive) - np.minimum.accumulate(drive)
    return BEGINNING_SAMPLES + int(np.argmax(moved > COVERED_RANGE * moved[-1]))


def fit_nuisance(
    problem: Problem,
    model: Model,
    nuisance: Sequence[np.ndarray] | None,
    noise: Noise,
    progress: Progress = lambda text: None,
) -> Fit:
    """Fit of the records' nuisance parameters, with the model's parameters fixed."""
    bare = replace(model, parameters=())

    def fitted(nuisance: Sequence[np.ndarray]) -> Fit:
        each = _for_each_record(lambda one, mine: _fit_record(one, bare, mine, noise).nuisance[0], problem, nuisance)
        return fit(problem, bare, each, noise, estimate_noise=False, progress=progress)

    found = fitted(problem.start(bare) if nuisance is None else nuisance)
    begun = search_initial_states(problem, found)
    return found if begun is None else fitted(begun)


def _for_each_record(function: Callable[..., np.ndarray], problem: Problem, *each: Sequence) -> tuple[np.ndarray, ...]:
    """Results of a function for each record separately: the records' nuisance parameters are independent."""
    alone = [Problem([data], problem.nominal, problem.offset_channels) for data in problem.data]
    return map_records(function, alone, *each)


def _fit_record(one: Problem, bare: Model, nuisance: np.ndarray, noise: Noise, **options: Any) -> Fit:
    return fit(one, bare, [nuisance], noise, estimate_noise=False, **options)


def _fits_from(one: Problem, bare: Model, starts: Sequence[np.ndarray], noise: Noise, **options: Any) -> list[Fit]:
    """Fits of a record's nuisance parameters from several starts, best first; starts that fail are left out."""
    found = []
    for start in starts:
        with suppress(PredictionError, np.linalg.LinAlgError):
            found.append(_fit_record(one, bare, start, noise, **options))
    return sorted(found, key=lambda each: each.cost)


def _free_states(one: Problem) -> tuple[str, ...]:
    """States of a record whose initial values are free."""
    return one.data[0].setting.free if isinstance(one.data[0], Data) else ()


def _history_mask(problem: Problem, model: Model, data: Data | FrequencyData) -> np.ndarray:
    """Mask of a record's nuisance parameters that are initial states of stops."""
    return np.array([name.startswith("history") for name in problem.nuisance_names(model, data)], bool)
