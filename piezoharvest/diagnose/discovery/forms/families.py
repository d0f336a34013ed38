"""The families of formulas that a law may be of: those of springs, contacts, diodes and friction, with their starts."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from piezoharvest.description.effects.nameless.circuit_places import Diode
from piezoharvest.description.effects.nameless.forms import (
    DeadZone,
    Hertz,
    Knee,
    Line,
    Monomial,
    Polynomial,
    Power,
    TwoKnees,
)
from piezoharvest.description.effects.nameless.places import TIMES
from piezoharvest.description.effects.nameless.shapes import (
    SCALED,
    Bump,
    Coulomb,
    Shape,
    Shockley,
    StepChange,
    Stribeck,
)
from piezoharvest.description.effects.nameless.sizes import SIZES
from piezoharvest.diagnose.discovery.forms.distance import SAMPLES, Distance, of_itself, recorded
from piezoharvest.diagnose.discovery.forms.family import Family, column
from piezoharvest.diagnose.discovery.law_fits import LawFit

EPSILON = float(np.finfo(float).eps)
WHOLE_EXPONENTS, POLYNOMIALS = (2, 3, 4, 5), ((2, 3), (3, 5))  # of monomials, and of those with two terms
HERTZ = (1.5, 2.0 / 3.0)  # exponents of a contact
WIDTH = 0.01  # of the largest velocity: within it dry friction is rounded off
EXPONENTS = (1e-6, 0.5, 1.5, 2.5, 3.5, 20.0)  # start values of an exponent, from a step at zero to one at the end
STEP_WIDTH = 0.05  # start value of a change over time, of all records: about the distance of a table's corners
BUMP_WIDTHS = (0.05, 0.2)  # start values of what comes and goes within that time
STEPS = 48  # start values of its moment, evenly over the samples: a few between two corners
# Largest scale of a curve, of the largest input, without and with its straight line taken out: there its values differ
# from the first term of its series by as much as by rounding, whose share grows with the scale or with its square.
STRAIGHT, CURVED = EPSILON ** (-1 / 2), EPSILON ** (-1 / 3)
SCALES = (0.05, 0.15, 0.4, 1.0)  # start values of a curve's scale, of the largest input, beside the largest
EXCESSES, SPEEDS = (-0.8, 0.1, 0.5, 2.0), (0.05, 0.15, 0.4)  # start values of another friction near zero
SATURATING = ("exponential", "tanh", "langevin")  # curves that come to an end, the first on one side
SATURATION_CURRENTS = (1e-5, 1e-4, 1e-3, 1e-2)  # further ones of a logarithm over a current, as that of a diode


def families(table: LawFit, distance: Distance) -> Iterator[Family | tuple[Family, ...]]:
    """Families of formulas for a table; a tuple where one has parts, of which the best stands for it."""
    place, bent = table.place, table.law.bent
    low, high = float(table.visited.min()), float(table.visited.max())
    size = max(abs(low), abs(high))
    # What parts of a circuit pass has one sign, but for what is left at the beginning of a record.
    sides = [1] if place.in_circuit else [side for side in (1, -1) if side * (high if side > 0 else low) > 0.0]
    if not bent:
        begin = low if place.input in SIZES else 0.0  # the model's parameter is that under the least drive
        yield Family(Line(factor=0.0, start=begin))
    if place.input in TIMES:
        yield _step(table)
        yield _bump(table)
    yield from _powers(size, sides)
    if place.needs_slope:
        return  # a corner has no slope, and neither has its reciprocal force
    yield from _knees(table, distance, sides)
    yield from _curves(table, distance, size)


def _step(table: LawFit) -> Family:
    """A change at a moment, from each of many."""
    length, sample = recorded(table.visited)
    moments = np.quantile(table.visited, np.linspace(0.02, 0.98, STEPS))
    form = StepChange(factor=0.0, at=0.0, width=sample, finest=sample)

    def values(c: list, u: list) -> dict:
        return {"factor": c[0], "at": u[0], "width": sample + length * np.exp(u[1])}

    return Family(form, values, np.array([(moment, np.log(STEP_WIDTH)) for moment in moments]))


def _bump(table: LawFit) -> Family:
    """What comes and goes, with its height at each of many moments."""
    length, sample = recorded(table.visited)
    moments = np.quantile(table.visited, np.linspace(0.02, 0.98, STEPS))

    def values(c: list, u: list) -> dict:
        return {"factor": c[0], "at": u[0], "width": sample + length * np.exp(u[1])}

    starts = [(moment, np.log(share)) for moment in moments for share in BUMP_WIDTHS]
    return Family(Bump(factor=0.0, at=0.0, width=sample), values, np.array(starts))


def _knees(table: LawFit, distance: Distance, sides: list[int]) -> Iterator[Family]:
    """Broken lines, with corners at or between the inputs."""
    x, sizes = distance.x, np.unique(np.abs(distance.x))
    # Two corners that have passed each other halve a slope; beside a straight line they are those that have not.
    both = sizes if table.law.bent else np.unique([-sizes, sizes])
    for side in (2, *sides) if len(sides) == 2 else sides:
        # On the other side of zero a corner comes with a constant.
        knees = both if side == 2 else x if distance.with_constant else x[side * x >= 0.0]
        yield Family(
            Knee(factor=0.0, knee=0.0, sides=side),
            lambda c, u: {"factor": c[0], "knee": u[0]},
            knees=(knees,),
        )
    if len(sides) == 2 and not table.place.in_circuit:
        yield Family(
            TwoKnees(factor=0.0, second=0.0, upper=0.0, lower=0.0),
            lambda c, u: {"factor": c[0], "second": c[1], "upper": u[0], "lower": u[1]},
            factors=2,
            knees=(x, x),
        )
    if not table.law.bent:  # else it is a knee beside the model's straight line
        yield Family(
            DeadZone(factor=0.0, zone=1.0),
            lambda c, u: {"factor": c[0], "zone": u[0]},
            knees=(sizes[sizes > 0.0],),
        )


def _powers(size: float, sides: list[int]) -> Iterator[Family | tuple[Family, ...]]:
    """Powers and polynomials, all of which have a slope."""
    for exponent in WHOLE_EXPONENTS:
        yield Family(Monomial(factor=0.0, scale=size, exponent=exponent))
    for pair in POLYNOMIALS:
        form = Polynomial(factor=0.0, second=0.0, scale=size, exponents=pair)
        yield Family(form, lambda c, u: {"factor": c[0], "second": c[1]}, factors=2)

    def values(c: list, u: list) -> dict:
        return {"factor": c[0], "exponent": np.exp(u[0])}

    # Of an input that has one sign all of these are the same function.
    for odd in (True, False) if len(sides) == 2 else (False,):
        yield Family(Power(factor=0.0, exponent=1.0, scale=size, odd=odd), values, column(np.log(EXPONENTS)))
    for side in sides:
        if len(sides) == 2:
            form = Power(factor=0.0, exponent=1.0, scale=size, odd=False, side=side)
            yield Family(form, values, column(np.log(EXPONENTS)))
        for exponent in HERTZ:
            yield Family(Hertz(factor=0.0, exponent=exponent, scale=size, odd=False, side=side))


def _curves(table: LawFit, distance: Distance, size: float) -> Iterator[Family | tuple[Family, ...]]:
    """Curves with a scale, which equations have as broken lines.

    Where inputs come to zero, one that has come to its end before the least of the others is a constant: a table cannot
    tell it from sharper ones, in which a fit would begin with no slope to any other scale.
    """
    place, sizes = table.place, np.abs(distance.x)
    at_zero = sizes.min() <= np.ptp(distance.x) / SAMPLES
    sharpest = float(sizes[sizes > 0.0].min()) / size if at_zero else 0.0
    for curve, bent in product(SCALED, (False, True) if of_itself(place) else (table.law.bent,)):
        most = CURVED if bent else STRAIGHT
        shares = (*SCALES, most, *SATURATION_CURRENTS * (place.in_circuit and curve == "log"))
        # Of the scale the logarithm is varied: a saturation current may be off by decades.
        yield tuple(
            Family(
                Shape(factor=0.0, scale=sign * size, curve=curve, bent=bent),
                lambda c, u, s=sign: {"factor": c[0], "scale": s * size * np.exp(u[0])},
                column(np.log(shares)),
                least=np.log(sharpest) if curve in SATURATING and sharpest > 0.0 else -np.inf,
                most=np.log(most),
            )
            for sign in ((1.0, -1.0) if curve == "exponential" else (1.0,))
        )
    if isinstance(place, Diode):
        starts = column(np.log(SATURATION_CURRENTS))
        form = Shockley(factor=0.0, scale=size, resistance=0.0)
        with_resistance = Family(
            form, lambda c, u: {"factor": c[0], "resistance": c[1], "scale": size * np.exp(u[0])}, starts, factors=2
        )
        without = Family(form, lambda c, u: {"factor": c[0], "resistance": 0.0, "scale": size * np.exp(u[0])}, starts)
        yield with_resistance, without  # the best has none where it would be below zero
    if place.input in ("velocity", "displacement_rate"):
        width = WIDTH * size
        yield Family(Coulomb(factor=0.0, width=width))
        yield Family(
            Stribeck(factor=0.0, excess=0.0, speed=size, width=width),
            lambda c, u: {"factor": c[0], "excess": np.exp(u[0]) - 1.0, "speed": size * np.exp(u[1])},
            np.array([(np.log(1.0 + e), np.log(share)) for e in EXCESSES for share in SPEEDS]),
        )
