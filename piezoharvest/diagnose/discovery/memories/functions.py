"""Functions, other than straight lines, of what a memory makes of an input: tried where a law leaves more than noise.

Straight lines with a memory and functions without one are tried first: each takes most of what such a law does, and
tells its place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import CHARGE, DIRECT, RATE, Memory, Play, Relaxation
from piezoharvest.description.effects.nameless.places import Damper, Place, Reading, Spring
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.knots import table_for
from piezoharvest.diagnose.discovery.law_fits import LawFit, ScoredLaw, best_of, fitted, score, without_law
from piezoharvest.diagnose.discovery.memories.scores import plays
from piezoharvest.diagnose.discovery.passivity import takes_energy
from piezoharvest.diagnose.discovery.visited import inputs_of_records
from piezoharvest.diagnose.selection.start_values import campaign_scales
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.predict.prediction import PredictionError

PLACES = 2  # likeliest places of laws so far at which a memory is tried


def leaves_much(law: LawFit) -> bool:
    """True if a law leaves clearly more than noise of the records that it was fitted to."""
    return mean_square(law.found) > 1.0 + thresholds.MIN_LEFT


def functions_of_memories(
    problem: Problem, start: Fit, done: Sequence[LawFit], progress: Callable[[str], None]
) -> list[LawFit]:
    """Full fits of tables of what memories make of the input, at the likeliest places of the laws that were fitted.

    Parameters
    ----------
    problem : Problem
    start : Fit
        Before any of the laws.
    done : sequence of LawFit
        Laws at several places.
    progress : callable
    """
    found: list[LawFit] = []
    for here in _at_places(done)[: 1 if problem.needs_engine else PLACES]:
        bare = without_law(problem, here)
        for each in _best_of_each_kind(_scored(problem, bare, here))[: 1 if problem.needs_engine else None]:
            memory = each.law.memory
            assert memory is not None
            again = fitted(problem, bare, each.law, each.visited, each.smoothness.deviation)
            if again is None or again.memory_at_its_end:
                continue
            change = again.found.cost - start.cost
            progress(f"tried a function of a {memory.kind} at {again.place.name}: -2 ln L {change:+.1f}")
            if takes_energy(problem, again, -change):
                found.append(again)
            else:
                progress(f"there it would give energy, so that it is no law of the {again.place.name}")
    return found


def _best_of_each_kind(scored: Sequence[ScoredLaw]) -> list[ScoredLaw]:
    """The best start of each kind of memory, the highest score first."""
    best: dict[type[Memory | None], ScoredLaw] = {}
    for each in sorted(scored, key=lambda each: -each.gain):
        best.setdefault(type(each.law.memory), each)
    return list(best.values())


def _at_places(done: Sequence[LawFit]) -> list[LawFit]:
    """The likeliest law of each place that may have a function of a memory, the likeliest place first."""
    first: dict[Place, LawFit] = {}
    for each in best_of(done):
        if _kinds(_place(each)):
            first.setdefault(_place(each), each)
    return list(first.values())


def _place(law: LawFit) -> Place:
    """The place at which a memory is tried: a force over what lags behind a velocity is that of a Maxwell element."""
    return Spring() if isinstance(law.place, Damper) else law.place


def _kinds(place: Place) -> tuple[type[Memory], ...]:
    """Memories of which a place may have a function."""
    if isinstance(place, Reading):
        return (Play, Relaxation) if place.of == place.channel else ()
    if place.in_circuit:
        return ()
    return {RATE: (Play, Relaxation), CHARGE: (Relaxation,), DIRECT: (Relaxation,)}.get(place.port, ())


def _scored(problem: Problem, bare: Fit, here: LawFit) -> list[ScoredLaw]:
    """Scores of tables of what each memory makes of the input."""
    place, found = _place(here), []
    try:
        records = inputs_of_records(problem, bare)
    except PredictionError:  # without its law the model has no solution there
        return []
    inputs = [(step, each[place.input]) for step, each in records if place.input in each]
    for memory in _starts(problem, bare, here, np.concatenate([values for _, values in inputs])):
        visited = np.concatenate([memory.made_of(values, step) for step, values in inputs])
        form = table_for(place, visited, remembered=True)
        if form is None:
            continue
        each = score(problem, bare, Law(place=place, form=form, memory=memory), visited)
        found += [each] if each is not None else []
    return found


def _starts(problem: Problem, bare: Fit, here: LawFit, visited: np.ndarray) -> list[Memory]:
    """Memories that are tried: that of the law so far, and starts of each kind."""
    place, kinds = _place(here), _kinds(_place(here))
    behind = isinstance(place, Reading) or place.port == RATE  # a force of how far: that of a Maxwell element
    starts: list[Memory] = list(plays(visited)) if Play in kinds else []
    if Relaxation in kinds:
        times = campaign_scales(problem.data, bare).times
        starts += [Relaxation(time_constant=each, behind=behind) for each in times]
    memory = here.law.memory
    if isinstance(memory, kinds) and not isinstance(here.place, Damper):
        starts.append(replace(memory, behind=behind) if isinstance(memory, Relaxation) else memory)
    return starts


__all__ = ["functions_of_memories", "leaves_much"]
