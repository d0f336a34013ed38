"""Families of formulas: what they are linear in, and the rest with its starts."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from piezoharvest.description.effects.nameless.forms import Form
from piezoharvest.description.parameters import altered

Fields = Callable[[Any, Any], dict[str, Any]]  # of factors and of the other values


def _factor(c: Any, u: Any) -> dict[str, Any]:
    return {"factor": c[0]}


@dataclass(frozen=True)
class Family:
    """Formulas that differ in their values.

    Attributes
    ----------
    form : Form
        A member.
    fields : callable
        Fields by the m factors, of which the values of the form are a sum, and the d values that are varied. The latter
        are such that the form is within its bounds for any: logarithms of what must be above zero.
    starts : (s, d) array
        Where those begin, of a smooth family.
    least, most : float
        Least and largest allowed one of the values that are varied.
    factors : int
        Number m of factors.
    knees : tuple of d (b,) arrays
        Where the d values are knees, each in the part of the form that has the factor of the same number: the inputs
        that they may be at, in ascending order. Between two of these inputs the values of the form are linear in a
        knee. Empty of a smooth family.
    """

    form: Form
    fields: Fields = _factor
    starts: np.ndarray = field(default_factory=lambda: np.zeros((1, 0)))
    least: float = -np.inf
    most: float = np.inf
    factors: int = 1
    knees: tuple[np.ndarray, ...] = ()

    @property
    def free(self) -> int:
        """Number of values that are free in the fit of a member."""
        return len(self.fields(np.zeros(self.factors), np.zeros(len(self.knees) or self.starts.shape[1])))

    def member(self, factors: np.ndarray, u: np.ndarray) -> Form:
        """The formula with values; raises `ParameterError` outside bounds."""
        values = self.fields(list(map(float, factors)), list(map(float, u)))
        return dataclasses.replace(self.form, **{name: float(value) for name, value in values.items()})

    def unit(self, k: int, u: np.ndarray) -> Form:
        """A batch of members whose k-th factor is one and whose others are zero, at values (a, d)."""
        one = [float(k == j) for j in range(self.factors)]
        return altered(self.form, **self.fields(one, list(u.T[:, :, None])))


def column(starts: Any) -> np.ndarray:
    """Starts of one value, as a family has them."""
    return np.asarray(starts, float)[:, None]
