"""Which effects are there: scores, full fits of the promising ones, forward and backward selection.

Source: Davies, Biometrika 74(1), 33-43, 1987 (chance where parameters exist only with the effect).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from scipy.stats import chi2

from piezoharvest.description.effects import Effect
from piezoharvest.diagnose.candidate_fits import (
    CERTAIN,
    CLOSE,
    NEEDED,
    EffectChange,
    Made,
    Trials,
    aim_beside,
    errors,
    inflated,
    key_of,
    significance,
)
from piezoharvest.diagnose.residual_tests import Leftover
from piezoharvest.diagnose.score_tests import ScoredEffect, effect_line, effect_parameters
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.predict.prediction import PredictionError

LEVEL = 1e-4  # chance of a false alarm, over all effects together
HOPE = 30.0  # times the level, where a fit finds a time constant, say, between two starts: it gains up to half as much
MOST = 3  # effects at once
PROMISING = 0.15  # of the best score: what a full fit may still turn round
FITS = 4  # full fits a stage
STAND_INS = 2  # of these against a model whose strayed parameters are held
SOME, GOOD = 0.05, 0.5  # of the squares above noise, all and those left: what explains less of both explains nothing
BRIEF = 6  # iterations after which a full fit waits for the others of its stage
DOUBTED = 100.0  # of -2 ln L, or of Wald's test: with less an effect may owe its gain to a better minimum
OUTSTANDING = 0.3  # of the squares that the worst place has above noise: places with more have to be explained
UNEXPLAINED = "what stands out is as it was: no effect of the library explains it"
KEPT = 0.5  # of its squares above noise: a place that keeps more is not explained


@dataclass(frozen=True)
class Search:
    """What a search has found.

    Attributes
    ----------
    base : Fit
        Without effects.
    nested : tuple of Fit
        With the first effect, the first two, and so on.
    order : tuple of Effect
        The effects in the order in which they were found, with their fitted values.
    p_values : tuple of float
        Of each, corrected for the number of effects.
    first : tuple of ScoredEffect
        Scores of all effects against the model without any.
    left : tuple of Leftover
        Where these leave structure.
    alternatives : tuple of (EffectChange, float)
        Other sets that are nearly as likely, with what they cost more; not looked for where structure is left.
    fits : tuple of Made
        Full fits that were made.
    """

    base: Fit
    nested: tuple[Fit, ...]
    order: tuple[Effect, ...]
    p_values: tuple[float, ...]
    first: tuple[ScoredEffect, ...]
    left: tuple[Leftover, ...]
    alternatives: tuple[tuple[EffectChange, float], ...]
    fits: tuple[Made, ...]

    @property
    def given(self) -> int:
        """Effects that the model without any finding has, as the campaign names them."""
        return len(self.base.model.transducer.effects)

    @property
    def final(self) -> Fit:
        """With all effects that are there."""
        return self.nested[-1] if self.nested else self.base

    @property
    def before_last(self) -> Fit:
        """Without the last effect."""
        return self.nested[-2] if len(self.nested) > 1 else self.base

    def without_last(self, left: tuple[Leftover, ...]) -> Search:
        """The same without the last effect, and what is left then."""
        return replace(
            self, nested=self.nested[:-1], order=self.before_last.model.transducer.effects[self.given :],
            p_values=self.p_values[:-1], left=left, alternatives=(),
        )  # fmt: skip


class _Found(NamedTuple):
    """Where a search stands.

    Attributes
    ----------
    now : EffectChange
    held : EffectChange or None
        The model whose strayed parameters are at their nominal values, if any are not.
    levels : list of float
        Of the effects that were found.
    alternatives : list of EffectChange
        Others that were tried in the place of the last one.
    added : bool
        Whether an effect was found in the last step.
    """

    now: EffectChange
    held: EffectChange | None
    levels: list[float]
    alternatives: list[EffectChange]
    added: bool = True


class Searcher:
    """Search for effects in a campaign.

    Parameters
    ----------
    trials : Trials
        Of the campaign.
    """

    def __init__(self, trials: Trials):
        self.trials = trials

    @property
    def given(self) -> int:
        """Effects that the campaign names: these are no finding."""
        return len(self.trials.base.model.transducer.effects)

    def run(self) -> Search:
        """Find the effects that a model without any misses."""
        trials = self.trials
        now, held = self._surveyed(EffectChange(trials.base))
        first, found = trials.scores(now), _Found(now, held, [], [])
        while len(found.now.effects) < self.given + MOST:
            try:
                more = self._one_more(found)
            except PredictionError as error:  # what was found so far can follow them
                trials.tell(f"the search ends: with one effect more the model cannot follow the records ({error})")
                break
            if more is None:
                break
            before, found = found, more
            if more.added and self._passed_by(before.now, more.now):
                trials.tell(UNEXPLAINED)
                break
        now, levels = self._determined(found.now, found.levels)
        now = trials.polished(now) if len(now.effects) > self.given else now
        left = trials.left(now.found)
        close = () if left else self._alternatives(now, found.alternatives)
        return Search(
            trials.base, self._nested(now), now.found.model.transducer.effects[self.given :], tuple(levels),
            tuple(first), left, close, tuple(trials.made),
        )  # fmt: skip

    def _one_more(self, found: _Found) -> _Found | None:
        """The same with one effect more, or in a better minimum without it; None where none is more than chance."""
        trials, now = self.trials, found.now
        tried = self._next(now, found.held)
        if not tried:
            return None
        after, *alternatives = tried
        if not self._matters(now, after):
            trials.tell(UNEXPLAINED)
            return None
        level = self._p_value(now, after, trials.scores(now))
        better = self._led_to(now, after)
        if better is not None:
            level = self._p_value(better, after, trials.scores(now))
            if level > LEVEL:
                trials.tell(f"{after.effects[-1]} has only led to a better minimum without it")
                return _Found(*self._surveyed(better), found.levels, [], added=False)
        trials.tell(f"found {', '.join(after.effects)}")
        after, levels = self._revised(trials.redetermined(after), [*found.levels, level])
        return _Found(*self._surveyed(after), levels, alternatives if better is None else [])

    def _led_to(self, before: EffectChange, now: EffectChange) -> EffectChange | None:
        """The model before where a new effect has come to, if it fits better there.

        What a small effect gains may be that of a minimum beside the one in which the model before was caught.
        """
        last = len(now.effects) - 1
        if before.cost - now.cost > DOUBTED and significance(now.found, last) > DOUBTED:
            return None
        self.trials.drop(now, last)
        less = self.trials.without(now, last)
        return less if less is not None and less.cost < before.cost - 1.0 else None

    def _matters(self, before: EffectChange, after: EffectChange) -> bool:
        """Whether a new effect explains some of all that was missing, or a good part of what still is.

        Where much is left that no effect explains, any of them takes a little of it.
        """
        gain = before.cost - after.cost
        return gain > SOME * above_noise(self.trials.base) or gain > GOOD * above_noise(before.found)

    def _surveyed(self, now: EffectChange) -> tuple[EffectChange, EffectChange | None]:
        """A step, and the model whose strayed parameters are at their nominal values, if any are not.

        Damping delays displacement and voltage as a skew delays the voltage: once it has taken the place of one, no
        small step leads from the one to the other.
        """
        held = self.trials.held(now)
        if held is not None and now.effects and held.cost < now.cost + CLOSE:
            # With fewer parameters it fits as well: they had strayed into a minimum that is no lower.
            freed = self.trials.freed(held, now)
            if freed is not None and (
                freed.cost < now.cost - CLOSE or (freed.cost < now.cost + CLOSE and not self.trials.strayed(freed))
            ):
                return self._surveyed(self.trials.redetermined(freed))
        return now, held

    def _passed_by(self, before: EffectChange, now: EffectChange) -> bool:
        """Whether the likeliest effect leaves all places that stand out, any of which its cause would gain more by."""
        places = self._places(before)
        worst = max(places.values(), default=0.0)
        if before.cost - now.cost > worst:
            return False
        after = self._places(now)
        return all(after.get(key, 0.0) > KEPT * above for key, above in places.items() if above > OUTSTANDING * worst)

    def _places(self, step: EffectChange) -> dict[tuple[str, str, str], float]:
        """Squares above noise of all places that stand out: of what is worth an effect, drives' noise has no share."""
        left = self.trials.structure(step.found, scattered=False)
        return {place.key: place.above for place in left}

    def _next(self, now: EffectChange, held: EffectChange | None) -> list[EffectChange]:
        """Full fits with one effect more, the best first and more than chance; none where nothing is.

        Where parameters have strayed, the model that holds them is asked, too, unless they have gained less by straying
        than an effect promises, or its fit brings them back.
        """
        candidates, tried = self.trials.scores(now), list[EffectChange]()
        for origin in (now, held):
            if origin is None:
                break
            tried = self._stage(now, origin, tried)
            chances = {id(step): self._p_value(now, step, candidates) for step in tried}
            if min(chances.values(), default=1.0) < LEVEL:
                tried = sorted(tried, key=lambda step: chances[id(step)] >= LEVEL)
                gained = 0.0 if held is None else held.cost - now.cost
                if origin is held or gained < candidates[0].score or not self.trials.strayed(tried[0]):
                    return tried
        return []

    def _stage(self, now: EffectChange, origin: EffectChange, tried: Sequence[EffectChange]) -> list[EffectChange]:
        """Full fits of the effects that are promising against a model, and those so far, the best first."""
        scored, chosen = self.trials.scores(origin), dict[str, Effect]()
        if not _any(scored):
            return list(tried)
        for candidate in scored:
            if candidate.score > PROMISING * scored[0].score and _hopeful(candidate, scored):
                chosen.setdefault(key_of(candidate.effect), candidate.effect)
        more = list(tried)
        for effect in list(chosen.values())[: FITS if origin is now else STAND_INS]:
            varied = now.found.model.parameters
            fitted = self.trials.extended(origin, effect, aim_beside(more), varied, most=BRIEF)
            more += [] if fitted is None else [fitted]
        return self.trials.finished(more)

    def _nested(self, now: EffectChange) -> tuple[Fit, ...]:
        """Fits with the first effect, the first two, and so on."""
        steps = [now]
        while len(steps[0].effects) > self.given + 1:
            less = self.trials.without(steps[0], len(steps[0].effects) - 1)
            if less is None:
                break
            steps.insert(0, less)
        count = len(now.effects) - self.given
        steps = [steps[0]] * (count - len(steps)) + steps
        return tuple(step.found for step in steps) if count else ()

    def _p_value(self, before: EffectChange, after: EffectChange, tried: Sequence[ScoredEffect]) -> float:
        """Of an effect that was added, corrected for the number of starts that were tried.

        A time constant, say, is tried by these already and does not count again as a number that the effect takes: the
        starts stand about as densely as Davies's bound, by how far apart their signatures are, would count them. The
        frequency of a line was picked from the data instead.
        """
        freedom = self._numbers(after.found, -1) if effect_line(after.found.model.transducer.effects[-1]) else 1
        return min(1.0, float(chi2.sf(_reliable(before, after, -1), freedom)) * len(tried))

    def _numbers(self, found: Fit, n: int) -> int:
        """Numbers that the n-th effect takes."""
        effects = found.model.transducer.effects
        n = n % len(effects)
        own = sum(parameter.path[:2] == ("effects", n) for parameter in found.model.parameters)
        lines = sum(
            2
            for data in self.trials.problem.data
            for channel in (*data.channels, getattr(data, "drive", ""))
            if effects[n].line(channel)
        )
        return own + lines

    def _revised(self, now: EffectChange, levels: list[float]) -> tuple[EffectChange, list[float]]:
        """Throw out what is no longer needed, and exchange what another effect explains better."""
        n = self.given
        while n < len(now.effects) - 1:
            self.trials.drop(now, n)  # another start than that of its stage
            less = self.trials.without(now, n)
            if less is None:
                n += 1
                continue
            gone = float(chi2.sf(_reliable(less, now, n), self._numbers(now.found, n)))
            if gone > LEVEL:
                self.trials.tell(f"{now.effects[n]} is not needed any more")
                now, levels = less, self._without(levels, n)
                continue
            better = self._exchanged(now, less, n)
            if better is None:
                n += 1
                continue
            p_value = self._p_value(less, better, self.trials.scores(less))
            now, levels = better, [*self._without(levels, n), p_value]
            n = self.given
        return now, levels

    def _determined(self, now: EffectChange, levels: list[float]) -> tuple[EffectChange, list[float]]:
        """Effects of a search that is at its end, without those whose sizes are all but nothing for their errors.

        Before the others were found these errors were larger: what was missing counts as noise.
        """
        n = len(now.effects) - 1
        while n >= self.given:
            if errors(self.trials.problem, now.found, n) < CERTAIN:
                less = self.trials.without(now, n)
                if less is not None:
                    self.trials.tell(f"{now.effects[n]} is within {CERTAIN:g} standard errors of nothing")
                    now, levels = less, self._without(levels, n)
                    n = len(now.effects)
            n -= 1
        return now, levels

    def _without(self, levels: list[float], n: int) -> list[float]:
        """Levels without that of the n-th effect."""
        return [level for k, level in enumerate(levels, self.given) if k != n]

    def _exchanged(self, now: EffectChange, less: EffectChange, n: int) -> EffectChange | None:
        """Model with another effect in the place of the n-th, if that fits better."""
        if _indispensable(now, less):
            return None
        for candidate in self.trials.scores(less)[:3]:
            if candidate.name == now.effects[n] or candidate.score < 0.8 * (less.cost - now.cost):
                continue
            other = self.trials.extended(less, candidate.effect, now.fair_cost)
            if other is not None and other.fair_cost < now.fair_cost - 1.0:
                self.trials.tell(f"{candidate.name} instead of {now.effects[n]}")
                return other
        return None

    def _alternatives(
        self, now: EffectChange, others: Sequence[EffectChange]
    ) -> tuple[tuple[EffectChange, float], ...]:
        """Sets of as many effects that are nearly as likely."""
        found: dict[frozenset[str], tuple[EffectChange, float]] = {}
        pool = [step for step in others if len(step.effects) == len(now.effects)]
        for n in range(self.given, len(now.effects) - 1):
            less = self.trials.without(now, n)
            if less is None or _indispensable(now, less):
                continue
            for candidate in self.trials.scores(less)[:4]:
                if candidate.name not in now.effects and candidate.score > less.cost - now.cost - 3 * CLOSE:
                    other = self.trials.extended(less, candidate.effect, now.fair_cost + CLOSE)
                    pool += [other] if other is not None else []
        for step in pool:
            more = step.fair_cost - now.fair_cost
            if more < CLOSE and set(step.effects) != set(now.effects):
                key = frozenset(step.effects)
                if key not in found or more < found[key][1]:
                    found[key] = (step, more)
        return tuple(sorted(found.values(), key=lambda pair: pair[1]))


def above_noise(found: Fit) -> float:
    """Squares of the whitened residuals above those that noise has."""
    return sum(float(sums.squares.sum() - sums.count.sum()) for sums in found.sums)


def _indispensable(now: EffectChange, less: EffectChange) -> bool:
    """Whether a fit without an effect was given up so far off that no other can take its place."""
    return not less.found.converged and less.cost > now.cost + NEEDED


def _reliable(without: EffectChange, found: EffectChange, n: int) -> float:
    """What the n-th effect takes off -2 ln L, less as its strength scatters more than white noise would make it."""
    return (without.cost - found.cost) / inflated(found.found, n)


def _any(candidates: Sequence[ScoredEffect]) -> bool:
    """Whether one of them may be more than chance."""
    return any(_hopeful(candidate, candidates) for candidate in candidates)


def _hopeful(candidate: ScoredEffect, others: Sequence[ScoredEffect]) -> bool:
    """Whether one of so many candidates may be more than chance when it is fitted."""
    finds = len(effect_parameters([candidate.effect])) > 1
    return candidate.p_value * len(others) < (HOPE * LEVEL if finds else LEVEL)
