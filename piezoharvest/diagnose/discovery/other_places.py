"""Whether laws without a name at other places are about as likely as small known effects, which are then not certain.

Of a large effect at a wrong place enough is left for residual tests to see; of a small one it is lost in the noise. The
effects are compared with free laws by their evidence, as laws at different places are, but with better odds beforehand.
A law at the place of an effect counts only where it rules the effect's formula out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from piezoharvest.description.effects import Effect
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.law_fits import LawFit, ScoredLaw, fitted, score
from piezoharvest.diagnose.discovery.passivity import takes_energy
from piezoharvest.diagnose.discovery.places import places_of
from piezoharvest.diagnose.discovery.search import MIN_SCORE
from piezoharvest.diagnose.discovery.tables.knots import table_for
from piezoharvest.diagnose.discovery.tables.visited import visited_inputs
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.progress import Stage

FITS = 3  # places with the highest scores that are fitted in full


def rivals(
    problem: Problem, starts: Sequence[Fit], final: Fit, known: Sequence[Effect], freedom: Callable[[Fit], int],
    progress: Callable[[str], None],
) -> list[tuple[LawFit, float]]:  # fmt: skip
    """Laws that are not ruled out beside known effects, or at their places rule these out, the likeliest first.

    Parameters
    ----------
    problem : Problem
    starts : sequence of Fit
        Without some of the effects, instead of which there may be a law.
    final : Fit
        With all of them.
    known : sequence of Effect
        The effects.
    freedom : callable
        Number of parameters of the effects of a fit.
    progress : callable

    Returns
    -------
    list of (LawFit, float)
        With the logarithm of the odds against the effects.
    """
    taken = {place for effect in known for place in effect.acts_at}
    found: list[tuple[LawFit, float]] = []
    for start in starts:
        price = (freedom(final) - freedom(start)) * np.log(sum(float(sums.count.sum()) for sums in start.sums))
        gain = start.cost - final.cost - price
        for each in Stage(progress, "trying laws instead", "places", most=True).over(_promising(problem, start, gain)):
            law = fitted(problem, start, each.law, each.visited, each.smoothness.deviation)
            if law is None or not law.found.converged or not takes_energy(problem, law, start.cost - law.found.cost):
                continue
            odds = 0.5 * (start.cost - law.evidence - gain) - thresholds.PRIOR_LOG_ODDS
            progress(f"a law at {law.place.name} instead, of {law.place.input}: logarithm of the odds {odds:+.1f}")
            least = thresholds.MIN_LOG_ODDS * (1.0 if law.place.name in taken else -1.0)
            found += [(law, odds)] if odds > least else []
    return sorted(found, key=lambda pair: -pair[1])


def _promising(problem: Problem, start: Fit, gain: float) -> list[ScoredLaw]:
    """Tables whose scores come near to the gain of the effects, the highest first."""
    visited = visited_inputs(problem, start)
    engine = problem.needs_engine
    forms = [(place, table_for(place, visited[place.input], in_engine=engine)) for place in places_of(problem, visited)]
    laws = [Law(place=place, form=form) for place, form in forms if form is not None]
    scored = [score(problem, start, law, visited[law.place.input]) for law in laws]
    enough = thresholds.MIN_EXCHANGE_SCORE * (gain + 2.0 * (thresholds.PRIOR_LOG_ODDS - thresholds.MIN_LOG_ODDS))
    close = [each for each in scored if each is not None and each.gain > max(enough, MIN_SCORE)]
    return sorted(close, key=lambda each: -each.gain)[:FITS]
