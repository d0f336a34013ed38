"""Numbers that depend on the coordinates of a box, enclosed to first order.

A form stands for a function f(u) of u in [-1, 1]^d with |f(u) - value - slope @ u| <= rest everywhere (Taylor model of
order one; Makino & Berz, Reliable Computing 5(1), 3-12, 1999). Products and sums keep that true; the rest falls with
the square of the box. Rounding errors are not followed: they are 1e-12 of the figures that are certified to 1e-3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

_POSITIVE = 1e-12  # relative, added so that a vector is above zero


@dataclass(frozen=True, eq=False)
class AffineForm:
    """Enclosure of a real or complex function, for a batch of boxes.

    Attributes
    ----------
    value : (..., b) array
        At the middle of each box.
    slope : (..., b, d) array
        By the coordinates, in half-widths of the box.
    rest : (..., b) array
        Bound on all else, at least 0.
    """

    value: np.ndarray
    slope: np.ndarray
    rest: np.ndarray

    @classmethod
    def coordinate(cls, centre: np.ndarray, radius: np.ndarray, axis: int) -> AffineForm:
        """Coordinate of boxes with centres and half-widths (b, d)."""
        slope = np.zeros_like(centre)
        slope[:, axis] = radius[:, axis]
        return cls(centre[:, axis], slope, np.zeros(len(centre)))

    @property
    def reach(self) -> np.ndarray:
        """Largest distance from the middle's value."""
        return np.abs(self.slope).sum(-1) + self.rest

    def __add__(self, other: AffineForm | complex) -> AffineForm:
        if not isinstance(other, AffineForm):
            return AffineForm(self.value + other, self.slope, self.rest)
        return AffineForm(self.value + other.value, self.slope + other.slope, self.rest + other.rest)

    __radd__ = __add__

    def __mul__(self, other: AffineForm | Any) -> AffineForm:
        if not isinstance(other, AffineForm):
            return AffineForm(other * self.value, np.asarray(other)[..., None] * self.slope, np.abs(other) * self.rest)
        a, b = self, other
        rest = np.abs(a.value) * b.rest + np.abs(b.value) * a.rest + a.reach * b.reach
        return AffineForm(a.value * b.value, a.value[..., None] * b.slope + b.value[..., None] * a.slope, rest)

    __rmul__ = __mul__

    def inverse(self) -> AffineForm:
        """1/f of a real function that is above zero; infinite rest where that is not sure."""
        least = self.value - self.reach
        with np.errstate(all="ignore"):
            # |1/f - 1/c + (f - c)/c^2| = (f - c)^2/(c^2 f)
            curved = self.reach**2 / (self.value**2 * least) + self.rest / self.value**2
            rest = np.where(least > 0, curved, np.inf)
        return AffineForm(1 / self.value, -self.slope / self.value[..., None] ** 2, rest)

    def real_product(self, other: AffineForm) -> AffineForm:
        """Re(f conj(g)), a real form."""
        product = self * AffineForm(np.conj(other.value), np.conj(other.slope), other.rest)
        return AffineForm(np.real(product.value), np.real(product.slope), product.rest)

    def largest(self) -> np.ndarray:
        """Upper bound of |f|."""
        with np.errstate(all="ignore"):
            turn = np.where(self.value == 0, 1.0, np.conj(self.value) / np.abs(self.value))[..., None]
        along, across = np.abs(np.real(turn * self.slope)).sum(-1), np.abs(np.imag(turn * self.slope)).sum(-1)
        return np.hypot(np.abs(self.value) + along, across) + self.rest

    def least(self) -> np.ndarray:
        """Lower bound of a real f."""
        return self.value - self.reach


def solve(matrix: list[list[AffineForm | None]], right: list[AffineForm | None]) -> AffineForm:
    """Enclosure (n, b) of y in G y = r, with forms in the square matrix and on the right-hand side; None is zero.

    Notes
    -----
    With P the inverse of the middle's matrix, y = y_c + P dr - P dG y. A bound s on |y - y_c| follows from
    s = |P dr| + |P dG| (|y_c| + s), where the spectral radius of |P dG| is below one (else the rest is infinite);
    with it only the product of two small numbers is left to the rest (after Krawczyk, Computing 4, 187-201, 1969).
    """
    n, some = len(right), next(f for row in matrix for f in row if f is not None)
    boxes, axes = some.slope.shape
    middle, slope = np.zeros((boxes, n, n), complex), np.zeros((boxes, axes, n, n), complex)
    rest = np.zeros((boxes, n, n))
    for i, row in enumerate(matrix):
        for j, form in enumerate(row):
            if form is not None:
                middle[:, i, j], slope[:, :, i, j], rest[:, i, j] = form.value, form.slope, form.rest
    r, dr, rr = np.zeros((boxes, n), complex), np.zeros((boxes, n, axes), complex), np.zeros((boxes, n))
    for i, form in enumerate(right):
        if form is not None:
            r[:, i], dr[:, i], rr[:, i] = form.value, form.slope, form.rest
    inverse = np.linalg.inv(middle)
    centre, moved = (inverse @ r[..., None])[..., 0], inverse[:, None] @ slope
    loose = np.abs(inverse) @ rest
    change = np.abs(moved).sum(1) + loose
    pushed = inverse @ dr
    unsure = (np.abs(inverse) @ rr[..., None])[..., 0]
    size = np.abs(centre)[..., None]
    first = np.abs(pushed).sum(-1) + unsure + (change @ size)[..., 0]
    # A vector s > 0 with s - |P dG| s > 0 shows that the radius of this matrix is below one.
    first = first + _POSITIVE * (size[..., 0] + np.max(size, axis=1))
    unbounded = np.any(~np.isfinite(change), axis=(1, 2))
    spread = np.linalg.solve(np.eye(n) - np.where(unbounded[:, None, None], 0.0, change), first[..., None])[..., 0]
    valid = np.all(spread > 0, axis=1) & ~unbounded
    left_over = (change @ spread[..., None] + loose @ size)[..., 0] + unsure
    left_over = np.where(valid[:, None], left_over, np.inf)
    slopes = pushed - np.moveaxis((moved @ centre[:, None, :, None])[..., 0], 1, 2)
    return AffineForm(centre.T, np.moveaxis(slopes, 1, 0), left_over.T)
