"""Full fits of laws at the places that promise most, of which the others need not be fitted once the right one is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from piezoharvest.description.effects.nameless.forms import Line
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.forms.formulas import ranked
from piezoharvest.diagnose.discovery.halving import halved
from piezoharvest.diagnose.discovery.law_fits import (
    TABLES,
    LawFit,
    ScoredLaw,
    continued,
    fitted,
    score,
    with_moved_knots,
    without_law,
)
from piezoharvest.diagnose.discovery.memories.functions import leaves_much
from piezoharvest.diagnose.discovery.memories.scores import at_null, score_memories
from piezoharvest.diagnose.discovery.passivity import takes_energy
from piezoharvest.diagnose.discovery.tables.knots import table_for
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import excess_of, linearised, mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.progress import Stage

# Behind diodes and switches, where a fit takes ten times as long and more: in all, so that a search ends in minutes; of
# what is found to be no law there, as it would give energy, as many again.
ENGINE_FITS = 5
OVER_SCORE = 1.25  # there: times its score that a fit gains at most (1.01 measured), unless the misfit is large
# Share of a large misfit from which a table is condensed at once: of what is left to others none explains more.
MOST_EXPLAINED = 0.5
MOVES = 6  # of a table's corners: by five those beside a jump come to a thirtieth of their distance from it
MOVES_IN_ENGINE = 1  # where a fit takes ten times as long: enough for formulas to begin near their end


@dataclass(eq=False)
class FitsOfLaws:
    """Full fits of laws, of a problem from a start.

    Where the misfit is large, a table with fixed corners may leave much of what a formula explains, and take long
    beside other places that would do no better than the formula: it is condensed at once.

    Attributes
    ----------
    done : list of LawFit
    condensed : dict of LawFit to list of LawFit
        Forms of tables that were condensed, the likeliest first.
    ruled_out : list of (Law, float)
        As in `Found`.
    beside : dict of LawFit to tuple
        What other laws are compared with (`_explained_by`).
    """

    problem: Problem
    start: Fit
    done: list[LawFit] = field(default_factory=list)
    condensed: dict[LawFit, list[LawFit]] = field(default_factory=dict)
    ruled_out: list[tuple[Law, float]] = field(default_factory=list)
    beside: dict[LawFit, tuple[Fit, float, float]] = field(default_factory=dict)

    def try_all(self, chosen: Sequence[ScoredLaw], progress: Callable[[str], None]) -> None:
        """Fit laws; those that will not come close to the best so far are abandoned, or not begun."""
        if self.problem.needs_engine and mean_square(self.start) > thresholds.LARGE_MISFIT:
            self._try_behind_circuits(chosen, progress)
            return
        most, tried = OVER_SCORE if self.problem.needs_engine else np.inf, 0
        chosen = chosen[: 2 * ENGINE_FITS] if self.problem.needs_engine else chosen
        for n, each in enumerate(Stage(progress, "trying laws", "places", most=True).over(chosen)):
            if self.problem.needs_engine and n >= ENGINE_FITS + min(tried - len(self.done), ENGINE_FITS):
                break
            best = min((one.evidence for one in self.done), default=np.inf)
            if self.start.cost - most * each.gain > best + thresholds.CLOSE_COST or self._is_ruled_out(each):
                continue
            self._try(each, None, progress)
            tried += 1

    def _try_behind_circuits(self, chosen: Sequence[ScoredLaw], progress: Callable[[str], None]) -> None:
        """Fit the highest score of a large misfit, and where that is not the law, what a few iterations of each say.

        Where it is, they would take longer than the whole of its fit.
        """
        for each in chosen[:1]:
            self._try(each, None, progress)
        others = Stage(progress, "comparing laws with the best", "places").over(chosen[1:])
        left = [each for each in others if not self._is_ruled_out(each)]
        # Beside a law that is at the right place by all that it explains, no other needs to be the best of the rest.
        best = min((self._condensed(each) for each in self.done), key=lambda each: each.evidence, default=None)
        aim = best.evidence + thresholds.CLOSE_COST if best is not None and self.is_dominant(best) else np.inf
        begun = halved(self.problem, self.start, left, ENGINE_FITS, progress, aim)
        tried = 0
        begun = begun[: 2 * ENGINE_FITS]
        for n, (each, law) in enumerate(Stage(progress, "trying laws", "places", most=True).over(begun)):
            if n >= ENGINE_FITS + min(tried - len(self.done), ENGINE_FITS):
                break
            if not self._is_ruled_out(each):
                self._try(each, law, progress)
                tried += 1

    def _try(self, each: ScoredLaw, begun: LawFit | None, progress: Callable[[str], None]) -> None:
        """Fit a law, from its score or from where it was `begun`, and keep it if it can be one."""
        problem, start = self.problem, self.start
        aim = min((one.evidence for one in self.done), default=np.inf) + thresholds.CLOSE_COST
        found = (
            fitted(problem, start, each.law, each.visited, each.smoothness.deviation, aim)
            if begun is None
            else continued(problem, start, begun, aim)
        )
        if found is None:
            return
        found = self._bent_where_the_law_bends(found)
        change = found.found.cost - start.cost
        progress(f"tried a law at {words(each.law)}: change of the misfit (-2 ln L) {change:+.1f}")
        if found.memory_at_its_end:
            progress("there it would resonate or relax outside the range that was looked at, so that it does neither")
        elif takes_energy(problem, found, start.cost - found.found.cost):
            self.done.append(found)
        else:
            progress(f"there it would give energy, so that it is no law of the {found.place.name}")

    def _is_ruled_out(self, other: ScoredLaw) -> bool:
        """True if the best law so far leaves no more than noise of a large misfit, and another does not come close.

        Where the misfit is large all places are in, and each of their fits takes long. A law that leaves more than
        noise may be at a wrong place, which takes most of the misfit, too.
        """
        problem, large = self.problem, mean_square(self.start) > thresholds.LARGE_MISFIT
        if not self.done or not (large or problem.needs_engine):
            return False
        best = min(self.done, key=lambda each: each.evidence)
        best = self._condensed(best) if large else best
        if large and leaves_much(best) and not self.is_dominant(best):
            return False
        if best not in self.beside:
            self.beside[best] = _explained_by(problem, best)
        bare, explained, own = self.beside[best]
        others = _gain_from(problem, bare, other.law, other.visited)
        if others > thresholds.MIN_EXCHANGE_SCORE * min(explained, own):
            return False
        self.ruled_out.append((other.law, 0.5 * (others - explained)))
        return True

    def is_dominant(self, law: LawFit) -> bool:
        """True of a law behind diodes or switches that explains all but what one at a wrong place leaves, or less.

        There each fit takes long, and a formula that is not quite the right one leaves more than noise.
        """
        left = excess_of(law.found) / excess_of(self.start)
        return self.problem.needs_engine and left < 1.0 - thresholds.MIN_DOMINANT_SHARE

    def _is_coarse(self, law: LawFit) -> bool:
        """True of a table that leaves much though it explains most of the misfit.

        Where the engine is needed and formulas take long, as much as a law at the right place has to explain.
        """
        explains = 1.0 - excess_of(law.found) / excess_of(self.start)
        enough = thresholds.MIN_LAW_GAIN if self.problem.needs_engine else MOST_EXPLAINED
        return isinstance(law.form, TABLES) and leaves_much(law) and explains >= enough

    def _bent_where_the_law_bends(self, law: LawFit) -> LawFit:
        """The law, with the corners of a table that is too coarse moved while that makes it likelier.

        Not over a campaign, between whose records nothing is known. Where the engine is needed, of a law alone that is
        at the right place by all that it explains.
        """
        if law.place.input == "campaign_time" or (self.problem.needs_engine and not self.is_dominant(law)):
            return law
        for _ in range(MOVES_IN_ENGINE if self.problem.needs_engine else MOVES):
            if not self._is_coarse(law):
                break
            again = with_moved_knots(self.problem, law)
            if again is None or again.evidence > law.evidence - thresholds.CLOSE_COST:
                break
            law = again
        return law

    def _condensed(self, table: LawFit) -> LawFit:
        """The law, or the likeliest form of a table that is too coarse."""
        return self.formulas(table)[0] if self._is_coarse(table) else table

    def formulas(self, table: LawFit) -> list[LawFit]:
        """The table and its forms, the likeliest first; made once."""
        if table not in self.condensed:
            self.condensed[table] = ranked(self.problem, table)
        return self.condensed[table]


def _explained_by(problem: Problem, best: LawFit) -> tuple[Fit, float, float]:
    """The fit without a law, where it has taken the parameters, what it explains there, and its score.

    There the score of another law tells more than at the start, from which a fit may take minutes: without a law the
    parameters have gone far to make up for it. Of a large law a score is little, for the best one as for the others.
    """
    bare = without_law(problem, best)
    explained = linearised(problem, bare.model, bare.nuisance, bare)[2] - sum(
        float(part.squares.sum()) for part in best.found.sums
    )
    return bare, explained, _gain_from(problem, bare, _without_values(problem, best), best.visited)


def _gain_from(problem: Problem, bare: Fit, law: Law, visited: np.ndarray) -> float:
    """Score of a law beside the parameters of a fit, 0 where it has none."""
    if law.memory is None:
        found = score(problem, bare, law, visited)
        return 0.0 if found is None else found.gain
    return max((each.gain for each in score_memories(problem, bare, [at_null(law)], visited)), default=0.0)


def _without_values(problem: Problem, some: LawFit) -> Law:
    """The law without kinks, or with the factor 0, as it is scored; in the place of a formula a table."""
    law, form = some.law, some.form
    if law.memory is not None and isinstance(form, Line):
        return replace(law, form=replace(form, factor=0.0))
    if isinstance(form, TABLES):
        return replace(law, form=replace(form, kinks=(0.0,) * len(form.kinks)))
    table = table_for(some.place, some.visited, remembered=law.memory is not None, in_engine=problem.needs_engine)
    return law if table is None else replace(law, form=table)


def words(law: Law) -> str:
    """Place, input and memory of a law, as messages have them."""
    memory = f", with {law.memory.kind.replace('_', ' ')}" if law.memory is not None else ""
    return f"{law.place.name}, of {law.place.input.replace('_', ' ')}{memory}"
