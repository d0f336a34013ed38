"""Fit of all parameters that begins with parts of the records and grows to the whole of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from piezoharvest.identify.fitting.data import Data, data_of
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_problem
from piezoharvest.identify.start_values.away_from_jumps import fit_past_jumps
from piezoharvest.predict.prediction import PredictionError

INITIAL_SAMPLES = 1 << 19  # samples of a record that are fitted first
# Of many records: those of each kind that are fitted first, fewer where there are many kinds, and how many times as
# many there have to be. They determine where the fit of all begins, which then takes a few iterations.
SOME_RECORDS, OF_ALL_KINDS, MANY_TIMES = 8, 16, 4
# Behind circuits: periods of the nominal resonance in the first fit, over which one that is 5 % off loses less than
# half a turn, and the factor by which the records then grow, as the resonance is known that much better.
FIRST_PERIODS, MIN_FIRST_SAMPLES, GROWTH, MAX_STAGES = 8, 200, 4, 6


def growing_fit(
    problem: Problem,
    model: Model,
    progress: Callable[[str], None] = lambda text: None,
    poor: Callable[[Fit], None] = lambda found: None,
) -> Fit:
    """Fit of all parameters, first to the beginnings of some records: of long and many ones, to save time.

    Of records behind circuits with events to a few periods, then to more and more: over a whole record a resonance that
    is a per cent off loses the phase, and the cost has many minima.
    """
    lengths = [INITIAL_SAMPLES]
    if problem.has_events:
        longest = max(len(each) for each in problem.data if isinstance(each, Data))
        lengths = [n for n in first_lengths(problem) if n < longest] + lengths
    some = _some(problem)
    part = beginning(some, lengths[0])
    found = fit_past_jumps(part, model, progress, poor)
    for length in [*lengths[1:], max(len(each) for each in some.data)]:
        before, part = part, beginning(some, length)
        if part is not before:
            progress("longer parts of the records: the misfit is that of more samples")
            nuisance = nuisance_for_problem(before, found.nuisance, part, found.model)
            try:
                found = fit(part, found.model, nuisance, found.noise, progress=progress, rounds=2)
            except PredictionError:  # what fits the beginning best cannot follow the rest
                found = fit_past_jumps(part, model, progress, poor)
    if some is problem:
        return found
    progress("all records: the misfit is that of more samples")
    known = dict(zip(map(id, some.data), found.nuisance, strict=True))
    nuisance = [known.get(id(each), mine) for each, mine in zip(problem.data, problem.start(found.model), strict=True)]
    return fit(problem, found.model, nuisance, found.noise, progress=progress, rounds=2)


def _some(problem: Problem) -> Problem:
    """The problem with some records of each drive, circuit and set of channels, from small to large drives.

    The problem itself if it has not many more.
    """
    kinds: dict[tuple, list[Data]] = {}
    for each in problem.data:
        if isinstance(each, Data):
            kinds.setdefault((each.drive, each.setting.shunt, each.channels), []).append(each)
    kept, most = set[int](), min(SOME_RECORDS, max(2, OF_ALL_KINDS // max(len(kinds), 1)))
    for alike in kinds.values():
        alike.sort(key=lambda each: float(np.ptp(each.record[each.drive])))
        places = np.linspace(0, len(alike) - 1, min(most, len(alike))).round().astype(int)
        kept |= {id(alike[k]) for k in places}
    some = [each for each in problem.data if not isinstance(each, Data) or id(each) in kept]
    if len(some) * MANY_TIMES > len(problem.data):
        return problem
    return Problem(some, problem.nominal, problem.offset_channels)


def first_lengths(problem: Problem) -> list[int]:
    """Numbers of samples of the first fits behind circuits: a few periods of the nominal resonance, then more."""
    device = problem.nominal
    period = 2.0 * np.pi * np.sqrt(device.mass / device.stiffness)
    step = min(each.setting.sample_time for each in problem.data if isinstance(each, Data))
    first = max(int(FIRST_PERIODS * period / step), MIN_FIRST_SAMPLES)
    return [first * GROWTH**k for k in range(MAX_STAGES) if first * GROWTH**k < INITIAL_SAMPLES]


def beginning(problem: Problem, count: int) -> Problem:
    """The problem with the first samples of its records; the problem itself if none is longer."""

    def begun(each: Data | FrequencyData) -> Data | FrequencyData:
        if not isinstance(each, Data) or len(each) <= count or each.record.periodic:
            return each
        return data_of(each.record.beginning(count), problem.nominal, each.levels)

    data = [begun(each) for each in problem.data]
    if all(one is other for one, other in zip(data, problem.data, strict=True)):
        return problem
    return Problem(data, problem.nominal, problem.offset_channels)
