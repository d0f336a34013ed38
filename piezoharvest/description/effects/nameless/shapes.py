"""Smooth curves with a scale of the input, realised as broken lines so fine that the difference does not show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Row
from piezoharvest.description.effects.nameless.forms import Array, Form, broken_line, numbers_of, outward
from piezoharvest.description.parameters import check_choice, quantity
from piezoharvest.description.protocol import EquationBuilder

_SERIES = 1e-2  # argument below which the Langevin function is its series: both are exact to 1e-10 there


def langevin(z: np.ndarray) -> np.ndarray:
    """Coth z - 1/z: polarisation of free dipoles (Langevin, Ann. Chim. Phys. 5, 70-127, 1905)."""
    small: Array = np.abs(np.real(z)) < _SERIES
    safe = np.where(small, 1.0, z)
    return np.where(small, z / 3.0 - z**3 / 45.0, 1.0 / np.tanh(safe) - 1.0 / safe)


def _logarithm(z: np.ndarray) -> np.ndarray:
    """Sign(z) log(1 + |z|): creep (Ge & Jouaneh, Precis. Eng. 17(3), 211-221, 1995)."""
    side: Array = np.sign(np.real(z))
    return side * np.log(1.0 + side * z)


CURVES: dict[str, Callable[[Array], Array]] = {
    "exponential": lambda z: np.exp(z) - 1.0,
    "sinh": np.sinh,
    "tanh": np.tanh,
    "langevin": langevin,
    "log": _logarithm,
}
SATURATING = ("tanh", "langevin", "log")  # most bent near zero


@dataclass(frozen=True, kw_only=True)
class Curve(Form):
    """A smooth curve with corners `knots` of the broken line that stands for it in equations."""

    strengths: ClassVar[tuple[str, ...]] = ("factor",)

    knots: tuple[float, ...]

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return broken_line(specimen, x, self.knots, self._kinks())

    def _kinks(self) -> tuple[Any, ...]:
        """Changes of slope at the knots, outward from zero, of the line through the curve at the knots."""
        knots = np.array(self.knots)
        kinks: list[Any] = [0.0] * len(self.knots)
        for side in (1.0, -1.0):
            mine = np.flatnonzero(outward(knots) == side)
            mine = mine[np.argsort(np.abs(knots[mine]))]
            if len(mine) < 2:
                continue
            values = self.values(knots[mine])
            slopes = np.diff(values) / np.diff(np.abs(knots[mine]))
            changes: np.ndarray = np.diff(slopes, prepend=0.0)
            for k, kink in zip(mine.tolist(), numbers_of(changes), strict=False):
                kinks[k] = kink if _has_step(kink) else kink.real
        return tuple(kinks)


def _has_step(value: Any) -> bool:
    """True if a number, or one of a batch, has a complex step."""
    return bool(np.count_nonzero(value.imag))


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
        check_choice("curve", self.curve, tuple(CURVES))

    @property
    def word(self) -> str:
        """Word of the curve."""
        return self.curve

    def values(self, x: np.ndarray) -> Array:
        z = np.asarray(x) / self.scale
        return self.factor * (CURVES[self.curve](z) - (z if self.bent else 0.0))


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


@dataclass(frozen=True, kw_only=True)
class Coulomb(Curve):
    """Dry friction a x/sqrt(x^2 + w^2): a constant against the motion, rounded off within a width about zero.

    Source: Armstrong-Helouvry, Dupont & Canudas de Wit, Automatica 30(7), 1083-1138, 1994.
    """

    label: ClassVar[str] = "coulomb"

    factor: float = quantity("", "what is added well away from zero", null=0.0)
    width: float  # fixed: far below what the records move at

    def values(self, x: np.ndarray) -> Array:
        x = np.asarray(x)
        return self.factor * x / np.sqrt(x**2 + self.width**2)


@dataclass(frozen=True, kw_only=True)
class Stribeck(Coulomb):
    """Dry friction that is larger by a share near zero: a (1 + e exp(-(x/s)^2)) x/sqrt(x^2 + w^2)."""

    label: ClassVar[str] = "stribeck"

    excess: float = quantity("", "share by which it is larger near zero", above=-1)
    speed: float = quantity("", "input s at which the excess has fallen to 1/e, in its unit", above=0)

    def values(self, x: np.ndarray) -> Array:
        return super().values(x) * (1.0 + self.excess * np.exp(-((np.asarray(x) / self.speed) ** 2)))
