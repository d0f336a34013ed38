"""Functions, other than straight lines, of what a memory makes of an input: tried where a law leaves more than noise.

Straight lines with a memory and functions without one are tried first: each takes most of what such a law does, and
tells its place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from piezoharvest.description.effects.nameless.forms import Form
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import (
    CHARGE,
    DIRECT,
    RATE,
    LaggingFunction,
    LateBy,
    Memory,
    Play,
    Relaxation,
)
from piezoharvest.description.effects.nameless.places import CHANNELS, Damper, Place, Reading, Spring
from piezoharvest.description.parameters import ParameterError
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.law_fits import TABLES, LawFit, ScoredLaw, best_of, fitted, score, without_law
from piezoharvest.diagnose.discovery.memories.scores import delays, plays
from piezoharvest.diagnose.discovery.passivity import takes_energy
from piezoharvest.diagnose.discovery.tables.knots import table_for
from piezoharvest.diagnose.discovery.tables.visited import inputs_of_records
from piezoharvest.diagnose.selection.score_tests import extended
from piezoharvest.diagnose.selection.start_values import campaign_scales
from piezoharvest.identify.fitting.levenberg_marquardt import GIVEN_UP, Fit
from piezoharvest.identify.fitting.output_error import excess_of, linearised, mean_square
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Stage, follower

PLACES = 2  # ports and readings at whose likeliest law so far a memory is tried
# Share of the excess over noise without a memory: no other memory explains much of what is left. A table leaves some of
# what its formula explains.
LEAST_LEFT = 0.1
MOST_EXPLAINED = 0.5  # share of what the law so far explains, from which on a fit begins as that with a memory


def leaves_much(law: LawFit) -> bool:
    """True if a law leaves clearly more than noise of the records that it was fitted to."""
    return mean_square(law.found) > 1.0 + thresholds.MIN_LEFT


def leaves_more_than_noise(law: LawFit) -> bool:
    """True if a law leaves more of the fitted records than the scatter of noise; little may be all of unseen ones."""
    count = sum(float(part.count.sum()) for part in law.found.sums)
    return excess_of(law.found) > thresholds.NOISE_DEVIATIONS * np.sqrt(2.0 * count)


def functions_of_memories(
    problem: Problem, start: Fit, done: Sequence[LawFit], progress: Callable[[str], None]
) -> list[LawFit]:
    """Full fits of tables of what memories make of the input, at the likeliest places of the laws that were fitted.

    A fit that will not come as close as the likeliest table so far is abandoned: a table of what a memory makes of the
    input can be that of the input, and has more to adapt.

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
    aim = min(each.evidence for each in done) + thresholds.CLOSE_COST
    for here in _at_places(done)[: 1 if problem.needs_engine else PLACES]:
        bare = without_law(problem, here)
        starts = _starts_of_fits(problem, bare, here)
        for each in Stage(progress, "trying functions of memories", "starts", most=True).over(starts):
            memory = each.law.memory
            assert memory is not None
            again = fitted(problem, bare, each.law, each.visited, each.smoothness.deviation, aim)
            if again is None or again.memory_at_its_end or again.found.message == GIVEN_UP:
                continue
            change = again.found.cost - start.cost
            what = "a lagging function" if isinstance(memory, LaggingFunction) else f"a function of a {memory.kind}"
            progress(f"tried {what} at {again.place.name}: change of the misfit (-2 ln L) {change:+.1f}")
            if not takes_energy(problem, again, -change):
                progress(f"there it would give energy, so that it is no law of the {again.place.name}")
                continue
            found.append(again)
            # A delay looks like a lag, so that both are fitted where both may be.
            if LateBy not in _kinds(_place(here)) and excess_of(again.found) < LEAST_LEFT * excess_of(here.found):
                return found
    return found


def _starts_of_fits(problem: Problem, bare: Fit, here: LawFit) -> list[ScoredLaw]:
    """Tables of a memory from which fits start, first those that begin as the law so far and explain most of its share.

    A score from no law at all says little of a memory where the function explains most: the other parameters are then
    far from where they make up for it.
    """
    scored = _scored(problem, bare, here)
    by_score = _best_of_each_kind(scored, [-each.gain for each in scored])
    if problem.needs_engine:
        return by_score[:1]
    begun = [replace(each, law=replace(each.law, form=_as_the_law(here, each))) for each in scored]
    stage = Stage(follower(), "judging functions of memories", "starts")
    left = np.array([_left(problem, bare, each.law) for each in stage.over(begun)])
    without = linearised(problem, bare.model, bare.nuisance, bare)[2]
    most = without - MOST_EXPLAINED * (without - sum(float(part.squares.sum()) for part in here.found.sums))
    close = np.flatnonzero(left < most)
    return [*_best_of_each_kind([begun[k] for k in close], left[close].tolist()), *by_score]


def _best_of_each_kind(starts: Sequence[ScoredLaw], losses: Sequence[float]) -> list[ScoredLaw]:
    """The start of each kind of memory with the least loss, the least first."""
    best: dict[tuple[type, bool], ScoredLaw] = {}
    for k in np.argsort(losses, kind="stable"):
        best.setdefault(_kind(starts[k].law.memory), starts[k])
    return list(best.values())


def _kind(memory: Memory | None) -> tuple[type, bool]:
    """What a table is a function of: what follows the input, or the difference of the two."""
    return type(memory), memory.follows if isinstance(memory, Play) else not getattr(memory, "behind", False)


def _as_the_law(here: LawFit, start: ScoredLaw) -> Form:
    """The table of a start with kinks that make it the function so far, as nearly as its corners allow."""
    table, x = start.law.form, start.visited
    assert isinstance(table, TABLES)
    units = np.eye(len(table.kinks))
    basis = np.column_stack([np.real(replace(table, kinks=tuple(unit)).values(x)) for unit in units])
    kinks = np.linalg.lstsq(basis, np.real(here.form.values(x)))[0]
    return replace(table, kinks=tuple(map(float, kinks)))


def _left(problem: Problem, bare: Fit, law: Law) -> float:
    """Sum of squares of a model with a law as it is; infinite where it has no solution."""
    model = extended(bare.model, [law], [])
    try:
        return linearised(problem, model, nuisance_for_model(problem, bare.model, bare.nuisance, model), bare)[2]
    except (PredictionError, ParameterError, np.linalg.LinAlgError):
        return np.inf


def _at_places(done: Sequence[LawFit]) -> list[LawFit]:
    """The likeliest law of each port and reading that may have a memory, the likeliest first.

    A current beside a load and one through it are all but the same, and hide a lagging charge that is a third.
    """
    first: dict[tuple[str, str], LawFit] = {}
    for each in best_of(done):
        place = _place(each)
        if _kinds(place):
            first.setdefault((place.input, place.port or place.name), each)
    return list(first.values())


def _place(law: LawFit) -> Place:
    """The place at which a memory is tried: a force over what lags behind a velocity is that of a Maxwell element."""
    return Spring() if isinstance(law.place, Damper) else law.place


def _kinds(place: Place) -> tuple[type[Memory], ...]:
    """Memories of which a place may have a function."""
    if isinstance(place, Reading):
        if place.of == place.channel:
            return Play, Relaxation, LaggingFunction
        return (Relaxation, LateBy) if place.of in CHANNELS else ()
    if place.in_circuit:
        return ()
    lags = (Relaxation, LaggingFunction)
    return {RATE: (Play, *lags), CHARGE: lags, DIRECT: (Relaxation,)}.get(place.port, ())


def _scored(problem: Problem, bare: Fit, here: LawFit) -> list[ScoredLaw]:
    """Scores of tables of what each memory makes of the input."""
    place, found = _place(here), []
    try:
        records = inputs_of_records(problem, bare)
    except PredictionError:  # without its law the model has no solution there
        return []
    inputs = [(step, each[place.input]) for step, each in records if place.input in each]
    starts = _starts(problem, bare, here, np.concatenate([values for _, values in inputs]))
    for memory in Stage(follower(), "scoring functions of memories", "starts").over(starts):
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
    if isinstance(place, Reading):  # what follows with play may be shown
        starts += [replace(each, follows=True) for each in plays(visited)]
    if Relaxation in kinds:
        times = campaign_scales(problem.data, bare).times
        sides = (True, False) if isinstance(place, Reading) else (behind,)
        starts += [Relaxation(time_constant=each, behind=side) for each in times for side in sides]
        starts += [LaggingFunction(time_constant=each) for each in times if LaggingFunction in kinds]
    if LateBy in kinds:
        times = delays(campaign_scales(problem.data, bare), bare.model.transducer)
        starts += [LateBy(delay=each, whole=True) for each in times]
    memory = here.law.memory
    if isinstance(memory, kinds) and not isinstance(here.place, Damper):
        starts.append(replace(memory, behind=behind) if isinstance(memory, Relaxation) else memory)
        if isinstance(memory, Relaxation) and LaggingFunction in kinds:
            starts.append(LaggingFunction(time_constant=memory.time_constant))
    return starts


__all__ = ["functions_of_memories", "leaves_more_than_noise", "leaves_much"]
