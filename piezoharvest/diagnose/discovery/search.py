"""Search for a law without a name: all places scored, the promising ones fitted, the best condensed to a formula."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.description.effects.nameless.forms import Bends, Form, Line
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Delay, LateBy, Play, Relaxation
from piezoharvest.description.effects.nameless.places import TIMES, LoadCurrent, OverTime, Place, Reading
from piezoharvest.description.effects.nameless.shapes import StepChange
from piezoharvest.description.parameters import ParameterError
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.fits_of_laws import FitsOfLaws, words
from piezoharvest.diagnose.discovery.forms.formulas import beside, ranked
from piezoharvest.diagnose.discovery.forms.known import named
from piezoharvest.diagnose.discovery.law_fits import (
    FIT_TOLERANCE,
    LawFit,
    ScoredLaw,
    best_of,
    ended,
    fitted,
    score,
    without_law,
)
from piezoharvest.diagnose.discovery.memories.functions import (
    functions_of_memories,
    leaves_more_than_noise,
    leaves_much,
)
from piezoharvest.diagnose.discovery.memories.in_loops import from_more_times
from piezoharvest.diagnose.discovery.memories.scores import memories_at, score_memories
from piezoharvest.diagnose.discovery.places import every_place, over_campaign
from piezoharvest.diagnose.discovery.tables.knots import table_for
from piezoharvest.diagnose.discovery.tables.visited import Visited, visited_inputs
from piezoharvest.diagnose.selection.start_values import CampaignScales, campaign_scales
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import fit, mean_square
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.predict.parameters import Parameter
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Stage

FITS, MEMORY_FITS = 5, 4  # places with the highest scores that are fitted in full, without a memory and with one
MIN_SCORE = 20.0  # of -2 ln L: below it a place may owe its score to chance among some thirty
MOST_LAGGING = 1.5  # share of a load's current: halfway between a lag of all of it and the lag that a delay looks like
RIVALS = 4  # other places that are reported

Places = Callable[[Problem, Visited], list[Place]]


@dataclass(frozen=True, eq=False)
class Found:
    """The best law, and other places by increasing loss; `tried` is the number of places that were scored.

    `start` is the fit before it, `table` that of its table, from which the odds of the rivals are. `forms` are those
    that were fitted at the place, the likeliest first, and `known` is a fit with the effect that the law is, if it is
    one of the library.
    """

    best: LawFit
    table: LawFit
    rivals: tuple[LawFit, ...]
    start: Fit
    tried: int
    forms: tuple[LawFit, ...]
    known: Fit | None = None
    ruled_out: tuple[tuple[Law, float], ...] = ()

    @property
    def final(self) -> Fit:
        """The fit with the law, or the known effect that it is."""
        return self.best.found if self.known is None else self.known

    def with_final(self, final: Fit) -> Found:
        """The same law in another fit of it."""
        if self.known is not None:
            return replace(self, known=final)
        return replace(self, best=replace(self.best, found=final))

    def log_odds(self, rival: LawFit) -> float:
        """Logarithm of the odds of another place against the best, both with tables; with a memory it is a formula."""
        best = self.table.evidence if rival.law.memory is None else self.forms[0].criterion
        return 0.5 * (best - rival.evidence)

    @property
    def close(self) -> tuple[LawFit, ...]:
        """Rivals that the data do not rule out."""
        return tuple(each for each in self.rivals if self.log_odds(each) > -thresholds.MIN_LOG_ODDS)


def can_search(problem: Problem) -> bool:
    """True for records over time, behind any circuit: a frequency response has no corners of a law."""
    return all(isinstance(data, Data) for data in problem.data)


def search(problem: Problem, start: Fit, progress: Callable[[str], None], places: Places = every_place) -> Found | None:
    """The law that is missing from a model; None where no place promises any.

    Parameters
    ----------
    problem : Problem
    start : Fit
        Of the model without it.
    progress : callable
    places : callable
        Places at which it may be.
    """
    misfit = mean_square(start)
    scored = _scored(problem, start, places, progress)
    chosen = promising(scored, misfit)
    fits = FitsOfLaws(problem, start)
    fits.try_all(chosen, progress)
    done = fits.done
    if not done:
        return None
    table, forms = _likeliest(problem, start, fits)
    if leaves_more_than_noise(forms[0]) and not fits.is_dominant(forms[0]):
        table, forms = _of_memory(problem, start, done, (table, forms), progress)
    rivals = [each for each in best_of(done) if not _alike(each, table)]
    ruled_out = sorted(fits.ruled_out, key=lambda pair: -pair[1])[:RIVALS]
    progress(f"the likeliest law is at {words(forms[0].law)}: {forms[0].law.name}")
    best = with_its_noise(problem, forms[0])
    as_known = named(problem, best)
    if as_known is not None:
        progress(f"it is {as_known.model.transducer.effects[-1].name}")
    return Found(
        best, table, tuple(rivals[:RIVALS]), start, len(scored), tuple(forms), as_known, tuple(ruled_out)
    )  # fmt: skip


def search_campaign(problem: Problem, start: Fit, progress: Callable[[str], None]) -> Found | None:
    """As `search`, of what changes within a campaign; None where that leaves more than noise.

    It is tried first where the misfit is large: what a law without memory or time makes of such a change says nothing,
    and takes long.
    """
    if mean_square(start) <= thresholds.LARGE_MISFIT or problem.needs_engine:
        return None
    if not over_campaign(problem, visited_inputs(problem, start)):
        return None
    progress("what changes at a moment of the campaign is looked for first, as the misfit is large")
    found = search(problem, start, progress, over_campaign)
    return None if found is None or leaves_much(found.best) else found


def instead(problem: Problem, found: Found) -> Found | None:
    """The same with the next place that fitted records do not rule out; None where there is none.

    The best one goes: unseen records have ruled it out.
    """
    if not found.close:
        return None
    table, *rivals = found.close
    forms = ranked(problem, table) if table.law.memory is None else [table]
    best = with_its_noise(problem, forms[0])
    return replace(found, best=best, table=table, rivals=tuple(rivals), forms=tuple(forms), known=named(problem, best))


def with_all_free(problem: Problem, found: Found, given: Sequence[Parameter]) -> Found:
    """The same law and its rivals in fits in which given parameters are free, too, that were held without a law.

    They were not determined beside what was missing, or had gone far from their nominal values. With them held, the law
    is in the right place, but neither what it leaves nor its formula can be told.
    """
    known = {parameter.path for parameter in found.best.found.model.parameters}
    held = tuple({parameter.path: parameter for parameter in given if parameter.path not in known}.values())
    table = _freed(problem, found.table, held) if held else None
    if table is None:
        return found
    forms = ranked(problem, table) if table.law.memory is None else [table]
    best = with_its_noise(problem, forms[0])
    rivals = [_freed(problem, each, held) or each for each in found.rivals]
    return replace(
        found, best=best, table=table, rivals=tuple(best_of(rivals)), forms=tuple(forms), known=named(problem, best)
    )


def _freed(problem: Problem, law: LawFit, held: Sequence[Parameter]) -> LawFit | None:
    """A fit with more parameters free, None where that does not come to an end; the law remains the last effect."""
    found = law.found
    model = replace(found.model, parameters=(*held, *found.model.parameters))
    nuisance = nuisance_for_model(problem, found.model, found.nuisance, model)
    try:
        free = fit(problem, model, nuisance, found.noise, white=found.white, estimate_noise=False, enough=FIT_TOLERANCE)
    except (PredictionError, ParameterError, np.linalg.LinAlgError):
        return None
    # What the data do not determine is free, too: its uncertainty is that of others.
    return replace(law, found=free) if free.converged and free.cost < found.cost + FIT_TOLERANCE else None


def _likeliest(problem: Problem, start: Fit, fits: FitsOfLaws) -> tuple[LawFit, list[LawFit]]:
    """The likeliest law as it was fitted first, and its forms: a free function, or a memory if that does better.

    A memory is a formula already; of the free functions the likeliest is condensed to one before the two are compared,
    unless one of these is `condensed` to what leaves but noise.
    """
    done, least = fits.done, min(each.evidence for each in fits.done)
    for table, forms in fits.condensed.items():
        if not leaves_much(forms[0]) and forms[0].criterion <= least:  # what is scored as high is fitted after it
            return table, forms
    with_memory = _at_their_ends(problem, start, best_of([each for each in done if each.law.memory is not None]))
    found = [(forms[0], forms) for forms in (_lag_and_delay(problem, each) for each in with_memory)]
    for table in best_of([each for each in done if each.law.memory is None])[:1]:
        # A step of the engine takes ten times as long with a spline as with corners, and a formula follows anyway.
        smoother = [] if problem.needs_engine else _smoother(problem, start, table)
        smooth = min((table, *smoother), key=lambda each: each.evidence)
        forms = fits.formulas(smooth)
        # Nine corners tell badly which of some curves that are alike it is. In the engine each would take minutes.
        nearby = [] if problem.needs_engine else beside(problem, forms)
        found.append((smooth, sorted((*forms, *nearby), key=lambda each: each.criterion)))
    found += [(table, ranked(problem, table)) for table in _tables_of_steps(problem, start, done, found)]
    return min(found, key=lambda each: each[1][0].criterion)


def _at_their_ends(problem: Problem, start: Fit, laws: Sequence[LawFit]) -> list[LawFit]:
    """The first of laws with a memory, or where its fit was stopped far from its end, the likeliest at its place."""
    if not laws or laws[0].found.converged:
        return list(laws[:1])
    return best_of([ended(problem, start, each) for each in laws if _alike(each, laws[0])])[:1]


def _lag_and_delay(problem: Problem, law: LawFit) -> list[LawFit]:
    """The law, and of a load the delay that its lag may be or the lag that its delay may be, the likeliest first.

    At low frequencies a lag is a delay of half the current by twice the time.
    """
    memory, form = law.law.memory, law.form
    if not isinstance(law.place, LoadCurrent) or not isinstance(form, Line):
        return from_more_times(problem, law)
    if isinstance(memory, Relaxation):
        other, factor = LateBy(delay=2.0 * memory.time_constant), 0.5 * form.factor
    elif isinstance(memory, LateBy):
        other, factor = Relaxation(time_constant=0.5 * memory.delay, behind=True), min(2.0 * form.factor, 1.0)
    else:
        return [law]
    begun = replace(law.law, memory=other, form=replace(form, factor=float(factor)))
    again = fitted(problem, without_law(problem, law), begun, law.visited)
    both = [law] if again is None or again.memory_at_its_end else [law, again]
    return sorted(both, key=_preferred)


def _preferred(late: LawFit) -> float:
    """Criterion of a late load: a lag of twice its current, as a delay looks, has the odds of a place against it."""
    twice = isinstance(late.law.memory, Relaxation) and np.real(late.form.proportional) > MOST_LAGGING
    return late.criterion + (2.0 * thresholds.MIN_LOG_ODDS if twice else 0.0)


def _tables_of_steps(
    problem: Problem, start: Fit, done: Sequence[LawFit], found: Sequence[tuple[LawFit, list[LawFit]]]
) -> list[LawFit]:
    """The likeliest table over the campaign, if a change at a moment does better there than what was found elsewhere.

    Such a table is too coarse for it, so that it may be less likely than one at another place.
    """
    best, place = min((forms[0] for _, forms in found), key=lambda each: each.criterion), "campaign_time"
    tables = best_of([each for each in done if each.law.memory is None and each.place.input == place])[:1]
    explained = thresholds.MIN_EXCHANGE_SCORE * (start.cost - best.found.cost)
    return [
        table for table in tables
        if all(table is not each for each, _ in found) and start.cost - table.found.cost > explained
        and ranked(problem, table, kind=StepChange)[0].criterion < best.criterion
    ]  # fmt: skip


def _of_memory(
    problem: Problem, start: Fit, done: Sequence[LawFit], best: tuple[LawFit, list[LawFit]],
    progress: Callable[[str], None],
) -> tuple[LawFit, list[LawFit]]:  # fmt: skip
    """The likeliest law and its forms, or a function of what a memory makes of the input where that does better."""
    tables = _delays_beside_lags(best_of(functions_of_memories(problem, start, done, progress)))
    found = [best, *((table, ranked(problem, table)) for table in tables)]
    return min(found, key=lambda each: each[1][0].criterion)


def _delays_beside_lags(tables: Sequence[LawFit]) -> list[LawFit]:
    """The likeliest table; of crosstalk both that of a delay and that of a lag, which formulas tell from each other."""
    found: dict[type, LawFit] = {}
    for each in tables:
        found.setdefault(type(each.law.memory), each)
    return list(found.values()) if LateBy in found and Relaxation in found else list(tables[:1])


def _alike(first: LawFit, second: LawFit) -> bool:
    """True if two laws are at one place and of one input, whatever their memory."""
    return (first.place.name, first.place.input) == (second.place.name, second.place.input)


def _scored(problem: Problem, start: Fit, places: Places, progress: Callable[[str], None]) -> list[ScoredLaw]:
    """Scores of all places, without a memory and with each kind at its best start, the highest first."""
    visited = visited_inputs(problem, start)
    scales = campaign_scales(problem.data, start)
    found: list[ScoredLaw] = []
    for place in Stage(progress, "scoring laws", "places").over(places(problem, visited)):
        form = _first_form(problem, place, visited[place.input])
        each = form and score(problem, start, Law(place=place, form=form), visited[place.input])
        found += [each] if each is not None else []
        found += _best_memories(problem, start, _memories(problem, start, place, visited, scales), visited[place.input])
    return sorted((each for each in found if each.gain > MIN_SCORE), key=lambda each: -each.gain)


def _first_form(problem: Problem, place: Place, visited: np.ndarray) -> Form | None:
    """What is tried first at a place: a table, but over time a straight line where the engine is needed."""
    if isinstance(place, LoadCurrent):  # as the load over its voltage
        return None
    if problem.needs_engine and isinstance(place, OverTime) and place.of in TIMES:
        return Line(factor=0.0)
    return table_for(place, visited, in_engine=problem.needs_engine)


def _memories(problem: Problem, start: Fit, place: Place, visited: Visited, scales: CampaignScales) -> list[Law]:
    """Laws with a memory at a place; the engine has no states of sensors."""
    found = memories_at(place, visited, scales, start.model.transducer)
    if problem.needs_engine and isinstance(place, Reading):
        return [law for law in found if isinstance(law.memory, Delay | Play)]
    return found


def _best_memories(problem: Problem, start: Fit, laws: Sequence[Law], visited: np.ndarray) -> list[ScoredLaw]:
    """The best start of each kind of memory at a place."""
    best: dict[str, ScoredLaw] = {}
    for each in sorted(score_memories(problem, start, laws, visited), key=lambda each: -each.gain) if laws else []:
        assert each.law.memory is not None
        best.setdefault(each.law.memory.kind, each)
    return list(best.values())


def promising(scored: Sequence[ScoredLaw], misfit: float) -> list[ScoredLaw]:
    """Scores whose places are fitted: the highest, and where the misfit is large the best of each sort at each place.

    A score is a linearisation, which tells little where the fitted parameters have gone far to make up for a law.
    """
    free = [each for each in scored if each.law.memory is None]
    chosen = free[:FITS] + [each for each in scored if each.law.memory is not None][:MEMORY_FITS]
    chosen.sort(key=lambda each: -each.gain)
    if misfit > thresholds.LARGE_MISFIT:
        known = {_sort(each) for each in chosen}
        for each in scored:
            if _sort(each) not in known:
                known.add(_sort(each))
                chosen.append(each)
    return chosen


def _sort(scored: ScoredLaw) -> tuple[str, str]:
    """The place of a law and what it is there: a function, a play, or linear with a memory."""
    memory = scored.law.memory
    return scored.law.place.name, "function" if memory is None else "play" if isinstance(memory, Play) else "linear"


def _smoother(problem: Problem, start: Fit, table: LawFit) -> list[LawFit]:
    """The same law as a quadratic spline, where its linear part is that of the model: it has no piece for one."""
    if not table.law.bent or isinstance(table.form, Bends):
        return []
    form = table_for(table.place, table.visited, smooth=True)
    law = form and replace(table.law, form=form)
    first = law and score(problem, start, law, table.visited)
    again = law and first and fitted(problem, start, law, table.visited, first.smoothness.deviation)
    return [again] if again else []


def with_its_noise(problem: Problem, best: LawFit) -> LawFit:
    """The same law, fitted with the noise that it leaves."""
    found = best.found
    try:
        again = fit(problem, found.model, found.nuisance, found.noise)
    except (PredictionError, np.linalg.LinAlgError):
        return best
    return LawFit(again, best.visited) if again.converged else best
