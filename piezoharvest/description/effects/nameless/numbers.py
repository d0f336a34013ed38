"""Numbers instead of rows: functions of them are evaluated at once, where equations add elements."""

from __future__ import annotations

from typing import Any

import numpy as np


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

    def hinge(self, row: Any, knot: Any, width: float) -> Any:
        """Excess of an array over a knot, zero below it: exact, so that its width is not used."""
        return np.where(np.real(row) > np.real(knot), row - knot, 0.0)
