"""Readable formulas for a law: fitted to its table first, then the best of them in its place in the model.

A formula is compared with a table on the table's own terms: the kinks that stand for it, with the covariance of those
that were found. Sources: Schwarz, Ann. Stat. 6(2), 461-464, 1978 (information criterion); the forms are those of
springs, contacts, diodes and friction.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from piezoharvest.description.effects import DiodeDropError
from piezoharvest.description.effects.nameless.circuit_places import Diode
from piezoharvest.description.effects.nameless.forms import (
    Bends,
    Corners,
    DeadZone,
    Form,
    Hertz,
    Knee,
    Line,
    Monomial,
    Polynomial,
    Power,
    TwoKnees,
    outward,
)
from piezoharvest.description.effects.nameless.places import TIMES, Place, Reading
from piezoharvest.description.effects.nameless.shapes import SCALED, Coulomb, Shape, Shockley, StepChange, Stribeck
from piezoharvest.description.effects.nameless.sizes import SIZES
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.forms.moments import better_moment
from piezoharvest.diagnose.discovery.knots import table_for
from piezoharvest.diagnose.discovery.law_fits import OWN, TABLES, LawFit, fitted, without_law
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.predict.parameters import Path, put, value_at

SAMPLES = 400  # inputs at which formula and table are compared
# Formulas, the closest to the table, that are fitted in the model; more where the table is too coarse for the curve, so
# that it leaves more than noise and closeness to it tells little.
REFITTED, REFITTED_BEYOND_TABLE = 3, 6
TABLE_IS_COARSE = 1.5  # mean square of whitened residuals with the table, beyond what noise scatters by
FARTHER = 4.0  # times as far from the table as the closest: a formula that is not fitted where a step is slow
WHOLE_EXPONENTS, POLYNOMIALS = (2, 3, 4, 5), ((2, 3), (3, 5))  # of monomials, and of those with two terms
HERTZ = (1.5, 2.0 / 3.0)  # exponents of a contact
WIDTH = 0.01  # of the largest velocity: within it dry friction is rounded off
EXPONENTS = (0.5, 1.5, 2.5, 3.5)  # start values of an exponent
KNEES = 12  # start values of a knee over the visited range
TWO_KNEES = 4  # the same for each of two on both sides
STEP_WIDTH = 0.05  # start value of a change over time, of all records: about the distance of a table's corners
STEPS = 48  # start values of its moment, evenly over the samples: a few between two corners
MOMENTS = 2  # times that a better moment is looked for from the last one
GAP = 10.0  # times the median distance of two samples: more is between two records
SCALES = (0.05, 0.15, 0.4, 1.0)  # start values of a curve's scale, of the largest input
SATURATION_CURRENTS = (1e-5, 1e-4, 1e-3, 1e-2)  # further ones of a logarithm over a current, as that of a diode


@dataclass(frozen=True)
class FittedFormula:
    """A formula with the values that come closest to the table, and its information criterion there."""

    form: Form
    criterion: float


Made = Callable[[np.ndarray], Form]
Start = tuple[Made, np.ndarray]


def candidates(table: LawFit) -> list[FittedFormula]:
    """Formulas for a table, the best first; each from several starts."""
    loss = _Loss(table)
    found: list[FittedFormula] = []
    for starts in _families(table):
        tried = [loss.closest(make, start) for make, start in starts]
        done = [each for each in tried if each is not None]
        found += [min(done, key=lambda each: each.criterion)] if done else []
    return sorted(found, key=lambda each: each.criterion)


def ranked(problem: Problem, table: LawFit, most: int = 0, kind: type[Form] = Form) -> list[LawFit]:
    """The table and the formulas that stand for it with fewer parameters, fitted in the model, the likeliest first.

    At least `most` of the formulas closest to the table are fitted, and of them those of a kind.
    """
    tried = [table]
    coarse = mean_square(table.found) > TABLE_IS_COARSE and not problem.needs_engine
    count = REFITTED_BEYOND_TABLE if coarse else REFITTED
    count *= 2 if _of_itself(table.place) else 1  # with and without its straight line a curve is as close to the table
    most = max(most, count)
    every = candidates(table) if isinstance(table.form, TABLES) else []
    most += any(isinstance(each.form, TwoKnees) for each in every[:most])  # it may be one knee
    # A table is too coarse to tell of a diode near no current, and of what happens at once.
    some = every[:most] + [each for each in every[most:] if isinstance(each.form, Shockley | StepChange)]
    some = [each for each in some if isinstance(each.form, kind)]
    for each in sorted(some, key=lambda each: not isinstance(each.form, StepChange)):
        own = isinstance(each.form, Shockley | StepChange)
        if problem.needs_engine and not own and each.criterion > FARTHER * some[0].criterion:
            continue
        # From a coarse table a formula begins far away, and how its fit goes on is not seen from its first steps.
        far = coarse and min(mean_square(one.found) for one in tried) > TABLE_IS_COARSE
        best = np.inf if far else min(one.criterion for one in tried) + thresholds.CLOSE_COST
        start, form = _begun(problem, table, each.form)
        found = fitted(problem, start, dataclasses.replace(table.law, form=form), table.visited, aim=best)
        if found is not None and isinstance(form, StepChange):
            found = _at_its_moment(problem, start, found)
        tried += [found] if found is not None and found.found.converged else []
    return sorted(tried, key=lambda each: each.criterion)


def _at_its_moment(problem: Problem, start: Fit, found: LawFit) -> LawFit:
    """The fit of a step at the best moment near it."""
    for _ in range(MOMENTS):
        better = better_moment(problem, found, STEP_WIDTH * recorded(found.visited)[0])
        law = better and dataclasses.replace(found.law, form=better)
        again = law and fitted(problem, start, law, found.visited)
        if again is None or not again.found.cost < found.found.cost:
            break
        found = again
    return found


def _begun(problem: Problem, table: LawFit, form: Form) -> tuple[Fit, Form]:
    """The fit without its table, from which that of a formula begins near its end, and the formula to begin with.

    The parameter of the model is less by the straight line that a formula has, not the table. At a diode it is the
    constant drop, which is free beside a law there; Shockley's diode has none, but a lower saturation current.
    """
    bare, loss, place = without_law(problem, table), _Loss(table), table.place
    transducer = bare.model.transducer
    path = drop_path(transducer) if place.in_circuit else (OWN.get(place.name, ""),)
    if path not in {p.path for p in bare.model.parameters} or table.law.memory is not None:
        return bare, form
    value = value_at(transducer, path) - (loss.constant(form) if place.in_circuit else loss.line(form))
    free = bare.model.parameters
    if isinstance(form, Shockley):  # a drop beside it would be its saturation current in other words
        form, value = dataclasses.replace(form, scale=form.scale * np.exp(-value / form.factor)), 0.0
        free = tuple(p for p in free if p.path != path)
    elif not value > 0.0 and path != ("coupling",):
        return bare, form
    moved = dataclasses.replace(bare.model, transducer=put(transducer, path, value), parameters=free)
    return dataclasses.replace(bare, model=moved), form


def drop_path(transducer: Transducer) -> Path:
    """Path of the free drop of diodes; empty where their label is trusted."""
    effects = transducer.effects
    return next((("effects", n, "diode_drop") for n, e in enumerate(effects) if isinstance(e, DiodeDropError)), ())


def as_table(problem: Problem, law: LawFit) -> LawFit | None:
    """The fit with a table over all that the law has visited, begun where the law is; None where it has no solution."""
    form, bare = table_for(law.place, law.visited), without_law(problem, law)
    if form is None:
        return None
    x = spread_inputs(law)
    basis = np.column_stack([_pieces(form, x), np.ones(len(x)), *[x] * law.law.bent])
    size = np.abs(basis).max(axis=0)
    found = np.linalg.lstsq(basis / size, np.real(law.form.values(x)), rcond=1e-10)[0] / size
    kinks, path = found[: len(form.kinks)], (OWN.get(law.place.name, ""),)
    if law.law.bent and path in {p.path for p in bare.model.parameters}:
        value = value_at(bare.model.transducer, path) + float(found[-1])
        if value > 0.0 or path == ("coupling",):
            moved = put(bare.model.transducer, path, value)
            bare = dataclasses.replace(bare, model=dataclasses.replace(bare.model, transducer=moved))
    begun = dataclasses.replace(law.law, form=dataclasses.replace(form, kinks=tuple(map(float, kinks))))
    return fitted(problem, bare, begun, law.visited, float(np.sqrt(np.mean(kinks**2))))


def spread_inputs(table: LawFit) -> np.ndarray:
    """Inputs at which forms of a law are compared with a table: where the records were, and evenly over that range."""
    x = np.quantile(table.visited, np.linspace(0.0, 1.0, SAMPLES))
    if table.place.input == "campaign_time":  # between the records nothing is known
        return np.unique(x)
    return np.unique(np.concatenate([x, np.linspace(x[0], x[-1], SAMPLES)]))


def recorded(times: np.ndarray) -> tuple[float, float]:
    """Length of what records cover of a time, without what lies between them, and the distance of two samples."""
    steps = np.diff(np.unique(times))
    sample = float(np.median(steps))
    return float(steps[steps < GAP * sample].sum()), sample


def _pieces(form: Corners | Bends, x: np.ndarray) -> np.ndarray:
    """What each kink of a table adds at inputs (n,), for a kink of one: (n, k)."""
    pieces = np.maximum(outward(form.knots) * (x[:, None] - np.array(form.knots)), 0.0)
    return 0.5 * pieces**2 if isinstance(form, Bends) else pieces


class _Loss:
    """Distance of a formula from a table, in units of the table's covariance."""

    def __init__(self, table: LawFit) -> None:
        form = table.form
        assert isinstance(form, Corners | Bends)
        self.table = table
        self.x = spread_inputs(table)
        # A voltage in a circuit begins at zero, with the current of the part, unless a constant drop of diodes is free
        # beside it; elsewhere a constant goes with offsets.
        fixed = table.place.in_circuit and not drop_path(table.found.model.transducer)
        # A gain of a sensor is all but a change of parameters, which a table has taken in any share.
        line = table.law.bent or _of_itself(table.place)
        self.basis = np.column_stack(
            [*_pieces(form, self.x).T, *[np.ones(len(self.x))] * (not fixed), *[self.x] * line]
        )
        inside, right = table.normal
        values, vectors = np.linalg.eigh(inside)
        values = np.maximum(values, 0.0)
        self.root = (vectors * np.sqrt(values)).T
        self.kinks = np.linalg.lstsq(inside, right, rcond=1e-13)[0]
        self.size = np.abs(self.basis).max(axis=0)
        self.size[self.size == 0.0] = 1.0
        self.inverse = np.linalg.pinv(self.basis / self.size, rcond=1e-10)

    def residual(self, form: Form) -> np.ndarray:
        """Difference of the kinks that stand for a formula from those found, whitened."""
        with np.errstate(over="ignore", invalid="ignore"):
            kinks = (self.inverse @ np.real(form.values(self.x)) / self.size)[: len(self.kinks)]
            found = self.root @ (kinks - self.kinks)
        return np.where(np.isfinite(found), found, 1e150)

    def line(self, form: Form) -> float:
        """Slope of the straight line in a formula beside what the kinks of the table can stand for."""
        return float((self.inverse @ np.real(form.values(self.x)) / self.size)[-1])

    def constant(self, form: Form) -> float:
        """Constant in a formula, likewise."""
        return float((self.inverse @ np.real(form.values(self.x)) / self.size)[len(self.kinks)])

    def closest(self, make: Made, start: np.ndarray) -> FittedFormula | None:
        """The member of a family closest to the table; its first value is a factor that the law is linear in."""
        unit = self.residual(make(np.array([1.0, *start]))) - self.residual(make(np.array([0.0, *start])))
        offset = self.residual(make(np.array([0.0, *start])))
        size = float(unit @ unit)
        if not np.isfinite(size) or size <= 0.0 or size > 1e200:
            return None
        first = np.array([-float(unit @ offset) / size, *start])
        scale = np.where(first == 0.0, 1.0, np.abs(first))

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
        return FittedFormula(form, 2.0 * float(done.cost) + len(first) * np.log(self.table.samples))


def _of_itself(place: Place) -> bool:
    """True for the reading of a channel over its own value."""
    return isinstance(place, Reading) and place.of == place.channel


def _families(table: LawFit) -> Iterator[list[Start]]:
    """Families of formulas, each with its starts."""
    place, bent = table.place, table.law.bent
    low, high = float(table.visited.min()), float(table.visited.max())
    size = max(abs(low), abs(high))
    sides = [side for side in (1, -1) if side * (high if side > 0 else low) > 0.0]
    if not bent:
        begin = low if place.input in SIZES else 0.0  # the model's parameter is that under the least drive
        yield [(lambda z: Line(factor=z[0], start=begin), np.zeros(0))]
    if place.input in TIMES:
        length, sample = recorded(table.visited)
        make = lambda z: StepChange(  # noqa: E731
            factor=z[0], at=z[1], width=sample + length * np.exp(z[2]), finest=sample
        )
        moments = np.quantile(table.visited, np.linspace(0.02, 0.98, STEPS))
        yield [(make, np.array([moment, np.log(STEP_WIDTH)])) for moment in moments]
    yield from _powers(size, sides)
    if place.needs_slope:
        return  # a corner has no slope, and neither has its reciprocal force
    for sides_of in (2, *sides) if len(sides) == 2 else sides:
        reach = size if sides_of == 2 else high if sides_of == 1 else -low
        begin = 0.0 if sides_of == 2 or low < 0 < high else (low if sides_of == 1 else -high)
        knees = begin + (reach - begin) * np.linspace(0.04, 0.96, KNEES)
        make = lambda z, s=sides_of: Knee(factor=z[0], knee=z[1], sides=s)  # noqa: E731
        yield [(make, np.array([knee if sides_of != -1 else -knee])) for knee in knees]
    if len(sides) == 2 and not place.in_circuit:
        make = lambda z: TwoKnees(factor=z[0], second=z[1] * z[0], upper=z[2], lower=z[3])  # noqa: E731
        shares = np.linspace(0.04, 0.96, TWO_KNEES)
        yield [(make, np.array([1.0, up * high, down * low])) for up in shares for down in shares]
    if not bent:  # else it is a knee beside the model's straight line
        zones = size * np.linspace(0.04, 0.96, KNEES)
        yield [(lambda z: DeadZone(factor=z[0], zone=z[1]), np.array([zone])) for zone in zones]
    yield from _curves(table, size)


def _powers(size: float, sides: list[int]) -> Iterator[list[Start]]:
    """Powers and polynomials, all of which have a slope."""
    for exponent in WHOLE_EXPONENTS:
        yield [(lambda z, n=exponent: Monomial(factor=z[0], scale=size, exponent=n), np.zeros(0))]
    for pair in POLYNOMIALS:
        make = lambda z, n=pair: Polynomial(factor=z[0], second=z[1] * z[0], scale=size, exponents=n)  # noqa: E731
        yield [(make, np.array([ratio])) for ratio in (-1.0, -0.1, 0.1, 1.0)]
    # Of an input that has one sign all of these are the same function.
    for odd in (True, False) if len(sides) == 2 else (False,):
        make = lambda z, odd=odd: Power(factor=z[0], exponent=z[1], scale=size, odd=odd)  # noqa: E731
        yield [(make, np.array([n])) for n in EXPONENTS]
    for side in sides:
        make = lambda z, s=side: Power(factor=z[0], exponent=z[1], scale=size, odd=False, side=s)  # noqa: E731
        if len(sides) == 2:
            yield [(make, np.array([n])) for n in EXPONENTS]
        for exponent in HERTZ:
            make = lambda z, n=exponent, s=side: Hertz(  # noqa: E731
                factor=z[0], exponent=n, scale=size, odd=False, side=s
            )
            yield [(make, np.zeros(0))]


def _curves(table: LawFit, size: float) -> Iterator[list[Start]]:
    """Curves with a scale, which equations have as broken lines."""
    place = table.place
    for curve, bent in product(SCALED, (False, True) if _of_itself(place) else (table.law.bent,)):
        both = (1.0, -1.0) if curve == "exponential" else (1.0,)
        shares = (*SCALES, *SATURATION_CURRENTS) if place.in_circuit and curve == "log" else SCALES
        # Of the scale the logarithm is varied: a saturation current may be off by decades.
        yield [
            (
                lambda z, c=curve, s=sign, b=bent: Shape(factor=z[0], scale=s * size * np.exp(z[1]), curve=c, bent=b),
                np.array([np.log(share)]),
            )
            for share in shares
            for sign in both
        ]
    if isinstance(place, Diode):
        make = lambda z: Shockley(  # noqa: E731
            factor=z[0], scale=size * np.exp(z[1]), resistance=z[0] * z[2] / size
        )
        yield [(make, np.array([np.log(share), 0.1])) for share in SATURATION_CURRENTS]
    if place.input in ("velocity", "displacement_rate"):
        width = WIDTH * size
        yield [(lambda z: Coulomb(factor=z[0], width=width), np.zeros(0))]
        make = lambda z: Stribeck(factor=z[0], excess=z[1], speed=z[2], width=width)  # noqa: E731
        yield [(make, np.array([excess, share * size])) for excess in (0.5, 2.0) for share in (0.05, 0.15, 0.4)]
