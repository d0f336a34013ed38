"""What lags in the loop of a switch, fitted from several time constants where a first fit has taken the parameters.

Any time constant takes most of what a lower quality would. Beside parameters that have gone far to make up for it a
score does not tell one from another, and a fit that begins too far off ends in a valley, or at the end of its range.
"""

from __future__ import annotations

from collections.abc import Sequence

from piezoharvest.description.effects.nameless.circuit_places import SwitchLoop
from piezoharvest.description.effects.nameless.memory import Memory, Relaxation
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.law_fits import LawFit, ScoredLaw, fitted, without_law
from piezoharvest.diagnose.discovery.memories.scores import memories_at, score_memories
from piezoharvest.diagnose.selection.start_values import campaign_scales
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.problem import Problem


def from_more_times(problem: Problem, law: LawFit) -> list[LawFit]:
    """The law, and where it lags in a loop others of both kinds, from slower and from faster ones on; likeliest first.

    In each direction time constants are tried as long as fits get better.
    """
    memory = law.law.memory
    if not (isinstance(law.place, SwitchLoop) and isinstance(memory, Relaxation)):
        return [law]
    bare = without_law(problem, law)
    scales, device = campaign_scales(problem.data, bare), bare.model.transducer
    tried = memories_at(law.place, {law.place.input: law.visited}, scales, device)
    starts = sorted(score_memories(problem, bare, tried, law.visited), key=_time)
    found = [law]
    for behind in (True, False):
        own = [each for each in starts if _relaxation(each.law.memory).behind == behind]
        slower = [each for each in own if _time(each) > memory.time_constant]
        faster = [each for each in reversed(own) if _time(each) <= memory.time_constant]
        found += [*_while_better(problem, bare, slower), *_while_better(problem, bare, faster)]
    return sorted(found, key=lambda each: each.criterion)


def _while_better(problem: Problem, bare: Fit, starts: Sequence[ScoredLaw]) -> list[LawFit]:
    """Fits from one start after the other until one does not do better than that before it."""
    found: list[LawFit] = []
    for each in starts:
        again = fitted(problem, bare, each.law, each.visited)
        if again is None or (found and again.found.cost > found[-1].found.cost - thresholds.CLOSE_COST):
            break
        found.append(again)
    return found


def _relaxation(memory: Memory | None) -> Relaxation:
    assert isinstance(memory, Relaxation)
    return memory


def _time(scored: ScoredLaw) -> float:
    return _relaxation(scored.law.memory).time_constant
