"""What is said of an effect that a search found: its values, its gain on unseen records, whether it was chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.residual_structure.residual_tests import whitened_squares
from piezoharvest.diagnose.result import Named
from piezoharvest.diagnose.scanning.scan import Scan, spread
from piezoharvest.diagnose.selection.candidate_fits import CandidateFits
from piezoharvest.diagnose.selection.effect_change import EffectChange
from piezoharvest.diagnose.selection.score_tests import is_line
from piezoharvest.diagnose.selection.significance import line_amplitude
from piezoharvest.diagnose.selection.stepwise_selection import Search, excess_of
from piezoharvest.diagnose.validation import spoils, validated
from piezoharvest.identify.fitting.output_error import covariance
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.result import Identification
from piezoharvest.predict.parameters import value_at
from piezoharvest.records.campaign import Campaign

MIN_EXCESS = 9.0  # of the sum of squares: a smaller excess may be chance and is not divided between effects


def named_effects(
    campaign: Campaign,
    before: Identification,
    trials: CandidateFits,
    search: Search,
    squares: Sequence[tuple[float, float]],
) -> tuple[Named, ...]:
    """All effects of a search; none spoils unseen records if these would be worse without it."""
    named = (named_effect(trials.problem, search, n, squares) for n in range(len(search.order)))
    return tuple(
        replace(each, spoils=each.spoils and not _is_needed(campaign, before, trials, search, n))
        for n, each in enumerate(named)
    )


def last_is_chance(trials: CandidateFits, search: Search, named: Sequence[Named]) -> bool:
    """True if no test fails without the last effect, and the effect is weak or makes unseen records worse."""
    without = search.before_last
    if not named or not (
        named[-1].spoils or without.cost - search.final.cost < thresholds.MIN_EXPLAINED_SHARE * excess_of(search.base)
    ):
        return False
    # A model that has no solution without the effect is replaced by the next larger one.
    return len(without.model.transducer.effects) - search.given_effects < len(
        named
    ) and not trials.failed_tests_refitted(without)


def last_is_idle(search: Search, named: Sequence[Named], squares: Sequence[tuple[float, float]]) -> bool:
    """True if the last effect explains next to nothing of the excess on records that were not fitted.

    Where much is missing that no effect explains, any effect explains a little of it in the records it is fitted to.
    """
    with_it, without = (len(found.model.transducer.effects) for found in (search.final, search.before_last))
    if not named or named[-1].spoils or without == with_it:
        return False  # it is reported as spoiling, or there is no solution without it
    (first, count), (before, _), (after, _) = squares[0], squares[-2], squares[-1]
    scatter = thresholds.NOISE_DEVIATIONS * np.sqrt(2.0 * count)
    return before - after < min(
        thresholds.MIN_SHARE_OF_INITIAL * (first - count - scatter),
        thresholds.MIN_SHARE_OF_PRESENT * (before - count - scatter),
    )


def _is_needed(campaign: Campaign, before: Identification, trials: CandidateFits, search: Search, n: int) -> bool:
    """True if records that were not fitted would be worse without an effect that seemed to spoil them.

    The first of several effects may have done so while it compensated for the others, too.
    """
    if n == len(search.order) - 1:
        return False
    less = trials.best_without(EffectChange(search.final), search.given_effects + n)
    if less is None:
        return True
    unseen, checks = validated(campaign, before, [less.found, search.final])
    without, full = (whitened_squares(unseen, each)[0] for each in checks)
    return not spoils(without, full, less.cost - search.final.cost)


def named_effect(problem: Problem, search: Search, n: int, squares: Sequence[tuple[float, float]]) -> Named:
    """The n-th effect with its gain and its parameters."""
    (before, _), (after, _) = squares[n], squares[n + 1]
    gain = (before - after) / max(squares[0][0] - _noise_squares(*squares[-1]), MIN_EXCESS)
    values, held = values_of(problem, search, n)
    costs = [search.base.cost, *(each.cost for each in search.nested)]
    spoiled = spoils(before, after, costs[n] - costs[n + 1])
    gain, other = 0.0 if held else float(np.clip(gain, -1.0, 1.0)), search.other_signs.get(search.order[n].name)
    return Named(search.order[n], search.p_values[n], gain, values, spoiled, other)


def values_of(problem: Problem, search: Search, n: int) -> tuple[dict[str, tuple[float, float | None, str]], bool]:
    """Values of the n-th effect's parameters with standard errors and units, and whether it is held as it is."""
    final = search.final
    scatter = covariance(final)
    std = np.sqrt(np.diag(scatter))
    values: dict[str, tuple[float, float | None, str]] = {}
    for k, parameter in enumerate(final.model.parameters):
        if parameter.path[:2] == ("effects", search.given_effects + n):
            value = float(np.real(value_at(final.model.transducer, parameter.path)))
            inner = parameter.inner(value) if value else 0.0
            slope = value**2 if parameter.scaling == "reciprocal" else parameter.slope(inner)
            values[str(parameter.path[2])] = (value, float(slope * std[k]), parameter.unit)
    effect = search.order[n]
    held = not values and not effect.scanned and not is_line(effect)
    if held:  # a law does what it would do, and has its gain
        field = type(effect).strength()
        values[field.name] = (float(getattr(effect, field.name)), None, field.metadata["unit"])
    if is_line(effect):
        values["amplitude"] = (*line_amplitude(problem, final, search.given_effects + n, scatter), "")
    if effect.scanned:
        field = type(effect).strength()
        scan = Scan(problem, final, search.given_effects + n)
        values[field.name] = (scan.value, spread(*scan.interval()), field.metadata["unit"])
    other = search.other_signs.get(effect.name)
    if other is not None:
        name = type(effect).strength().name
        value, error, unit = values[name]
        values[name] = (value, other.spread(value, error or 0.0), unit)
    return values, held


def _noise_squares(squares: float, count: float) -> float:
    """Part of a sum of squares that noise may explain: all of it, if it may be noise alone."""
    return squares if squares < count + thresholds.NOISE_DEVIATIONS * np.sqrt(2.0 * count) else count
