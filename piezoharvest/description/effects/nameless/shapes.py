"""Smooth curves with a scale of the input."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Row
from piezoharvest.description.effects.nameless.curves import CODES, CURVES, SLOPES_AT_REST
from piezoharvest.description.effects.nameless.forms import Array, Form
from piezoharvest.description.parameters import check_choice, quantity
from piezoharvest.description.protocol import EquationBuilder

SCALED = ("exponential", "sinh", "tanh", "langevin", "log")  # curves that a law may be by themselves


@dataclass(frozen=True, kw_only=True)
class Curve(Form):
    """A smooth curve."""

    strengths: ClassVar[tuple[str, ...]] = ("factor",)

    knots: tuple[float, ...] = (0.0,)  # without meaning: files of laws from before 2026-12 have them


@dataclass(frozen=True, kw_only=True)
class Shape(Curve):
    """a g(x/s) with g one of `CURVES`; where `bent` without its linear part, which is that of the model."""

    label: ClassVar[str] = "shape"

    factor: float = quantity("", "factor of the curve", null=0.0)
    scale: float = quantity("", "input at which its argument is one, in its unit")
    curve: str
    bent: bool

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("curve", self.curve, SCALED)

    @property
    def word(self) -> str:
        """Word of the curve."""
        return self.curve

    def values(self, x: np.ndarray) -> Array:
        z = np.asarray(x) / self.scale
        return self.factor * (CURVES[self.curve](z) - self.left_out * z)

    @property
    def proportional(self) -> Any:
        return -self.factor * self.left_out / self.scale

    @property
    def left_out(self) -> float:
        """Slope of the linear part of g that is left out: zero where none is."""
        return SLOPES_AT_REST[CODES[self.curve]] if self.bent else 0.0

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        z = (1.0 / self.scale) * x
        found = self.factor * specimen.curve(self.curve, z)
        return found - (self.factor * self.left_out) * z if self.bent else found


@dataclass(frozen=True, kw_only=True)
class StepChange(Curve):
    """A change that comes at once, rounded off, as where a part cracks: a (tanh((x - t)/w) + tanh(t/w))/2."""

    label: ClassVar[str] = "step"

    factor: float = quantity("", "what is added once it has come", null=0.0)
    at: float = quantity("", "input t at which half of it has come, in its unit")
    width: float = quantity("", "input w over which it comes, in its unit", above=0)
    finest: float = 0.0  # least width that records tell, a sample: fixed

    def values(self, x: np.ndarray) -> Array:
        return 0.5 * self.factor * (np.tanh((np.asarray(x) - self.at) / self.width) + self.before)

    @property
    def before(self) -> Any:
        """What makes it zero at an input of zero, tanh(t/w)."""
        return np.tanh(self.at / self.width)

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        come = specimen.curve("tanh", (1.0 / self.width) * (x - self.at * specimen.one))
        return (0.5 * self.factor) * (come + self.before * specimen.one)


@dataclass(frozen=True, kw_only=True)
class Bump(Curve):
    """What comes and goes, as by a part that is warm for a while: a (exp(-((x - t)/w)^2) - exp(-(t/w)^2))."""

    label: ClassVar[str] = "bump"

    factor: float = quantity("", "what is added at the height of it", null=0.0)
    at: float = quantity("", "input t at which it is highest, in its unit")
    width: float = quantity("", "input w within which it has fallen to 1/e, in its unit", above=0)

    def values(self, x: np.ndarray) -> Array:
        return self.factor * (CURVES["gauss"]((np.asarray(x) - self.at) / self.width) - self.before)

    @property
    def before(self) -> Any:
        """What makes it zero at an input of zero."""
        return CURVES["gauss"](self.at / self.width)

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        near = specimen.curve("gauss", (1.0 / self.width) * (x - self.at * specimen.one))
        return self.factor * (near - self.before * specimen.one)


@dataclass(frozen=True, kw_only=True)
class Shockley(Curve):
    """Voltage of a diode over its forward current: a log(1 + i/s) + R i, with a = n V_T, s = I_s and a resistance R.

    Source: Sze & Ng, Physics of Semiconductor Devices, 2007, section 2.3.
    """

    label: ClassVar[str] = "shockley"

    factor: float = quantity("", "voltage a by which the current grows by a factor of e", null=0.0)
    scale: float = quantity("", "saturation current s", above=0)
    resistance: float = quantity("ohm", "series resistance R", at_least=0)

    def values(self, x: np.ndarray) -> Array:
        x = np.asarray(x)
        return self.factor * np.log(1.0 + x / self.scale) + self.resistance * x

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return self.factor * specimen.curve("log", (1.0 / self.scale) * x) + self.resistance * x


@dataclass(frozen=True, kw_only=True)
class Coulomb(Curve):
    """Dry friction a x/sqrt(x^2 + w^2): a constant against the motion, rounded off within a width about zero.

    Source: Armstrong-Helouvry, Dupont & Canudas de Wit, Automatica 30(7), 1083-1138, 1994.
    """

    label: ClassVar[str] = "coulomb"

    factor: float = quantity("", "what is added well away from zero", null=0.0)
    width: float  # fixed: far below what the records move at

    def values(self, x: np.ndarray) -> Array:
        return self.factor * CURVES["coulomb"](np.asarray(x) / self.width)

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return self.factor * specimen.curve("coulomb", (1.0 / self.width) * x)


@dataclass(frozen=True, kw_only=True)
class Stribeck(Coulomb):
    """Dry friction that is larger by a share near zero: a (1 + e exp(-(x/s)^2)) x/sqrt(x^2 + w^2)."""

    label: ClassVar[str] = "stribeck"

    excess: float = quantity("", "share by which it is larger near zero", above=-1)
    speed: float = quantity("", "input s at which the excess has fallen to 1/e, in its unit", above=0)

    def values(self, x: np.ndarray) -> Array:
        return super().values(x) * (1.0 + self.excess * CURVES["gauss"](np.asarray(x) / self.speed))

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        sign, near = specimen.curve("coulomb", (1.0 / self.width) * x), specimen.curve("gauss", (1.0 / self.speed) * x)
        return self.factor * (sign + self.excess * specimen.product(near, sign))
