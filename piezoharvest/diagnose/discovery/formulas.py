"""Readable formulas for a law: fitted to its table first, then the best of them in its place in the model.

A formula is compared with a table on the table's own terms: the kinks that stand for it, with the covariance of those
that were found. Sources: Schwarz, Ann. Stat. 6(2), 461-464, 1978 (information criterion); the forms are those of
springs, contacts, diodes and friction.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from piezoharvest.description.effects.nameless.forms import Bends, Corners, Form, Knee, Monomial, Power, outward
from piezoharvest.description.effects.nameless.shapes import CURVES, Shape
from piezoharvest.diagnose.discovery.knots import fine_knots
from piezoharvest.diagnose.discovery.law_fits import LawFit, fitted
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.problem import Problem

SAMPLES = 400  # inputs at which formula and table are compared
REFITTED = 3  # formulas, the best on the table, that are fitted in the model
WHOLE_EXPONENTS = (2, 3, 4, 5)  # of a polynomial
EXPONENTS = (0.5, 1.5, 2.5, 3.5)  # start values of an exponent
KNEES = 12  # start values of a knee over the visited range
SCALES = (0.15, 0.4, 1.0)  # start values of a curve's scale, of the largest input


@dataclass(frozen=True)
class Candidate:
    """A formula with the values that come closest to the table, and its information criterion there."""

    form: Form
    criterion: float


Made = Callable[[np.ndarray], Form]


def candidates(table: LawFit) -> list[Candidate]:
    """Formulas for a table, the best first; each from several starts."""
    loss = _Loss(table)
    found: list[Candidate] = []
    for starts in _families(table):
        tried = [loss.closest(make, start) for make, start in starts]
        done = [each for each in tried if each is not None]
        found += [min(done, key=lambda each: each.criterion)] if done else []
    return sorted(found, key=lambda each: each.criterion)


def condensed(problem: Problem, base: Fit, table: LawFit) -> LawFit:
    """The table, or the formula that stands for it with fewer parameters, fitted in the model."""
    tried = [table]
    for each in candidates(table)[:REFITTED]:
        law = dataclasses.replace(table.law, form=each.form)
        found = fitted(problem, _with_law_left_out(table, base), law, table.visited, aim=table.criterion)
        tried += [found] if found is not None and found.found.converged else []
    return min(tried, key=lambda each: each.criterion)


def _with_law_left_out(table: LawFit, base: Fit) -> Fit:
    """The table's fit without its law: a start for a formula, whose parameters are those with the law."""
    found, model = table.found, table.found.model
    kept = tuple(p for k, p in enumerate(model.parameters) if k not in table.own)
    effects = model.transducer.effects[:-1]
    bare = dataclasses.replace(
        model, transducer=dataclasses.replace(model.transducer, effects=effects), parameters=kept, felt=None
    )
    places = [k for k in range(len(found.information)) if k not in table.own]
    return dataclasses.replace(
        found, model=bare, information=found.information[np.ix_(places, places)],
        prior=found.prior[np.ix_(places, places)],
    )  # fmt: skip


class _Loss:
    """Distance of a formula from a table, in units of the table's covariance."""

    def __init__(self, table: LawFit) -> None:
        form = table.form
        assert isinstance(form, Corners | Bends)
        self.table = table
        self.x = np.quantile(table.visited, np.linspace(0.0, 1.0, SAMPLES))
        self.x = np.unique(np.concatenate([self.x, np.linspace(self.x[0], self.x[-1], SAMPLES)]))
        sides, bent = outward(form.knots), isinstance(form, Bends)
        pieces = np.maximum(sides * (self.x[:, None] - np.array(form.knots)), 0.0)
        pieces = 0.5 * pieces**2 if bent else pieces
        self.basis = np.column_stack([pieces, np.ones(len(self.x)), *([self.x] if table.place.bent else [])])
        inside, right = table.normal
        values, vectors = np.linalg.eigh(inside)
        values = np.maximum(values, 0.0)
        self.root = (vectors * np.sqrt(values)).T
        self.kinks = np.linalg.lstsq(inside, right, rcond=1e-13)[0]
        self.size = np.abs(self.basis).max(axis=0)
        self.size[self.size == 0.0] = 1.0
        self.inverse = np.linalg.pinv(self.basis / self.size, rcond=1e-10)
        self.samples = sum(float(sums.count.sum()) for sums in table.found.sums)

    def residual(self, form: Form) -> np.ndarray:
        """Difference of the kinks that stand for a formula from those found, whitened."""
        with np.errstate(over="ignore", invalid="ignore"):
            kinks = (self.inverse @ np.real(form.values(self.x)) / self.size)[: len(self.kinks)]
            found = self.root @ (kinks - self.kinks)
        return np.where(np.isfinite(found), found, 1e150)

    def closest(self, make: Made, start: np.ndarray) -> Candidate | None:
        """The member of a family closest to the table; its first value is a factor that the law is linear in."""
        unit = self.residual(make(np.array([1.0, *start]))) - self.residual(make(np.array([0.0, *start])))
        offset = self.residual(make(np.array([0.0, *start])))
        size = float(unit @ unit)
        if not np.isfinite(size) or size <= 0.0 or size > 1e200:
            return None
        first = np.array([-float(unit @ offset) / size, *start])
        scale = np.abs(first) + 1e-300

        def loss(z: np.ndarray) -> np.ndarray:
            try:
                return self.residual(make(z * scale))
            except ValueError:  # outside its bounds
                return np.full(len(self.kinks), 1e150)

        if not np.all(np.isfinite(loss(first / scale))):
            return None
        done = least_squares(loss, first / scale, method="lm" if len(self.kinks) >= len(first) else "trf")
        try:
            form = make(done.x * scale)
        except ValueError:
            return None
        return Candidate(form, 2.0 * float(done.cost) + len(first) * np.log(self.samples))


def _families(table: LawFit) -> Iterator[list[tuple[Made, np.ndarray]]]:
    """Families of formulas, each with its starts."""
    place, low, high = table.place, float(table.visited.min()), float(table.visited.max())
    size = max(abs(low), abs(high))
    for exponent in WHOLE_EXPONENTS:
        yield [(lambda z, n=exponent: Monomial(factor=z[0], scale=size, exponent=n), np.zeros(0))]
    for odd in (True, False):
        make = lambda z, odd=odd: Power(factor=z[0], exponent=z[1], scale=size, odd=odd)  # noqa: E731
        yield [(make, np.array([n])) for n in EXPONENTS]
    if place.needs_slope:
        return  # a corner has no slope, and neither has its reciprocal force
    for sides in (2, 1, -1):
        reach = size if sides == 2 else high if sides == 1 else -low
        begin = 0.0 if sides == 2 or low < 0 < high else (low if sides == 1 else -high)
        knees = begin + (reach - begin) * np.linspace(0.04, 0.96, KNEES)
        make = lambda z, s=sides: Knee(factor=z[0], knee=z[1], sides=s)  # noqa: E731
        yield [(make, np.array([knee if sides != -1 else -knee])) for knee in knees]
    knots = fine_knots(table.visited)
    for curve in CURVES:
        make = lambda z, c=curve: Shape(factor=z[0], scale=z[1], curve=c, bent=place.bent, knots=knots)  # noqa: E731
        both = (1.0, -1.0) if curve == "exponential" else (1.0,)
        yield [(make, np.array([sign * share * size])) for share in SCALES for sign in both]
