"""Functions of one input that are a polynomial in each piece of a line: broken lines, and quadratic splines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np


class Pieces(NamedTuple):
    """A function a + b x + c x^2 between corners, each piece with its own a, b and c; it is continuous.

    Attributes
    ----------
    corners : (k,) array
        Where one piece ends and the next begins, in ascending order.
    coefficients : (..., k + 1, 3) array
        a, b and c of each piece; complex where they have complex steps, with leading axes in a batch of designs.
    """

    corners: np.ndarray
    coefficients: np.ndarray

    def value(self, x: Any, design: int = 0) -> Any:
        """The function at an input, which may have a complex step."""
        own = self.coefficients.reshape(-1, *self.coefficients.shape[-2:])
        a, b, c = own[min(design, len(own) - 1), int(np.searchsorted(self.corners, np.real(x), "right"))]
        return a + x * (b + x * c)

    @property
    def slope_at_rest(self) -> Any:
        """Slope at zero, the mean of both sides: a factor of rows, with a trailing axis where there is a batch."""
        sides = (np.searchsorted(self.corners, 0.0, side) for side in ("left", "right"))
        left, right = (self.coefficients[..., k, 1] for k in sides)
        found = 0.5 * (left + right)
        return found[..., None] if found.ndim else found

    @property
    def parity(self) -> int:
        """-1 of an odd function, 1 of an even one, 0 of others."""
        mirrored = np.real(self.coefficients)[..., ::-1, :] * [1.0, -1.0, 1.0]
        if not np.allclose(self.corners, -self.corners[::-1], rtol=1e-12, atol=0.0):
            return 0
        return next((sign for sign in (-1, 1) if np.allclose(mirrored, sign * np.real(self.coefficients))), 0)


def broken_line(corners: Sequence[tuple[float, Any, Any]], order: int = 1) -> Pieces:
    """Sum of c max(s (x - k), 0)^order / order over corners (s, k, c), with s = 1 or -1 and an order of 1 or 2."""
    at = sorted(float(np.real(np.ravel(knot)[0])) for _, knot, _ in corners)
    batch = np.broadcast_shapes(*(np.shape(each)[:1] for corner in corners for each in corner[1:]))
    numbers = [_aligned(each, batch) for corner in corners for each in corner[1:]]
    found = np.zeros((*batch, len(at) + 1, 3), np.result_type(float, *numbers))
    for (side, _, _), knot, kink in zip(corners, numbers[::2], numbers[1::2], strict=True):
        first = int(np.searchsorted(at, float(np.real(np.ravel(knot)[0])), "right"))
        own = slice(first, None) if side > 0 else slice(None, first)
        terms = (-side * knot, side, 0.0) if order == 1 else (0.5 * knot**2, -knot, 0.5)
        for k, term in enumerate(terms):
            found[..., own, k] += np.asarray(kink * term)[..., None]
    return Pieces(np.array(at), found)


def _aligned(number: Any, batch: tuple[int, ...]) -> np.ndarray:
    """A number, or one for each design of a batch without the axis that it has as a factor of rows."""
    found = np.asarray(number)
    return found.reshape(found.shape[:1]) if batch and found.ndim else found
