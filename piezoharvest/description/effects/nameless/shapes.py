"""Smooth curves with a scale of the input, realised as broken lines so fine that the difference does not show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Row
from piezoharvest.description.effects.nameless.forms import Array, Form, broken_line, outward
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import EquationBuilder

CURVES: dict[str, Callable[[Any], Any]] = {
    "exponential": lambda z: np.exp(z) - 1.0,
    "sinh": np.sinh,
    "tanh": np.tanh,
}


@dataclass(frozen=True, kw_only=True)
class Shape(Form):
    """a g(x/s) with g one of `CURVES`; where `bent` without its linear part, which is that of the model.

    `knots` are the corners of the broken line that stands for it in equations.
    """

    label: ClassVar[str] = "shape"
    strengths: ClassVar[tuple[str, ...]] = ("factor",)

    factor: float = quantity("", "factor of the curve", null=0.0)
    scale: float = quantity("", "input at which its argument is one, in its unit")
    curve: str
    bent: bool
    knots: tuple[float, ...]

    @property
    def word(self) -> str:
        """Word of the curve."""
        return self.curve

    def values(self, x: np.ndarray) -> Array:
        z = np.asarray(x) / self.scale
        return self.factor * (CURVES[self.curve](z) - (z if self.bent else 0.0))

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return broken_line(specimen, x, self.knots, self._kinks())

    def _kinks(self) -> tuple[Any, ...]:
        """Changes of slope at the knots, outward from zero, of the line through the curve at the knots."""
        knots = np.array(self.knots)
        kinks = np.zeros(len(knots), complex)
        for side in (1.0, -1.0):
            mine = np.flatnonzero(outward(knots) == side)
            mine = mine[np.argsort(np.abs(knots[mine]))]
            if len(mine) < 2:
                continue
            values = self.values(knots[mine])
            slopes = np.diff(values) / np.diff(np.abs(knots[mine]))
            kinks[mine[:-1]] = np.diff(slopes, prepend=0.0)
        return tuple(kinks if np.any(np.imag(kinks)) else np.real(kinks))
