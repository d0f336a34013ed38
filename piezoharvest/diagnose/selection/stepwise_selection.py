"""Stepwise selection of effects: score tests, full fits of the promising ones, forward and backward steps.

Source: Davies, Biometrika 74(1), 33-43, 1987 (tests where a parameter exists only under the alternative).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from scipy.stats import chi2

from piezoharvest.description.effects import Effect
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.residual_structure.residual_tests import ResidualTest
from piezoharvest.diagnose.scanning.signs import OtherSign, better_signs
from piezoharvest.diagnose.selection.candidate_fits import CandidateFits, FitRecord
from piezoharvest.diagnose.selection.effect_change import EffectChange, cost_to_reach, effect_key
from piezoharvest.diagnose.selection.score_tests import ScoredEffect, effect_parameters, is_line
from piezoharvest.diagnose.selection.significance import significance, standard_errors_from_zero, variance_inflation
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import excess_of, mean_square
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Step, each_told

FITS_PER_STAGE = 4  # full fits a stage
FITS_AT_NOMINAL = 2  # full fits a stage against the model with deviating parameters at their nominal values
STAGE_ITERATIONS = 6  # iterations after which a full fit waits for the others of its stage
EFFECTS_IN_ENGINE = 2  # effects that may leave a large misfit where each fit takes ten times as long
UNEXPLAINED_MESSAGE = "the largest excess of the residuals over the noise remains: no known effect explains it"


@dataclass(frozen=True)
class Search:
    """Result of a search.

    Attributes
    ----------
    base : Fit
        Fit without effects.
    nested : tuple of Fit
        Fits with the first effect, the first two, and so on.
    order : tuple of Effect
        The effects in the order in which they were found, with their fitted values.
    p_values : tuple of float
        Of each effect, corrected for the number of effects.
    first : tuple of ScoredEffect
        Scores of all effects against the model without any.
    left : tuple of ResidualTest
        Failed residual tests of the last fit.
    alternatives : tuple of (EffectChange, float)
        Other sets that are nearly as likely, with their additional cost; only sought where no residual test fails.
    fits : tuple of FitRecord
        Full fits that were made.
    other_signs : mapping of str to OtherSign
        Of effects whose sign the records do not tell, by name.
    """

    base: Fit
    nested: tuple[Fit, ...]
    order: tuple[Effect, ...]
    p_values: tuple[float, ...]
    first: tuple[ScoredEffect, ...]
    left: tuple[ResidualTest, ...]
    alternatives: tuple[tuple[EffectChange, float], ...]
    fits: tuple[FitRecord, ...]
    other_signs: Mapping[str, OtherSign] = field(default_factory=dict)

    @property
    def given_effects(self) -> int:
        """Number of effects that the campaign names, which are in every model."""
        return len(self.base.model.transducer.effects)

    @property
    def final(self) -> Fit:
        """Fit with all effects found."""
        return self.nested[-1] if self.nested else self.base

    @property
    def before_last(self) -> Fit:
        """Fit without the last effect."""
        return self.nested[-2] if len(self.nested) > 1 else self.base

    def without_last(self, left: tuple[ResidualTest, ...]) -> Search:
        """Copy without the last effect, and with the residual tests that fail then."""
        return replace(
            self, nested=self.nested[:-1], order=self.before_last.model.transducer.effects[self.given_effects :],
            p_values=self.p_values[:-1], left=left, alternatives=(),
        )  # fmt: skip


class _SearchState(NamedTuple):
    """State of a search.

    Attributes
    ----------
    now : EffectChange
    at_nominal : EffectChange or None
        Fit with the deviating parameters at their nominal values, if any deviate.
    levels : list of float
        p-values of the effects found.
    alternatives : list of EffectChange
        Other candidates for the last effect.
    added : bool
        True if an effect was added in the last step.
    """

    now: EffectChange
    at_nominal: EffectChange | None
    levels: list[float]
    alternatives: list[EffectChange]
    added: bool = True


class Searcher:
    """Search for effects in a campaign.

    Parameters
    ----------
    trials : CandidateFits
        Of the campaign.
    """

    def __init__(self, trials: CandidateFits):
        self.trials = trials

    @property
    def given_effects(self) -> int:
        """Number of effects that the campaign names: these are no finding."""
        return len(self.trials.base.model.transducer.effects)

    def run(self, start: EffectChange | None = None, p_values: Sequence[float] = ()) -> Search:
        """Find the effects that are missing from the model, or from one with effects that have these p-values."""
        trials = self.trials
        now, at_nominal = self._with_nominal_values(start or EffectChange(trials.base))
        first, found = trials.scores(now), _SearchState(now, at_nominal, list(p_values), [])
        while len(found.now.effects) < self.given_effects + thresholds.MAX_EFFECTS:
            try:
                more = self._add_effect(found)
            except PredictionError as error:  # the effects found so far can be simulated
                trials.progress(f"the search ends: with one more effect the model cannot predict the records ({error})")
                break
            if more is None:
                break
            before, found = found, more
            if more.added and (self._leaves_outstanding(before.now, more.now) or self._stays_large(more.now)):
                trials.progress(UNEXPLAINED_MESSAGE)
                break
        now, levels = self._drop_uncertain(found.now, found.levels)
        now, signs = self._with_better_signs(now) if len(now.effects) > self.given_effects else (now, {})
        trials.progress(Step("testing the residuals"))
        left = trials.failed_tests_refitted(now.found)
        try:
            close = () if left else self._alternatives(now, found.alternatives)
        except PredictionError as error:  # without one of its effects the model cannot be scored
            trials.progress(f"no other set is tried: with it the model cannot predict the records ({error})")
            close = ()
        return Search(
            trials.base, self._nested(now), now.found.model.transducer.effects[self.given_effects :], tuple(levels),
            tuple(first), left, close, tuple(trials.fit_records), signs,
        )  # fmt: skip

    def _with_better_signs(self, now: EffectChange) -> tuple[EffectChange, Mapping[str, OtherSign]]:
        """The step iterated to full convergence, with the likelier sign of effects that show by their squares."""
        refined = self.trials.refined(now)
        found, signs = better_signs(self.trials.problem, refined.found)
        if found is refined.found:
            return refined, signs
        better = EffectChange(found, now.begun)
        self.trials.remember(better)
        return better, signs

    def _add_effect(self, found: _SearchState) -> _SearchState | None:
        """State with one more effect, or in a better minimum without it; None where no effect is significant."""
        trials, now = self.trials, found.now
        if trials.follows_exactly(now):
            return None
        tried = self._significant_fits(now, found.at_nominal)
        if not tried:
            return None
        after, *alternatives = tried
        if not self._explains_enough(now, after):
            trials.progress(UNEXPLAINED_MESSAGE)
            return None
        level = self._p_value(now, after, trials.scores(now))
        better = self._restarted_without(now, after)
        if better is not None:
            level = self._p_value(better, after, trials.scores(now))
            if level > thresholds.SEARCH_LEVEL:
                trials.progress(f"{after.effects[-1]} only led to a better minimum, which does not need it")
                return _SearchState(*self._with_nominal_values(better), found.levels, [], added=False)
        trials.progress(f"found {', '.join(after.effects)}")
        settled = trials.restarted(trials.redetermine(trials.with_states_begun(trials.begun_as_shown(after))))
        after, levels = self._prune(settled, [*found.levels, level])
        return _SearchState(*self._with_nominal_values(after), levels, alternatives if better is None else [])

    def _restarted_without(self, before: EffectChange, now: EffectChange) -> EffectChange | None:
        """The fit before a new effect, restarted from the values with it, if that has a lower cost.

        The gain of a weak effect may be that of a better local minimum next to that of the earlier fit.
        """
        last = len(now.effects) - 1
        undoubted = thresholds.MIN_UNDOUBTED_GAIN
        if before.cost - now.cost > undoubted and significance(now.found, last) > undoubted:
            return None
        self.trials.fit_without(now, last)
        less = self.trials.best_without(now, last)
        return less if less is not None and less.cost < before.cost - thresholds.MIN_IMPROVEMENT else None

    def _explains_enough(self, before: EffectChange, after: EffectChange) -> bool:
        """True if a new effect explains some of the initial excess over noise, or a good part of the present one.

        Where much remains that no effect explains, any effect takes a little of it.
        """
        gain = before.cost - after.cost
        initial, present = excess_of(self.trials.base), excess_of(before.found)
        return gain > thresholds.MIN_SHARE_OF_INITIAL * initial or gain > thresholds.MIN_SHARE_OF_PRESENT * present

    def _with_nominal_values(self, now: EffectChange) -> tuple[EffectChange, EffectChange | None]:
        """A step, and the fit with its deviating parameters at their nominal values, if any deviate.

        Damping delays displacement and voltage as channel skew delays the voltage: once a parameter has taken the place
        of an effect, no small step leads from one to the other.
        """
        at_nominal = self.trials.at_nominal(now)
        if at_nominal is not None and now.effects and at_nominal.cost < now.cost + thresholds.CLOSE_COST:
            # It fits as well with fewer parameters: the deviation was that of another local minimum, which is no lower.
            freed = self.trials.with_freed_parameters(at_nominal, now)
            if freed is not None and (
                freed.cost < now.cost - thresholds.CLOSE_COST
                or (freed.cost < now.cost + thresholds.CLOSE_COST and not self.trials.deviating(freed))
            ):
                return self._with_nominal_values(self.trials.redetermine(freed))
        return now, at_nominal

    def _leaves_outstanding(self, before: EffectChange, now: EffectChange) -> bool:
        """True if the likeliest effect leaves all outstanding residual tests as they were, and gains less than any."""
        places = self._excesses(before)
        worst = max(places.values(), default=0.0)
        if before.cost - now.cost > worst:
            return False
        after = self._excesses(now)
        return all(
            after.get(key, 0.0) > thresholds.UNEXPLAINED_SHARE * above
            for key, above in places.items()
            if above > thresholds.OUTSTANDING_SHARE * worst
        )

    def _stays_large(self, now: EffectChange) -> bool:
        """True if two effects leave a large misfit of records behind diodes or switches, where each fit takes long.

        A third takes the place of what is none of them, as the two do.
        """
        several = len(now.effects) - self.given_effects >= EFFECTS_IN_ENGINE
        return self.trials.problem.needs_engine and several and mean_square(now.found) > thresholds.LARGE_MISFIT

    def _excesses(self, step: EffectChange) -> dict[tuple[str, str, str], float]:
        """Excess of all failed residual tests, the variance of drive noise (no reason for an effect) aside."""
        left = self.trials.failed_tests(step.found, drive_noise=False)
        return {place.key: place.excess_squares for place in left}

    def _significant_fits(self, now: EffectChange, at_nominal: EffectChange | None) -> list[EffectChange]:
        """Significant full fits with one more effect, the best first; empty where there are none.

        Where parameters deviate, the fit with them at their nominal values is extended as well, unless their deviation
        has gained less than the best score, or the extended fit brings them back.
        """
        candidates, tried = self.trials.scores(now), list[EffectChange]()
        for origin in (now, at_nominal):
            if origin is None:
                break
            tried = self._fit_stage(now, origin, tried)
            chances = {id(step): self._p_value(now, step, candidates) for step in tried}
            if min(chances.values(), default=1.0) < thresholds.SEARCH_LEVEL:
                tried = sorted(tried, key=lambda step: chances[id(step)] >= thresholds.SEARCH_LEVEL)
                gained = 0.0 if at_nominal is None else at_nominal.cost - now.cost
                if origin is at_nominal or gained < candidates[0].score or not self.trials.deviating(tried[0]):
                    return tried
        return []

    def _fit_stage(self, now: EffectChange, origin: EffectChange, tried: Sequence[EffectChange]) -> list[EffectChange]:
        """Full fits of the promising effects against a model, and those so far, the best first."""
        scored = self.trials.scores(origin)
        if not _any_promising(scored):
            return list(tried)
        least, more = thresholds.MIN_RELATIVE_SCORE * scored[0].score, list(tried)
        chosen = _best_of_each([each for each in scored if each.score > least and _is_promising(each, scored)])
        chosen = chosen[: FITS_PER_STAGE if origin is now else FITS_AT_NOMINAL]
        for each in self._each_tested(chosen):
            varied = self.trials.varied(now)
            fitted = self.trials.extended(
                origin, each.effect, cost_to_reach(more), varied, most=STAGE_ITERATIONS, begun=each.begun
            )
            more += [] if fitted is None else [fitted]
        return self.trials.complete(more)

    def _each_tested(self, candidates: Sequence[ScoredEffect], instead: str = "") -> Iterator[ScoredEffect]:
        """Effects that are fitted, each told before; a fit that will not be as good as the others ends early."""
        return each_told(self.trials.progress, lambda each: f"testing {each.name}{instead}", candidates, most=True)

    def _nested(self, now: EffectChange) -> tuple[Fit, ...]:
        """Fits with the first effect, the first two, and so on."""
        steps = [now]
        while len(steps[0].effects) > self.given_effects + 1:
            less = self.trials.best_without(steps[0], len(steps[0].effects) - 1)
            if less is None:
                break
            steps.insert(0, less)
        count = len(now.effects) - self.given_effects
        steps = [steps[0]] * (count - len(steps)) + steps
        return tuple(step.found for step in steps) if count else ()

    def _p_value(self, before: EffectChange, after: EffectChange, tried: Sequence[ScoredEffect]) -> float:
        """p-value of an added effect, corrected for the number of starts that were tried.

        A time constant is tried by these starts already and does not count as a degree of freedom: the starts are about
        as dense as Davies's bound, by the distances of their signatures, would count them. The frequency of a line is
        picked from the data instead, and counts.
        """
        last = len(after.effects) - 1
        if is_line(after.found.model.transducer.effects[-1]):
            freedom = self.trials.parameter_count(after.found, last)
        else:
            freedom = 1 + self.trials.count_begun(after.found.model, last)
        return min(1.0, float(chi2.sf(_deflated_gain(before, after, -1), freedom)) * len(tried))

    def _prune(self, now: EffectChange, levels: list[float]) -> tuple[EffectChange, list[float]]:
        """Remove effects that are no longer significant, and exchange those that another explains better."""
        n = self.given_effects
        while n < len(now.effects) - 1:
            self.trials.fit_without(now, n)  # from another start than in its stage
            less = self.trials.best_without(now, n)
            if less is None:
                n += 1
                continue
            p_value = float(chi2.sf(_deflated_gain(less, now, n), self.trials.parameter_count(now.found, n)))
            if p_value > thresholds.SEARCH_LEVEL:
                self.trials.progress(f"{now.effects[n]} is no longer needed")
                now, levels = less, self._p_values_without(levels, n)
                continue
            better = self._exchange(now, less, n)
            if better is None:
                n += 1
                continue
            p_value = self._p_value(less, better, self.trials.scores(less))
            now, levels = better, [*self._p_values_without(levels, n), p_value]
            n = self.given_effects
        return now, levels

    def _drop_uncertain(self, now: EffectChange, levels: list[float]) -> tuple[EffectChange, list[float]]:
        """Fit without the effects whose strengths are within their standard errors of zero, at the end of a search.

        These errors were larger before the other effects were found: the missing part counted as noise.
        """
        n = len(now.effects) - 1
        while n >= self.given_effects:
            if standard_errors_from_zero(self.trials.problem, now.found, n) < thresholds.MIN_STANDARD_ERRORS:
                less = self.trials.best_without(now, n)
                if less is not None:
                    self.trials.progress(
                        f"{now.effects[n]} is within {thresholds.MIN_STANDARD_ERRORS:g} standard errors of zero"
                    )
                    now, levels = less, self._p_values_without(levels, n)
                    n = len(now.effects)
            n -= 1
        return now, levels

    def _p_values_without(self, levels: list[float], n: int) -> list[float]:
        """p-values without that of the n-th effect."""
        return [level for k, level in enumerate(levels, self.given_effects) if k != n]

    def _exchange(self, now: EffectChange, less: EffectChange, n: int) -> EffectChange | None:
        """Fit with another effect instead of the n-th, if that fits better."""
        if _indispensable(now, less):
            return None
        enough = thresholds.MIN_EXCHANGE_SCORE * (less.cost - now.cost)
        best = self.trials.scores(less)[:3]
        chosen = [each for each in best if each.name != now.effects[n] and each.score >= enough]
        for candidate in self._each_tested(chosen, f" instead of {now.effects[n]}"):
            other = self.trials.extended(less, candidate.effect, now.fair_cost, begun=candidate.begun)
            if other is not None and other.fair_cost < now.fair_cost - thresholds.MIN_IMPROVEMENT:
                self.trials.progress(f"{candidate.name} instead of {now.effects[n]}")
                return other
        return None

    def _alternatives(
        self, now: EffectChange, others: Sequence[EffectChange]
    ) -> tuple[tuple[EffectChange, float], ...]:
        """Other sets of as many effects that are nearly as likely."""
        found: dict[frozenset[str], tuple[EffectChange, float]] = {}
        pool = [step for step in others if len(step.effects) == len(now.effects)]
        for n in range(self.given_effects, len(now.effects)):  # the last one, too: it may have taken another's place
            less = self.trials.best_without(now, n)
            if less is None or _indispensable(now, less):
                continue
            enough = less.cost - now.cost - 3 * thresholds.CLOSE_COST
            best = _best_of_each(self.trials.scores(less))[:FITS_PER_STAGE]
            chosen = [each for each in best if each.name not in now.effects and each.score > enough]
            for candidate in self._each_tested(chosen, f" instead of {now.effects[n]}"):
                aim = now.fair_cost + thresholds.CLOSE_COST
                other = self.trials.extended(less, candidate.effect, aim, begun=candidate.begun)
                pool += [other] if other is not None else []
        for step in pool:
            more = step.fair_cost - now.fair_cost
            if more < thresholds.CLOSE_COST and set(step.effects) != set(now.effects):
                key = frozenset(step.effects)
                if key not in found or more < found[key][1]:
                    found[key] = (step, more)
        return tuple(sorted(found.values(), key=lambda pair: pair[1]))


def _best_of_each(candidates: Sequence[ScoredEffect]) -> list[ScoredEffect]:
    """The best start of each effect, of candidates with the highest score first."""
    found = dict[str, ScoredEffect]()
    for candidate in candidates:
        found.setdefault(effect_key(candidate.effect), candidate)
    return list(found.values())


def _indispensable(now: EffectChange, less: EffectChange) -> bool:
    """True if a fit without an effect was abandoned so far off that no other effect can take its place."""
    return not less.found.converged and less.cost > now.cost + thresholds.INDISPENSABLE_GAIN


def _deflated_gain(without: EffectChange, found: EffectChange, n: int) -> float:
    """Decrease of -2 ln L by the n-th effect, divided by the variance inflation of its strength."""
    return (without.cost - found.cost) / variance_inflation(found.found, n)


def _any_promising(candidates: Sequence[ScoredEffect]) -> bool:
    """True if one of the scores may be significant."""
    return any(_is_promising(candidate, candidates) for candidate in candidates)


def _is_promising(candidate: ScoredEffect, others: Sequence[ScoredEffect]) -> bool:
    """True if one of so many candidates may be significant when it is fitted."""
    finds = len(effect_parameters([candidate.effect])) > 1
    return candidate.p_value * len(others) < (
        thresholds.PRELIMINARY_LEVEL_FACTOR * thresholds.SEARCH_LEVEL if finds else thresholds.SEARCH_LEVEL
    )
