"""Floats that know what they would be if one threshold were another one, and which of these would decide otherwise.

A threshold may then be varied for those campaigns alone in which some comparison with it would come out otherwise.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, Self

import numpy as np

Key = tuple[str, float]  # name of a threshold, and the factor on it


class Varied(float):
    """A number that depends on thresholds.

    Attributes
    ----------
    others : dict of Key to float
        Values of the number, each with one threshold changed.
    close : set of Key
        The changes with which a comparison, or a rounded value, so far would have been another one.
    """

    __array_ufunc__ = None  # arrays leave operations to this class
    others: dict[Key, float]
    close: set[Key]

    def __new__(cls, value: float, others: dict[Key, float], close: set[Key]) -> Self:
        """Make a number."""
        made = super().__new__(cls, value)
        made.others, made.close = others, close
        return made

    def _each(self, operation: Callable[[Any, Any], Any], other: Any) -> tuple[Any, dict[Key, Any]]:
        """Results of an operation with another number or array, as it is and with each change."""
        changed = other.others if isinstance(other, Varied) else {}
        base = float(other) if isinstance(other, Varied) else other
        values = {
            key: operation(self.others.get(key, float(self)), changed.get(key, base))
            for key in {**self.others, **changed}
        }
        return operation(float(self), base), values

    def _calculated(self, operation: Callable[[Any, Any], Any], other: Any) -> Varied:
        value, others = self._each(operation, other)
        return Varied(value, others, self.close)

    def _decided(self, operation: Callable[[Any, Any], Any], other: Any) -> Any:
        value, others = self._each(operation, other)
        self.close.update(key for key, each in others.items() if np.any(each != value))
        return value

    def __add__(self, other: Any) -> Varied:
        return self._calculated(operator.add, other)

    __radd__ = __add__

    def __mul__(self, other: Any) -> Varied:
        return self._calculated(operator.mul, other)

    __rmul__ = __mul__

    def __neg__(self) -> Varied:
        return self._calculated(operator.mul, -1.0)

    def __sub__(self, other: Any) -> Varied:
        return self._calculated(operator.sub, other)

    def __rsub__(self, other: Any) -> Varied:
        return self._calculated(lambda mine, theirs: theirs - mine, other)

    def __truediv__(self, other: Any) -> Varied:
        return self._calculated(operator.truediv, other)

    def __rtruediv__(self, other: Any) -> Varied:
        return self._calculated(lambda mine, theirs: theirs / mine, other)

    def __lt__(self, other: Any) -> Any:
        return self._decided(operator.lt, other)

    def __le__(self, other: Any) -> Any:
        return self._decided(operator.le, other)

    def __gt__(self, other: Any) -> Any:
        return self._decided(operator.gt, other)

    def __ge__(self, other: Any) -> Any:
        return self._decided(operator.ge, other)

    def __int__(self) -> int:
        return self._decided(lambda mine, _: math.trunc(mine), None)

    def __ceil__(self) -> int:
        return self._decided(lambda mine, _: math.ceil(mine), None)
