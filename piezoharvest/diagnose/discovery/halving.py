"""Which places are worth a full fit, by a few iterations of each: successive halving.

Where the misfit is large, one linearisation says little of what a law explains at the end of its fit, and behind diodes
and switches a fit takes too long for each place to have one. The first iterations tell: the half that has explained
least by then goes, the others go on (Jamieson & Talwalkar, AISTATS, PMLR 51, 240-248, 2016).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from piezoharvest.diagnose.discovery.law_fits import LawFit, ScoredLaw, continued, fitted
from piezoharvest.identify.fitting.levenberg_marquardt import GIVEN_UP, Fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.progress import Stage

# Iterations of each round. From three fits without a law, of two circuits, the right place was among the first four of
# 25 after three, and the first or third after six.
ROUNDS = (3, 6)


def halved(
    problem: Problem, start: Fit, scored: Sequence[ScoredLaw], least: int, progress: Callable[[str], None],
    aim: float = np.inf,
) -> list[tuple[ScoredLaw, LawFit]]:  # fmt: skip
    """Scored laws with what a few iterations made of them, the best first.

    Of those that explain nothing by then, or will not reach the cost `aim`, none remains, of the others a half after
    each round, though not fewer than `least`.
    """
    left: list[tuple[ScoredLaw, LawFit | None]] = [(each, None) for each in scored]
    done: list[tuple[ScoredLaw, LawFit]] = []
    for most in ROUNDS:
        stage, done = Stage(progress, f"{most} iterations at each place", "places"), []
        for each, begun in stage.over(left):
            found = (
                fitted(problem, start, each.law, each.visited, each.smoothness.deviation, aim, most)
                if begun is None
                else continued(problem, start, begun, aim, most)
            )
            if found is not None and found.found.cost < start.cost and found.found.message != GIVEN_UP:
                done.append((each, found))
        done.sort(key=lambda pair: pair[1].found.cost)
        done = done[: max(least, (len(done) + 1) // 2)]
        left = list(done)
    return done
