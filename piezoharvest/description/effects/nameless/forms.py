"""Functions of one input that a law without a name may be: tables of corners, and readable formulas.

Source of the tables: de Boor, A Practical Guide to Splines, 2001, chapters III and IX (broken lines; truncated powers).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.circuit import Row
from piezoharvest.description.parameters import Component, ParameterError, altered, check_choice, quantity
from piezoharvest.description.protocol import EquationBuilder

Array = Any  # a float array, complex where a parameter has a complex step
PIECES, REACH = 16, 2.0  # of a broken line that stands for a power, up to twice the input of reference


@dataclass(frozen=True, kw_only=True)
class Form(Component):
    """A function f of one input with f(0) = 0.

    Subclasses define `label` (the form's word in results), `values`, and `row`; where the function is smooth enough for
    a coupling, which needs its slope, also `slope`. `strengths` are the fields at whose zero the law is absent. What
    `row` has of the input itself, beside elements, is `proportional` to it.
    """

    label: ClassVar[str]
    strengths: ClassVar[tuple[str, ...]]
    smooth: ClassVar[bool] = False

    def values(self, x: np.ndarray) -> Array:
        """The function at inputs (n,)."""
        raise NotImplementedError

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        """The function of a row, as a row."""
        raise NotImplementedError

    def slope(self, specimen: EquationBuilder, x: Row) -> Row:
        """The derivative of the function of a row, as a row."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        super().__post_init__()
        own = self.__dict__
        for name in ("scale", "width"):
            value = own.get(name, 1.0)
            if isinstance(value, float) and 0.0 < abs(value) < np.inf:
                continue  # in little time: many forms are made in a fit
            if not np.all(np.isfinite(value)) or np.any(np.asarray(value) == 0.0):
                raise ParameterError(name, f"found {value!r:.60}, must be a finite number other than 0")
        check_choice("sides", own.get("sides", 2), (2, 1, -1))
        check_choice("side", own.get("side", 0), (0, 1, -1))
        if "knots" not in own:
            return
        knots = own["knots"]
        if not len(knots) or not np.all(np.isfinite(knots)):
            raise ParameterError("knots", f"found {knots!r:.60}, allowed are finite numbers, at least one")
        kinks = own.get("kinks", knots)
        if len(kinks) != len(knots):
            raise ParameterError("kinks", f"found {len(kinks)} for {counted(len(knots), 'knot')}, each knot needs one")

    @property
    def word(self) -> str:
        """The form's word in results."""
        return self.label

    @property
    def proportional(self) -> Any:
        """Factor of the input itself in the row of the function."""
        return 0.0

    @property
    def turns(self) -> tuple[Any, ...] | None:
        """Inputs above zero at which it turns as a broken line; None of a curve, which bends all along."""
        return None

    @property
    def absent(self) -> bool:
        """True if the function is zero everywhere."""
        return not any(np.any(np.asarray(getattr(self, name))) for name in self.strengths)


def outward(knots: Any) -> np.ndarray:
    """Side of each knot on which its piece begins: 1 above a knot that is not negative, -1 below one that is.

    A knot of -0.0 begins a piece below zero.
    """
    return np.where(np.signbit(np.real(np.asarray(knots))), -1.0, 1.0)


def numbers_of(values: np.ndarray) -> list[Any]:
    """The last axis of an array as a list: of numbers, or of columns where there is a batch."""
    return list(values) if values.ndim == 1 else list(np.moveaxis(values, -1, 0)[..., None])


@dataclass(frozen=True, kw_only=True)
class Corners(Form):
    """Broken line: sum of c_j max(s_j (x - k_j), 0) over corners that face away from zero (s_j = sign of k_j)."""

    label: ClassVar[str] = "table"
    strengths: ClassVar[tuple[str, ...]] = ("kinks",)

    knots: tuple[float, ...]
    kinks: tuple[float, ...] = quantity("", "change of slope at each knot, in units of what is added by the input's")

    @property
    def turns(self) -> tuple[Any, ...]:
        return tuple(knot for knot in self.knots if knot > 0.0)

    def values(self, x: np.ndarray) -> Array:
        sides = outward(self.knots)
        return np.maximum(sides * (np.asarray(x)[:, None] - np.array(self.knots)), 0.0) @ np.array(self.kinks)

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return broken_line(specimen, x, self.knots, self.kinks)


@dataclass(frozen=True, kw_only=True)
class Bends(Form):
    """Quadratic spline: sum of c_j max(s_j (x - k_j), 0)^2 / 2, whose slope is a broken line."""

    label: ClassVar[str] = "table"
    strengths: ClassVar[tuple[str, ...]] = ("kinks",)
    smooth: ClassVar[bool] = True

    knots: tuple[float, ...]
    kinks: tuple[float, ...] = quantity("", "change of slope at each knot, in units of what is added by the input's")

    def values(self, x: np.ndarray) -> Array:
        sides = outward(self.knots)
        return (
            0.5 * np.maximum(sides * (np.asarray(x)[:, None] - np.array(self.knots)), 0.0) ** 2 @ np.array(self.kinks)
        )

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return specimen.hinges(x, list(zip(outward(self.knots), self.knots, self.kinks, strict=True)), 2)

    def slope(self, specimen: EquationBuilder, x: Row) -> Row:
        signed = tuple(side * kink for side, kink in zip(outward(self.knots), self.kinks, strict=True))
        return broken_line(specimen, x, self.knots, signed)


def broken_line(specimen: EquationBuilder, x: Row, knots: tuple[float, ...], kinks: tuple[Any, ...]) -> Row:
    """Row of a broken line with corners that face away from zero."""
    return specimen.hinges(x, list(zip(outward(knots), knots, kinks, strict=True)))


@dataclass(frozen=True, kw_only=True)
class Line(Form):
    """A straight line where the model has no parameter for one: a leakage, a gain, a ramp over time.

    It goes through zero, or through `start`: a parameter that changes with the drive's frequency is that of the lowest.
    """

    label: ClassVar[str] = "linear"
    strengths: ClassVar[tuple[str, ...]] = ("factor",)
    smooth: ClassVar[bool] = True

    factor: float = quantity("", "slope, in units of what is added by the input's", null=0.0)
    start: float = 0.0  # input at which nothing is added: fixed

    @property
    def proportional(self) -> Any:
        return self.factor

    @property
    def turns(self) -> tuple[Any, ...]:
        return ()

    def values(self, x: np.ndarray) -> Array:
        return self.factor * (np.asarray(x) - self.start)

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return self.factor * (x - self.start * specimen.one)

    def slope(self, specimen: EquationBuilder, x: Row) -> Row:
        return self.factor * specimen.one


@dataclass(frozen=True, kw_only=True)
class Knee(Form):
    """Nothing up to a knee, and a straight line beyond it: on both sides (odd), or on one."""

    label: ClassVar[str] = "knee"
    strengths: ClassVar[tuple[str, ...]] = ("factor",)

    factor: float = quantity("", "slope beyond the knee, in units of what is added by the input's", null=0.0)
    knee: float = quantity("", "input at which it begins, in its unit")
    sides: int = 2  # 2: odd; 1: above the knee; -1: below it

    @property
    def turns(self) -> tuple[Any, ...]:
        return (self.knee,)

    @property
    def _corners(self) -> list[tuple[float, Any]]:
        """Side and knee of each corner."""
        return (
            [(1.0, self.knee), (-1.0, self.knee)] if self.sides == 2 else [(float(self.sides), self.sides * self.knee)]
        )

    def values(self, x: np.ndarray) -> Array:
        parts = (s * self.factor * np.where(s * x > np.real(k), s * x - k, 0.0) for s, k in self._corners)
        return sum(parts, np.zeros(len(x)))

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return specimen.hinges(x, [(s, s * knee, s * self.factor) for s, knee in self._corners])


@dataclass(frozen=True, kw_only=True)
class TwoKnees(Form):
    """Nothing between two knees, and a straight line beyond each of them: two end stops that are not alike."""

    label: ClassVar[str] = "two_knees"
    strengths: ClassVar[tuple[str, ...]] = ("factor", "second")

    factor: float = quantity("", "slope above the upper knee, in units of what is added by the input's", null=0.0)
    second: float = quantity("", "slope below the lower knee, likewise", null=0.0)
    upper: float = quantity("", "input at the upper knee, in its unit")
    lower: float = quantity("", "input at the lower knee, likewise")

    @property
    def turns(self) -> tuple[Any, ...]:
        return (self.upper,)

    def values(self, x: np.ndarray) -> Array:
        x = np.asarray(x)
        above = np.where(x > np.real(self.upper), x - self.upper, 0.0)
        return self.factor * above + self.second * np.where(x < np.real(self.lower), x - self.lower, 0.0)

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return specimen.hinges(x, [(1.0, self.upper, self.factor), (-1.0, self.lower, -self.second)])


@dataclass(frozen=True, kw_only=True)
class DeadZone(Form):
    """A straight line through zero that goes on level beyond a zone; with a slope of -1 it takes the zone out."""

    label: ClassVar[str] = "dead_zone"
    strengths: ClassVar[tuple[str, ...]] = ("factor",)

    factor: float = quantity("", "slope within the zone, in units of what is added by the input's", null=0.0)
    zone: float = quantity("", "half width of the zone, in the input's unit", above=0)

    @property
    def turns(self) -> tuple[Any, ...]:
        return (self.zone,)

    @property
    def proportional(self) -> Any:
        return self.factor

    def values(self, x: np.ndarray) -> Array:
        x = np.asarray(x)
        return self.factor * np.where(np.abs(x) < np.real(self.zone), x, np.sign(x) * self.zone)

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        beyond = [(1.0, self.zone, -self.factor), (-1.0, -self.zone, self.factor)]
        return self.factor * x + specimen.hinges(x, beyond)


@dataclass(frozen=True, kw_only=True)
class Power(Form):
    """a |x|^n with any n: odd (with the sign of x) or even; or on one side of zero only."""

    label: ClassVar[str] = "power"
    strengths: ClassVar[tuple[str, ...]] = ("factor",)
    smooth: ClassVar[bool] = True

    factor: float = quantity("", "what is added where the input is `scale`", null=0.0)
    exponent: float = quantity("", "n", above=0)
    scale: float  # input of reference, in its unit: fixed, so that factor and exponent are told apart
    odd: bool = True
    side: int = 0  # 1: above zero only; -1: below it; 0: both
    pieces: int = PIECES  # on each side, of a broken line in its place where the engine needs one
    reach: float = REACH  # to which that goes, of the input of reference

    def values(self, x: np.ndarray) -> Array:
        size = (self.side * np.asarray(x) if self.side else np.abs(x)) / self.scale
        powers = np.where(size > 0, np.where(size > 0, size, 1.0) ** self.exponent, 0.0)
        return self.factor * (np.sign(x) * powers if self.odd else powers)

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return self.factor * self._powers(specimen, x, self.exponent, odd=self.odd)

    def slope(self, specimen: EquationBuilder, x: Row) -> Row:
        factor = self.factor * self.exponent / self.scale
        return factor * self._powers(specimen, x, self.exponent - 1.0, odd=not self.odd)

    def _powers(self, specimen: EquationBuilder, x: Row, exponent: Any, *, odd: bool) -> Row:
        size = (1.0 / self.scale) * x
        halves = {side: specimen.power(side * size, exponent, positive=True) for side in self._sides}
        if any(np.any(np.isnan(half)) for half in halves.values()):  # the engine has whole powers of rows only
            return self._broken(specimen, size, exponent, odd=odd)
        return sum(((side if odd else 1.0) * half for side, half in halves.items()), 0.0 * x)

    @property
    def _sides(self) -> tuple[float, ...]:
        return (float(self.side),) if self.side else (1.0, -1.0)

    def _broken(self, specimen: EquationBuilder, size: Row, exponent: Any, *, odd: bool) -> Row:
        """The same as a broken line, with corners that are close together where the power is most curved."""
        knots = np.linspace(0.0, 1.0, self.pieces + 1) ** 2 * self.reach
        kinks = numbers_of(np.diff(np.diff(knots**exponent) / np.diff(knots), prepend=0.0))
        both = [side * knot for side in self._sides for knot in knots[:-1]]  # -0.0 begins a piece below zero
        return broken_line(
            specimen, size, tuple(both), tuple((side if odd else 1.0) * kink for side in self._sides for kink in kinks)
        )


@dataclass(frozen=True, kw_only=True)
class Hertz(Power):
    """a |x|^(3/2) or a |x|^(2/3) on one side of zero: two curved bodies pressed together, nothing once they part.

    Source: Johnson, Contact Mechanics, 1985, section 4.2.
    """

    label: ClassVar[str] = "hertz"

    exponent: float = 1.5  # not fitted: force of an approach; 2/3: approach of a force
    side: int = 1


LARGEST_EXPONENT = 12  # of a polynomial: far above what is fitted, and no power of it overflows


def _check_whole(exponent: int, key: str) -> None:
    """Raise `ParameterError` unless an exponent is one that a polynomial beside a straight line has."""
    if not 2 <= exponent <= LARGEST_EXPONENT:
        raise ParameterError(key, f"found {exponent}, must be a whole number from 2 to {LARGEST_EXPONENT}")


@dataclass(frozen=True, kw_only=True)
class Monomial(Form):
    """a x^n with a whole n from 2 on."""

    label: ClassVar[str] = "polynomial"
    strengths: ClassVar[tuple[str, ...]] = ("factor",)
    smooth: ClassVar[bool] = True

    factor: float = quantity("", "what is added where the input is `scale`", null=0.0)
    scale: float  # input of reference, in its unit: fixed, so that factor and exponent are told apart
    exponent: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_whole(self.exponent, "exponent")

    def values(self, x: np.ndarray) -> Array:
        return self.factor * (x / self.scale) ** self.exponent

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return self.factor * specimen.power((1.0 / self.scale) * x, self.exponent)

    def slope(self, specimen: EquationBuilder, x: Row) -> Row:
        factor = self.factor * self.exponent / self.scale
        if self.exponent == 2:
            return (factor / self.scale) * x
        return factor * specimen.power((1.0 / self.scale) * x, self.exponent - 1)


@dataclass(frozen=True, kw_only=True)
class Polynomial(Form):
    """a x^m + b x^n with two whole exponents from 2 on."""

    label: ClassVar[str] = "polynomial"
    strengths: ClassVar[tuple[str, ...]] = ("factor", "second")
    smooth: ClassVar[bool] = True

    factor: float = quantity("", "what the first power adds where the input is `scale`", null=0.0)
    second: float = quantity("", "what the second power adds there", null=0.0)
    scale: float  # input of reference, in its unit: fixed
    exponents: tuple[int, int] = (2, 3)

    def __post_init__(self) -> None:
        super().__post_init__()
        for n, exponent in enumerate(self.exponents):
            _check_whole(exponent, f"exponents.{n}")

    @property
    def _terms(self) -> tuple[Monomial, Monomial]:
        (m, n), size = self.exponents, self.scale
        terms = (Monomial(factor=0.0, scale=size, exponent=m), Monomial(factor=0.0, scale=size, exponent=n))
        return altered(terms[0], factor=self.factor), altered(terms[1], factor=self.second)

    def values(self, x: np.ndarray) -> Array:
        return sum((term.values(x) for term in self._terms), np.zeros(len(x)))

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return sum((term.row(specimen, x) for term in self._terms), 0.0 * x)

    def slope(self, specimen: EquationBuilder, x: Row) -> Row:
        return sum((term.slope(specimen, x) for term in self._terms), 0.0 * x)
