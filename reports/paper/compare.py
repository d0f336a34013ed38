"""Candidate explanations side by side: error on all rows, error on rows left out, and what the fit makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from reports.paper.candidates import (
    ELECTRICAL,
    EXTENDED,
    HYSTERETIC,
    MECHANICAL,
    START,
    Candidate,
    Choice,
    with_choices,
)
from reports.paper.extended import extended_fit
from reports.paper.fitting import Fit, fit, left_out, rms
from reports.paper.tables import Row, all_rows, rows
from reports.paper.vocabulary import BASE, EFFECTS, Effect, candidate

LOADS = ("R1", "R2", "R3")


@dataclass(frozen=True)
class Comparison:
    """A fitted candidate and how it predicts.

    Attributes
    ----------
    fit : Fit
    left_out : float
        Root mean square of the residuals of all left-out rows; NaN where none were left out.
    worst : str
        The fold that is predicted worst, and its error.
    """

    fit: Fit
    left_out: float
    worst: str


def compared(found: Fit, chosen: Sequence[Row]) -> Comparison:
    """Predict rows that are left out of a fit."""
    out = left_out(found, chosen)
    worst = max(out, key=lambda name: rms(out[name]))
    everything = np.concatenate([values.ravel() for values in out.values()])
    return Comparison(found, rms(everything), f"{worst}: {rms(out[worst]):.2f}")


def _all(candidates: Sequence[Candidate], chosen: Sequence[Row]) -> list[Comparison]:
    return [compared(fit(candidate, chosen), chosen) for candidate in candidates]


@cache
def electrical() -> list[Comparison]:
    """Linear candidates for Tables I and II."""
    return _all(ELECTRICAL, [*rows("I"), *rows("II")])


@cache
def hysteretic() -> list[Comparison]:
    """Candidates with the published hysteresis: one search each, from the fit with leakage, and no rows left out."""
    near = next(c.fit.parameters for c in electrical() if "leak" in c.fit.candidate.free)
    fits = [fit(candidate, [*rows("I"), *rows("II")], near=near) for candidate in HYSTERETIC]
    return [Comparison(found, float("nan"), "") for found in fits]


@cache
def mechanical() -> list[Comparison]:
    """Candidates for Tables III and IV."""
    return _all(MECHANICAL, [*rows("III"), *rows("IV")])


@cache
def choices() -> list[Comparison]:
    """Leakage and slow polarisation with everything that the paper leaves open."""
    open_ones = [one for candidate in ELECTRICAL[-2:] for one in with_choices(candidate)]
    return _all(open_ones, [*rows("I"), *rows("II")])


@cache
def extended() -> Comparison:
    """The extended model on all four tables."""
    return compared(extended_fit(), all_rows())


@cache
def extended_by_load() -> list[Fit]:
    """The extended model with each of the loads that the sines may have had."""
    return [fit(replace(EXTENDED, choice=Choice(sine_load=n)), all_rows()) for n in range(len(LOADS))]


def plausible() -> list[Comparison]:
    """Choices whose error on left-out rows is within a half of the best one's: the data do not tell them apart."""
    best = min(c.left_out for c in choices())
    return [c for c in choices() if c.left_out < 1.5 * best]


@dataclass(frozen=True)
class Tried:
    """An effect of the vocabulary on all four tables, in the form that predicts left-out rows best.

    `alone` is without leak and joint, `beside` with both; the latter is None for what the extended model has already.
    """

    effect: Effect
    alone: Comparison
    beside: Comparison | None


@cache
def before_effects() -> tuple[Comparison, Comparison]:
    """What effects are added to: coupling, capacitance and the settings of the experiment; and the extended model."""
    base = fit(candidate(BASE), all_rows(), near=extended_fit().parameters)
    whole = fit(candidate(EXTENDED.free), all_rows(), near=extended_fit().parameters)
    return compared(base, all_rows()), compared(whole, all_rows())


@cache
def vocabulary() -> tuple[Tried, ...]:
    """Every effect of the vocabulary that two numbers a row may show."""
    base, whole = before_effects()
    return tuple(
        Tried(effect, _best(base, effect), None if effect.name == "leakage" else _best(whole, effect))
        for effect in EFFECTS
    )


def _best(before: Comparison, effect: Effect) -> Comparison:
    """The effect in each of its forms beside what was fitted before, and the best of these."""
    found = []
    for n, form in enumerate(effect.forms):
        near = {**before.fit.parameters, **{name: START[name] for name in form}}
        found.append(compared(fit(candidate(before.fit.candidate.free, effect, n), all_rows(), near=near), all_rows()))
    return min(found, key=lambda c: c.left_out)
