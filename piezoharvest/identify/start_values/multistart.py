"""Starts of a fit: initial estimates from the records, and other thresholds if these end in a poor minimum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.evaluation import sums_of, whiteners
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit, mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.start_values.growing_drives import fit_from_small_drives
from piezoharvest.identify.start_values.initial_estimates import estimate_initial_values
from piezoharvest.identify.start_values.initial_hysteresis_state import fit_nuisance, has_initial_states
from piezoharvest.identify.start_values.resonance_starts import transducers_at_resonances
from piezoharvest.predict.parameters import parameters_of, put, value_at
from piezoharvest.predict.prediction import PredictionError

MAX_MEAN_SQUARE = 1.1  # mean square of the whitened residuals, above which there may be a better minimum
MAX_INITIAL_MEAN_SQUARE = 30.0  # mean square below which initial estimates are certainly near enough
THRESHOLD_FACTORS = (0.7, 1.4)  # factors on the initial thresholds
RESPONSE_ITERATIONS = 40  # iterations from each start of the responses
ROUGH_TOLERANCE = 1e-3  # of -2 ln L for each residual: tolerance of a rough fit


def fit_multistart(
    problem: Problem,
    model: Model,
    progress: Callable[[str], None],
    poor: Callable[[Fit], None] = lambda found: None,
) -> Fit:
    """Fit a model from initial estimates, and from others if the residuals stay much larger than noise.

    The fit is convex enough except in the thresholds of the operators. While stiffness, coupling and capacitance are
    far off, thresholds diverge to compensate, and two of them may merge; so if the records give no initial estimates of
    the thresholds, these are fixed in a first rough fit.

    Parameters
    ----------
    problem : Problem
    model : Model
        Model with the nominal values.
    progress : callable
        Called with messages about progress.
    poor : callable
        Called with a fit whose residuals stay much larger than noise, before other starts are tried; it may
        raise.
    """
    first = _nearest_model(
        problem, model, replace(model, transducer=estimate_initial_values(problem.data, model.transducer))
    )
    first = tune_to_responses(problem, first, progress)
    free = tuple(p for p in model.parameters if p.path[0] != "hysteresis")
    if len(free) == len(model.parameters):
        best = fit(problem, first, progress=progress, rounds=2)
        if mean_square(best) >= MAX_MEAN_SQUARE:
            poor(best)
        return best
    nuisance = None
    if any(len(data.setting.jumps) for data in problem.data if isinstance(data, Data)):
        # The exact instant of a jump of the drive can be mistaken for other errors, so it is fitted first.
        bare = replace(first, parameters=())
        nuisance = fit(
            problem, bare, estimate_noise=False, enough=_rough_tolerance(problem), progress=progress
        ).nuisance
    if first.transducer.hysteresis == model.transducer.hysteresis:
        rough = replace(first, parameters=free)
        rough = fit(problem, rough, nuisance, estimate_noise=False, enough=_rough_tolerance(problem), progress=progress)
        first, nuisance = replace(rough.model, parameters=model.parameters), rough.nuisance
    best = fit(problem, first, nuisance, progress=progress, rounds=2)
    if mean_square(best) < MAX_MEAN_SQUARE:
        return best
    poor(best)
    other = _fit_with_initial_states(problem, replace(first, parameters=model.parameters), nuisance, best, progress)
    if other is None:
        other = _fit_from_small_drives(problem, first, best, progress)
    if other is None:
        other = _fit_with_other_thresholds(problem, first, nuisance, best, progress)
    return best if other is None else fit(problem, other.model, other.nuisance, progress=progress, rounds=2)


def tune_to_responses(problem: Problem, first: Model, progress: Callable[[str], None]) -> Model:
    """Model fitted to the frequency responses alone, from the first model or from their resonances."""
    data = [each for each in problem.data if isinstance(each, FrequencyData)]
    if not data:
        return first
    alone = Problem(data, first.transducer, problem.offset_channels)
    nominal, best = replace(first, offset_channels=()), None
    varied = {parameter.path for parameter in first.parameters}
    kept = [p.path for p in parameters_of(first.transducer, set()) if p.path not in varied]
    for transducer in (*transducers_at_resonances(data, first.transducer, problem.nominal), first.transducer):
        moved = [path for path in kept if value_at(transducer, path) != value_at(first.transducer, path)]
        if any(path[-1] in ("mass", "stiffness") for path in moved):
            continue  # setting it back would shift the resonance again
        for path in moved:
            transducer = put(transducer, path, value_at(first.transducer, path))
        start = replace(nominal, transducer=transducer)
        try:
            found = fit(
                alone, start, enough=_rough_tolerance(alone), rounds=1, estimate_noise=False, most=RESPONSE_ITERATIONS
            )
        except (PredictionError, np.linalg.LinAlgError):
            continue
        if best is None or found.cost < best.cost:
            best = found
        # The cost includes the priors: some starts end far off along directions that the responses do not determine.
        if best.cost < sum(each.allowed for each in data):
            break
    if best is None:
        return first
    progress("start: resonances found in the responses")
    return replace(first, transducer=best.model.transducer)


def _fit_with_initial_states(
    problem: Problem, first: Model, nuisance, best: Fit, progress: Callable[[str], None]
) -> Fit | None:
    """Fit from initial states of stops for the first model, if it is better than the best; else None.

    While initial states of stops are wrong, the operators' parameters change to compensate.
    """
    begun = fit_nuisance(problem, first, nuisance, best.noise)
    if not has_initial_states(problem, begun):
        return None
    progress("another start: other initial states of the stops")
    return _fit_if_better(problem, first, begun.nuisance, best)


def _fit_from_small_drives(
    problem: Problem, first: Model, best: Fit, progress: Callable[[str], None]
) -> Fit | None:  # fmt: skip
    """Fit from the records with small drives on, if it is better than the best; else None.

    Where operators slip through most of a loop, a few per cent in stiffness and coupling may lead to a false minimum.
    """
    try:
        start = fit_from_small_drives(problem, first, best.noise)
    except PredictionError:
        return None
    if start is None:
        return None
    progress("another start: the records with small drives first")
    return _fit_if_better(problem, *start, best)


def _fit_with_other_thresholds(
    problem: Problem, first: Model, nuisance, best: Fit, progress: Callable[[str], None]
) -> Fit | None:
    """The best fit from other thresholds, if it is better than the best; else None."""
    found = None
    for stretch in THRESHOLD_FACTORS:
        progress(f"another start: thresholds {stretch:g} times the first ones")
        found = _fit_if_better(problem, _with_scaled_thresholds(first, stretch), nuisance, found or best) or found
    return found


def _fit_if_better(problem: Problem, start: Model, nuisance, best: Fit) -> Fit | None:
    """Rough fit from a start, if it is better than the best; else None."""
    other = fit(problem, start, nuisance, best.noise, estimate_noise=False, enough=_rough_tolerance(problem))
    return other if other.cost < best.cost - _rough_tolerance(problem) else None


def _nearest_model(problem: Problem, nominal: Model, tuned: Model) -> Model:
    """The model nearest to the records: initial estimates may be wrong if records show an unmodelled effect.

    The operators alone may be wrong, if the loops are due to another effect. Parameters are not varied, so that this
    takes a fraction of an iteration.
    """
    if tuned.transducer == nominal.transducer:
        return nominal
    white = whiteners(problem, nominal, problem.start(nominal), problem.noise())

    def cost(model: Model) -> float:
        bare = replace(model, parameters=())
        try:
            return float(sum(s.squares.sum() for s in sums_of(problem, bare, problem.start(bare), white)))
        except PredictionError:
            return np.inf

    if cost(tuned) < MAX_INITIAL_MEAN_SQUARE * _residual_count(problem):
        return tuned
    again = put(tuned.transducer, ("hysteresis",), nominal.transducer.hysteresis)
    return min((tuned, replace(tuned, transducer=again), nominal), key=cost)


def _residual_count(problem: Problem) -> int:
    """Number of residuals."""
    return sum(len(data) * max(len(data.channels), 1) for data in problem.data)


def _rough_tolerance(problem: Problem) -> float:
    return ROUGH_TOLERANCE * _residual_count(problem)


def _with_scaled_thresholds(model: Model, stretch: float) -> Model:
    transducer = model.transducer
    for j, threshold in enumerate(value_at(transducer, ("hysteresis", "thresholds"))):
        transducer = put(transducer, ("hysteresis", "thresholds", j), stretch * threshold)
    return replace(model, transducer=transducer)
