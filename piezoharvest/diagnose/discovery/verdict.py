"""Whether a law without a name explains what the named effects left: by its gain on records that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np
from scipy.stats import chi2

from piezoharvest.description.effects import DiodeDropError, Effect, registered
from piezoharvest.description.effects.nameless.circuit_places import has_diodes
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.fits_of_laws import MOST_EXPLAINED
from piezoharvest.diagnose.discovery.growing_search import search_growing
from piezoharvest.diagnose.discovery.law_fits import TABLES, LawFit, without_effect
from piezoharvest.diagnose.discovery.result import Discovery, Rival, discovery
from piezoharvest.diagnose.discovery.search import (
    RIVALS,
    Found,
    can_search,
    instead,
    search,
    search_campaign,
    with_all_free,
)
from piezoharvest.diagnose.residual_structure.residual_tests import ResidualTest, failed_tests, whitened_squares
from piezoharvest.diagnose.selection.candidate_fits import CandidateFits
from piezoharvest.diagnose.selection.effect_change import EffectChange
from piezoharvest.diagnose.selection.score_tests import effect_parameters, starts_of
from piezoharvest.diagnose.selection.start_values import campaign_scales
from piezoharvest.diagnose.selection.stepwise_selection import Search
from piezoharvest.diagnose.validation import failed_on, validated
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import excess_of, mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.residual_quality import combined_quality, judged
from piezoharvest.identify.result import Identification, Quality
from piezoharvest.predict.parameters import Parameter
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.campaign import Campaign

Seek = Callable[[Problem, Fit, Callable[[str], None]], Found | None]
ALIKE = 0.99  # of what the best effect explains: less than laws that look alike are apart
MAX_LAWS = 2  # laws that are sought one after the other


@dataclass(frozen=True, eq=False)
class Explained:
    """What a diagnosis becomes with laws that explain what was left.

    Attributes
    ----------
    verdict : "new_effect", "effect" (the laws are known ones), or "ambiguous"
    discoveries : tuple of Discovery
    known : tuple of int
        Places in `search.order` of the laws that are effects of the library.
    squares : tuple of (float, float)
        Squares of unseen records and their number, before each effect of the search and after the last.
    search : Search
        With the laws instead of effects.
    validation : Quality
        With them.
    unexplained : float
        Share of the residual variance above the noise.
    unseen : tuple of ResidualTest
    kept : tuple of str
        Names of other effects in the model, found on the way or with the law.
    """

    verdict: str
    discoveries: tuple[Discovery, ...]
    known: tuple[int, ...]
    squares: tuple[tuple[float, float], ...]
    search: Search
    validation: Quality
    unexplained: float
    unseen: tuple[ResidualTest, ...]
    kept: tuple[str, ...]


def explained(campaign: Campaign, before: Identification, trials: CandidateFits, done: Search) -> Explained | None:
    """Laws that explain what a search for named effects has left; None where none does.

    The search begins without the effects that were found on the way, which may stand in for a law; then with them.
    Where they explain all but a little of a large misfit they are right: it begins with them, as without them the
    parameters are too far off for the fit of any law.
    Parameters that have gone far from their nominal values may do so, too: they start at these, and where that leads
    nowhere, as the nominal values may be wrong, where they went; behind diodes and switches first where more is
    explained. Where the misfit is large, what changes within the campaign and then records with smaller drives are
    looked at before all of them, and at last one effect alone is kept that explains most of it. What unseen records
    have denied is not sought again from another start.

    Parameters
    ----------
    campaign : Campaign
    before : Identification
    trials : CandidateFits
        From the fit without effects.
    done : Search
    """
    problem, progress = trials.problem, trials.progress
    if not can_search(problem):
        return None
    nominal = trials.at_nominal(EffectChange(done.base))
    starts = [*([nominal.found] if nominal else []), done.base]
    if problem.needs_engine:  # a search takes minutes there, and from far away its fits stay in another motion
        starts.sort(key=lambda each: each.cost)
    starts += [done.final] if done.nested else []
    free = *before.held, *done.base.model.parameters
    first = [(search_campaign, done.base), (partial(search_growing, given=free), done.base)]
    ways = [*first, *((search, each) for each in starts)]
    ways = [(search, done.final), *ways[:-1]] if _dominant(done) else ways
    denied: list[Found] = []
    for seek, begun in chain(ways, _beside_one_effect(trials, done)):
        start = _with_drop_free(trials, begun)
        found = found_laws(campaign, before, problem, start, progress, partial(_sought_anew, seek, denied), free)
        if found is not None:
            beside = tuple(range(done.given_effects, len(start.model.transducer.effects)))
            found, kept = without_riders(campaign, before, problem, found, beside, progress)
            return _as_diagnosed(campaign, before, problem, done, found, kept)
    return None


def _sought_anew(
    seek: Seek, earlier: list[Found], problem: Problem, start: Fit, progress: Callable[[str], None]
) -> Found | None:
    """What is found, unless it is one of the `earlier`, which unseen records have denied.

    If it is not, it becomes one of them.
    """
    found = seek(problem, start, progress)
    if found is not None and any(_no_better(found, each) for each in earlier):
        progress("it was found before, and does not explain records that were not fitted")
        return None
    earlier += [] if found is None else [found]
    return found


def _no_better(found: Found, other: Found) -> bool:
    """True if a law is where another one is, beside the same effects, and explains no more."""
    same = all(_where(a) == _where(b) for a, b in ((found.table, other.table), (found.best, other.best)))
    return same and found.final.cost > other.final.cost - thresholds.CLOSE_COST


def _where(law: LawFit) -> tuple[object, ...]:
    """Place, memory and other effects of a fit with a law."""
    return (
        *EffectChange(law.found).effects[:-1],
        law.place.name,
        law.place.input,
        type(law.law.memory),
        type(law.form),
    )


def _dominant(done: Search) -> bool:
    """True if the effects that were found explain all but a little of a large misfit."""
    explained = done.base.cost - done.final.cost
    large = mean_square(done.base) > thresholds.LARGE_MISFIT
    return bool(done.nested) and large and explained > thresholds.MIN_DOMINANT_SHARE * excess_of(done.base)


def _beside_one_effect(trials: CandidateFits, done: Search) -> Iterator[tuple[Seek, Fit]]:
    """Searches beside the one effect that explains most of a large misfit: of those that explain as much the simplest.

    Beside a law the search for named effects may have dropped it, or have taken another in its place.
    """
    base, given = done.base, done.given_effects
    names = {each.names: tuple(each.names.split(" + "))[given:] for each in done.fits}
    alone = {names[each.names][0]: -each.change for each in done.fits if len(names[each.names]) == 1}
    most = max(alone.values(), default=0.0)
    if mean_square(base) <= thresholds.LARGE_MISFIT or most < MOST_EXPLAINED * excess_of(base):
        return
    kinds = [registered()[name] for name, explained in alone.items() if explained > ALIKE * most]
    starts = starts_of(campaign_scales(trials.problem.data, base), base, kinds)
    simplest = min((len(effect_parameters([each], 0)) for each in starts), default=0)
    chosen = [each for each in starts if len(effect_parameters([each], 0)) == simplest]
    fits = (trials.extended(EffectChange(base), each, np.inf) for each in chosen)
    best = min((each for each in fits if each is not None), key=lambda each: each.cost, default=None)
    if best is not None and best.effects != EffectChange(done.final).effects:
        yield from ((seek, best.found) for seek in (search_campaign, search))


def _with_drop_free(trials: CandidateFits, start: Fit) -> Fit:
    """The fit with the drop of its diodes free: a law there is a voltage that begins at zero, beside a constant.

    Diodes with several labels are several kinds, of which one drop would be wrong.
    """
    shunts = [data.setting.shunt for data in trials.problem.data if isinstance(data, Data)]
    drops = {shunt.diode_drop for shunt in shunts if has_diodes(shunt)}
    if len(drops) != 1 or DiodeDropError.name in EffectChange(start).effects:
        return start
    free = trials.extended(EffectChange(start), DiodeDropError(diode_drop=drops.pop()), np.inf)
    return start if free is None else free.found


@dataclass(frozen=True, eq=False)
class _Laws:
    """Laws that were found one after the other, and the squares on unseen records before each and after the last.

    `base` are those of the model without any effect.
    """

    found: tuple[Found, ...]
    base: tuple[float, float]
    squares: tuple[tuple[float, float], ...]
    unseen: Problem
    check: Fit

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects of the last fit, the laws behind the others."""
        return self.found[-1].final.model.transducer.effects

    @property
    def earlier(self) -> range:
        """Numbers of the laws before the last."""
        return range(len(self.effects) - len(self.found), len(self.effects) - 1)

    def in_fit(self, final: Fit, unseen: Problem, check: Fit, lost: int | None = None) -> _Laws:
        """The laws in another fit, which may not have one of the effects, a law or another."""
        found, before = list(self.found), list(self.squares[:-1])
        if lost is not None and lost in self.earlier:
            k = lost - self.earlier.start
            del found[k], before[k + 1]
        found[-1] = found[-1].with_final(final)
        squares = (*before, whitened_squares(unseen, check))
        return replace(self, found=tuple(found), squares=squares, unseen=unseen, check=check)


def found_laws(
    campaign: Campaign, before: Identification, problem: Problem, start: Fit, progress: Callable[[str], None],
    seek: Seek = search, given: Sequence[Parameter] = (),
) -> _Laws | None:  # fmt: skip
    """Laws from a fit on that explain enough of what it leaves on records that were not fitted.

    A second one is sought where the first leaves much, unless that is by the corners of a broken line, and kept if it
    explains that. Of the `given` parameters those
    that were held are free beside the laws.
    """
    kept: _Laws | None = None
    while kept is None or (len(kept.found) < MAX_LAWS and _much_is_left(kept) and not _is_coarse(problem, kept)):
        more = search(problem, kept.found[-1].final, progress) if kept else seek(problem, start, progress)
        earlier = kept.found if kept else ()
        more = more and with_all_free(problem, more, given)
        laws = _confirmed(problem, earlier, more, partial(_judged, campaign, before, start), progress)
        if laws is None:
            break
        kept = laws
    return kept if kept and _total_gain(kept) >= thresholds.MIN_LAW_GAIN else None


def _confirmed(
    problem: Problem, earlier: tuple[Found, ...], more: Found | None, judge: Callable[[tuple[Found, ...]], _Laws],
    progress: Callable[[str], None],
) -> _Laws | None:  # fmt: skip
    """Earlier laws and one more, at the likeliest place that unseen records confirm; None where they confirm none."""
    least = thresholds.MIN_LAW_GAIN if earlier else thresholds.MIN_SHARE_OF_PRESENT
    while more is not None:
        try:
            laws = judge((*earlier, more))
        except PredictionError:
            return None
        own = _gain(laws.squares[-2], laws.squares[-1], laws.squares[-1])
        if own > 0:
            progress(f"it removes {100 * own:.1f} % of the error above the noise in records that were not fitted")
        else:
            progress("it does not improve the prediction of records that were not fitted")
        if own >= least:
            return laws
        more = instead(problem, more)
        if more is not None:
            place = more.table.place
            progress(f"fitted records do not rule out {place.name}, of {place.input.replace('_', ' ')}: tried instead")
    return None


def without_riders(
    campaign: Campaign, before: Identification, problem: Problem, laws: _Laws, beside: tuple[int, ...],
    progress: Callable[[str], None],
) -> tuple[_Laws, dict[int, float]]:  # fmt: skip
    """Laws without what does nothing for unseen records, and the numbers and p-values of effects `beside` that do.

    Before a dominant law was known, an effect, or a law found earlier, may have taken a little of its place.
    """
    kept: dict[int, float] = {}
    for n in reversed((*beside, *laws.earlier)):
        final, effect = laws.found[-1].final, laws.effects[n]
        freedom = sum(p.path[:2] == ("effects", n) for p in final.model.parameters)
        if not freedom:  # a drop of diodes that their law has replaced
            kept[n] = _p_value(laws.found[-1])
            continue
        decrease, less = np.inf, without_effect(problem, final, n)
        if less is not None:
            decrease, shorter = less.cost - final.cost, _without(campaign, before, laws, n, less)
            if shorter is not None:
                progress(f"{effect.name} does not improve the prediction of records that were not fitted")
                laws = shorter
                kept = {m - (m > n): p for m, p in kept.items()}
                continue
        if n in beside:
            kept[n] = float(chi2.sf(decrease, freedom))
    return laws, kept


def _without(campaign: Campaign, before: Identification, laws: _Laws, n: int, less: Fit) -> _Laws | None:
    """The same laws in a fit without the n-th effect, where this does nothing for unseen records; else None."""
    try:
        unseen, (_, check) = validated(campaign, before, [before.found, less])
    except PredictionError:  # the records need it
        return None
    squares, (first, count) = whitened_squares(unseen, check), laws.squares[0]
    scatter = thresholds.NOISE_DEVIATIONS * np.sqrt(2.0 * count)
    if squares[0] - laws.squares[-1][0] >= max(thresholds.MIN_EXPLAINED_SHARE * (first - count), scatter):
        return None
    return laws.in_fit(less, unseen, check, n)


def _judged(campaign: Campaign, before: Identification, start: Fit, found: tuple[Found, ...]) -> _Laws:
    """Laws with the squares that they leave of unseen records."""
    fits = [start, *(each.final for each in found)]
    unseen, checks = validated(campaign, before, fits if start is before.found else [before.found, *fits])
    squares = [whitened_squares(unseen, each) for each in checks]
    return _Laws(found, squares[0], tuple(squares[-len(fits) :]), unseen, checks[-1])


def _is_coarse(problem: Problem, laws: _Laws) -> bool:
    """True if the last law explains nearly all of unseen records, and has corners: what it leaves is between these.

    In the engine curves have corners, too.
    """
    corners = problem.needs_engine or isinstance(laws.found[-1].best.form, TABLES)
    return corners and _gain(laws.squares[-2], laws.squares[-1], laws.squares[-1]) > thresholds.MIN_DOMINANT_SHARE


def _much_is_left(laws: _Laws) -> bool:
    """True if the squares of unseen records are well above those of noise."""
    squares, count = laws.squares[-1]
    return squares > (1.0 + thresholds.MIN_LEFT) * count


def _total_gain(laws: _Laws) -> float:
    return _gain(laws.squares[0], laws.squares[-1], laws.squares[-1])


def _gain(before: tuple[float, float], after: tuple[float, float], last: tuple[float, float]) -> float:
    """Share of the squares above the noise that is gone."""
    (squares, count) = last
    noise = squares if squares < count + thresholds.NOISE_DEVIATIONS * np.sqrt(2.0 * count) else count
    return float(np.clip((before[0] - after[0]) / max(before[0] - noise, 1e-300), -1.0, 1.0))


def _as_diagnosed(
    campaign: Campaign, before: Identification, problem: Problem, done: Search, laws: _Laws, kept: dict[int, float]
) -> Explained:
    """What a diagnosis becomes; `kept` are the numbers of other effects in the last fit, and their p-values."""
    final, close = laws.found[-1].final, [rival for each in laws.found for rival in each.close]
    given, earlier = done.given_effects, len(kept)
    kept = dict(sorted(kept.items()))
    named = tuple(laws.effects[n].name for n in kept)
    extended = replace(
        done,
        nested=(*(laws.found[0].start,) * earlier, *(each.final for each in laws.found)),
        order=final.model.transducer.effects[given:],
        p_values=(*kept.values(), *map(_p_value, laws.found)),
        left=failed_tests(problem, final),
        alternatives=tuple((EffectChange(rival.found), 0.0) for rival in close),
    )
    known = tuple(earlier + n for n, each in enumerate(laws.found) if each.known is not None)
    discoveries = tuple(_discovered(laws, n) for n, each in enumerate(laws.found) if each.known is None)
    squares, count = laws.squares[-1]
    return Explained(
        "ambiguous" if close else "new_effect" if discoveries else "effect", discoveries, known,
        ((laws.base,) * earlier + laws.squares), extended,
        combined_quality(judged(laws.unseen.data, laws.check)), max(0.0, (squares - count) / squares),
        failed_on(laws.unseen, laws.check), named,
    )  # fmt: skip


def _discovered(laws: _Laws, n: int) -> Discovery:
    """The n-th law as a result, with its values in the last fit."""
    each, (first, last) = laws.found[n], (laws.squares[0], laws.squares[-1])
    share = _gain(first, last, last) * (laws.squares[n][0] - laws.squares[n + 1][0]) / (first[0] - last[0])
    rivals = [(rival.law, each.log_odds(rival)) for rival in each.rivals] + list(each.ruled_out)
    reported = tuple(
        Rival(law.place.name, law.place.input, law.form.word, odds)
        for law, odds in sorted(rivals, key=lambda pair: -pair[1])[:RIVALS]
    )
    fitted = LawFit(laws.found[-1].final, each.best.visited, n - len(laws.found))
    return discovery(fitted, float(np.clip(share, -1.0, 1.0)), _p_value(each), reported, each.forms)


def _p_value(found: Found) -> float:
    """p-value of a law by its decrease of -2 ln L, corrected for the places that were tried."""
    table: LawFit = found.table
    return min(1.0, float(chi2.sf(found.start.cost - table.found.cost, max(table.freedom, 1.0))) * found.tried)
