"""The broken line of a family that is closest to a table.

The distance is smooth only while a knee is between two inputs. So the best inputs for knees are found first, among all
of them; then the knees are moved off these, where in each interval the values are linear in a factor and in its product
with the knee. Source: Hudson, J. Am. Stat. Assoc. 61, 1097-1129, 1966 (joined segments, interval by interval).
"""

from __future__ import annotations

import numpy as np

from piezoharvest.diagnose.discovery.forms.distance import Distance
from piezoharvest.diagnose.discovery.forms.family import Family
from piezoharvest.diagnose.discovery.forms.projection import (
    CONVERGED,
    DEPENDENT,
    Members,
    descended,
    pseudoinverse,
    unit_columns,
    whitened,
)

ROUNDS = 50  # of moves: far more than any needs
ROUNDING = 1e-9  # of a gain
NEAR = 10  # inputs on each side of a knee between which a better place is looked for


def bent_best(distance: Distance, family: Family) -> Members:
    """The best member of a family with knees."""
    found = Members.at(distance, family, _best_inputs(distance, family))
    for _ in range(ROUNDS):
        before = found.cost[0]
        for j in range(len(family.knees)):
            found = _better(found, _moved(distance, family, found.u[0], j))
        if len(family.knees) > 1:  # one after the other, knees that depend on each other move slowly
            found = _better(found, descended(distance, family, found.u))
        if not before - found.cost[0] > CONVERGED * before:
            break
    return found


def _better(found: Members, other: Members) -> Members:
    return other.best if other.cost.min() < found.cost[0] else found


def _best_inputs(distance: Distance, family: Family) -> np.ndarray:
    """Of the inputs that one or two knees may be at those with the least distance: (1, d)."""
    parts = []
    for j, knots in enumerate(family.knees):
        columns = whitened(distance, family.unit(j, _with(np.zeros(len(family.knees)), j, knots)))
        size = np.linalg.norm(columns, axis=1)
        parts.append(columns / np.where(size > 0.0, size, np.inf)[:, None])
    along = [part @ distance.found for part in parts]
    if len(parts) == 1:
        return family.knees[0][[np.argmax(along[0] ** 2)]][:, None]
    # Gain by both columns p and q of length one: that of p, and that of what q has beside it.
    between = parts[0] @ parts[1].T
    apart = 1.0 - between**2
    beside = (along[1] - between * along[0][:, None]) ** 2 / np.where(apart > DEPENDENT, apart, np.inf)
    gain = along[0][:, None] ** 2 + beside
    # Beside a straight line two knees that have passed each other are the same as before: in doubt they have not.
    gain[family.knees[0][:, None] >= family.knees[1]] *= 1.0 + ROUNDING
    best = np.unravel_index(np.argmax(gain), gain.shape)
    return np.array([[knots[n] for knots, n in zip(family.knees, best, strict=True)]])


def _moved(distance: Distance, family: Family, u: np.ndarray, j: int) -> Members:
    """Members whose j-th knee is at an input near by, or where the distance has its minimum between two of them."""
    n = int(np.searchsorted(family.knees[j], u[j]))
    knots = family.knees[j][max(0, n - NEAR) : n + NEAR]
    middle, half = 0.5 * (knots[1:] + knots[:-1]), 0.5 * np.diff(knots)
    columns, slopes = unit_columns(distance, family, _with(u, j, middle))
    # With a factor c and a knee in the middle + d half the part is c column + (c d) half slope.
    columns = np.concatenate([columns, slopes[:, :, [j], j] * half[:, None, None]], axis=2)
    factors = pseudoinverse(columns) @ distance.found
    with np.errstate(all="ignore"):
        shift = factors[:, -1] / factors[:, j]
    within = np.abs(shift) < 1.0  # also False where it is no number
    return Members.at(distance, family, _with(u, j, np.concatenate([knots, (middle + shift * half)[within]])))


def _with(u: np.ndarray, j: int, values: np.ndarray) -> np.ndarray:
    """Values (d,) with each of others (a,) as the j-th: (a, d)."""
    every = np.tile(u, (len(values), 1))
    every[:, j] = values
    return every
