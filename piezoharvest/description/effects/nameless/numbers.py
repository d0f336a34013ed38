"""Numbers instead of rows: functions of them are evaluated at once, where equations add elements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from piezoharvest.description.effects.nameless.curves import CURVES


class Numbers:
    """Functions of arrays, with complex steps or without, by the names that they have in a builder of equations."""

    one: Any = 1.0

    def product(self, first: Any, second: Any) -> Any:
        """Product of two arrays."""
        return first * second

    def power(self, row: Any, exponent: Any, *, positive: bool = False) -> Any:
        """Power of an array, or of its positive part."""
        if not positive:
            return row**exponent
        return np.where(np.real(row) > 0, np.where(np.real(row) > 0, row, 1.0) ** exponent, 0.0)

    def hinges(self, row: Any, corners: Sequence[tuple[float, Any, Any]], order: int = 1) -> Any:
        """Sum of c max(s (x - k), 0)^order / order over corners (s, k, c)."""
        beyond = ((kink, side * (row - knot)) for side, knot, kink in corners)
        return sum(
            (kink / order * np.where(np.real(each) > 0.0, each, 0.0) ** order for kink, each in beyond), 0.0 * row
        )

    def curve(self, name: str, row: Any) -> Any:
        """A curve by its name."""
        return CURVES[name](row)
