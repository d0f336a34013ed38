"""Starts of a fit: what the records show at sight, and other thresholds where that ends in a poor minimum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.evaluation import sums_of, whiteners
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.start_values.initial_estimates import first_values
from piezoharvest.identify.start_values.initial_hysteresis_state import held, remembers
from piezoharvest.identify.start_values.resonance_starts import tuned
from piezoharvest.predict.parameters import parameters_of, put, value_at
from piezoharvest.predict.prediction import PredictionError

POOR = 1.1  # mean square of the whitened residuals, above which there may be a better minimum
NEAR = 30.0  # the same of first values that are near enough for sure
STRETCHES = (0.7, 1.4)  # of the first thresholds
TRIED = 40  # iterations from each start of the responses
ROUGH = 1e-3  # of -2 ln L for each residual: what a rough fit leaves


def started(problem: Problem, model: Model, tell: Callable[[str], None]) -> Fit:
    """Fit a model from first values, and from others if these end where residuals are much larger than noise.

    The fit is convex enough in all but the thresholds of the operators. While stiffness, coupling and capacitance are
    far off, thresholds run away to explain it, and two of them may merge; so where the records do not show them at
    sight, they stay for a first rough fit.

    Parameters
    ----------
    problem : Problem
    model : Model
        With the nominal values.
    tell : callable
        Told about progress.
    """
    first = _nearest(problem, model, replace(model, transducer=first_values(problem.data, model.transducer)))
    first = in_tune(problem, first, tell)
    free = tuple(p for p in model.parameters if p.path[0] != "hysteresis")
    if len(free) == len(model.parameters):
        return fit(problem, first, tell=tell, rounds=2)
    own = None
    if any(len(data.setting.jumps) for data in problem.data if isinstance(data, Data)):
        # When exactly a drive jumped looks like anything else until it is told.
        bare = replace(first, parameters=())
        own = fit(problem, bare, estimate_noise=False, enough=_enough(problem), tell=tell).own
    if first.transducer.hysteresis == model.transducer.hysteresis:
        rough = replace(first, parameters=free)
        rough = fit(problem, rough, own, estimate_noise=False, enough=_enough(problem), tell=tell)
        first, own = replace(rough.model, parameters=model.parameters), rough.own
    best = fit(problem, first, own, tell=tell, rounds=2)
    if _excess(best) < POOR:
        return best
    other = _remembering(problem, replace(first, parameters=model.parameters), own, best, tell)
    if other is None:
        other = _restretched(problem, first, own, best, tell)
    return best if other is None else fit(problem, other.model, other.own, tell=tell, rounds=2)


def in_tune(problem: Problem, first: Model, tell: Callable[[str], None]) -> Model:
    """The model that frequency responses by themselves lead to, from the first one or the resonances that they show."""
    data = [each for each in problem.data if isinstance(each, FrequencyData)]
    if not data:
        return first
    alone = Problem(data, first.transducer, problem.offset_channels)
    nominal, best = replace(first, offset_channels=()), None
    varied = {parameter.path for parameter in first.parameters}
    kept = [p.path for p in parameters_of(first.transducer, set()) if p.path not in varied]
    for transducer in (*tuned(data, first.transducer, problem.nominal), first.transducer):
        moved = [path for path in kept if value_at(transducer, path) != value_at(first.transducer, path)]
        if any(path[-1] in ("mass", "stiffness") for path in moved):
            continue  # put back, it would be out of tune again
        for path in moved:
            transducer = put(transducer, path, value_at(first.transducer, path))
        start = replace(nominal, transducer=transducer)
        try:
            found = fit(alone, start, enough=_enough(alone), rounds=1, estimate_noise=False, most=TRIED)
        except (PredictionError, np.linalg.LinAlgError):
            continue
        if best is None or found.cost < best.cost:
            best = found
        # With the priors: from some starts a fit ends far off along what the responses do not tell.
        if best.cost < sum(each.allowed for each in data):
            break
    if best is None:
        return first
    tell("start: the resonances that the responses show")
    return replace(first, transducer=best.model.transducer)


def _remembering(problem: Problem, first: Model, own, best: Fit, tell: Callable[[str], None]) -> Fit | None:
    """Fit from stops that began where the first values want them, if it is better than the best.

    While stops are taken to begin elsewhere than they did, operators exchange their parts to explain it.
    """
    begun = held(problem, first, own, best.noise)
    if not remembers(problem, begun):
        return None
    tell("another start: stops that began elsewhere")
    return _better(problem, first, begun.own, best)


def _restretched(problem: Problem, first: Model, own, best: Fit, tell: Callable[[str], None]) -> Fit | None:
    """The best fit from other thresholds, if it is better than the best."""
    found = None
    for stretch in STRETCHES:
        tell(f"another start: thresholds {stretch:g} times the first ones")
        found = _better(problem, _stretched(first, stretch), own, found or best) or found
    return found


def _better(problem: Problem, start: Model, own, best: Fit) -> Fit | None:
    """Rough fit from there, if it is better than the best."""
    other = fit(problem, start, own, best.noise, estimate_noise=False, enough=_enough(problem))
    return other if other.cost < best.cost - _enough(problem) else None


def _nearest(problem: Problem, nominal: Model, told: Model) -> Model:
    """The model that is nearest to the records: what these seem to tell may be wrong where they hold what no model has.

    Then what they tell of the operators may be wrong alone: their loops may be another effect's. Parameters are not
    varied, so that this takes a fraction of an iteration.
    """
    if told.transducer == nominal.transducer:
        return nominal
    white = whiteners(problem, nominal, problem.start(nominal), problem.noise())

    def cost(model: Model) -> float:
        bare = replace(model, parameters=())
        try:
            return float(sum(s.squares.sum() for s in sums_of(problem, bare, problem.start(bare), white)))
        except PredictionError:
            return np.inf

    if cost(told) < NEAR * _count(problem):
        return told
    again = put(told.transducer, ("hysteresis",), nominal.transducer.hysteresis)
    return min((told, replace(told, transducer=again), nominal), key=cost)


def _count(problem: Problem) -> int:
    """Residuals."""
    return sum(len(data) * max(len(data.channels), 1) for data in problem.data)


def _enough(problem: Problem) -> float:
    return ROUGH * _count(problem)


def _excess(found: Fit) -> float:
    """Mean square of the whitened residuals."""
    return sum(float(sums.squares.sum()) for sums in found.sums) / max(
        sum(float(s.count.sum()) for s in found.sums), 1.0
    )


def _stretched(model: Model, stretch: float) -> Model:
    transducer = model.transducer
    for j, threshold in enumerate(value_at(transducer, ("hysteresis", "thresholds"))):
        transducer = put(transducer, ("hysteresis", "thresholds", j), stretch * threshold)
    return replace(model, transducer=transducer)
