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
ROUNDING = 1e-9  # relative, of a distance
NEAR = 10  # inputs on each side of a knee between which a better place is looked for
BLOCKS = 8  # parts of the range of each of two knees: the best pair of inputs of each pair of parts is a start


def bent_best(distance: Distance, family: Family) -> Members:
    """The best member of a family with knees."""
    if len(family.knees) == 1:
        return _moved(distance, family, np.zeros(1), 0, len(family.knees[0])).best
    found = descended(distance, family, _pairs_of_inputs(distance, family))
    # Beside a straight line two knees that have passed each other are the same as before: in doubt they have not.
    found.cost[found.u[:, 0] < found.u[:, 1]] *= 1.0 + ROUNDING
    found = found.best
    for _ in range(ROUNDS):
        before = found.cost[0]
        for j in range(len(family.knees)):
            found = _better(found, _moved(distance, family, found.u[0], j, NEAR))
        # One after the other, knees that depend on each other move slowly.
        found = _better(found, descended(distance, family, found.u))
        if not before - found.cost[0] > CONVERGED * before:
            break
    return found


def _better(found: Members, other: Members) -> Members:
    return other.best if other.cost.min() < found.cost[0] else found


def _pairs_of_inputs(distance: Distance, family: Family) -> np.ndarray:
    """Of the inputs that two knees may be at the best pair in each part of their ranges: (a, 2)."""
    units = []
    for j, knots in enumerate(family.knees):
        columns = whitened(distance, family.unit(j, _with(np.zeros(2), j, knots)))
        size = np.linalg.norm(columns, axis=1)
        units.append(columns / np.where(size > 0.0, size, np.inf)[:, None])
    first, second = (unit @ distance.found for unit in units)
    # Gain by both columns p and q of length one: that of p, and that of what q has beside it.
    between = units[0] @ units[1].T
    apart = 1.0 - between**2
    beside = (second - between * first[:, None]) ** 2 / np.where(apart > DEPENDENT, apart, np.inf)
    gain = first[:, None] ** 2 + beside
    pairs = []
    for rows in np.array_split(np.arange(len(first)), BLOCKS):
        for some in np.array_split(np.arange(len(second)), BLOCKS):
            if len(rows) and len(some):
                n, m = np.unravel_index(np.argmax(gain[np.ix_(rows, some)]), (len(rows), len(some)))
                pairs.append((family.knees[0][rows[n]], family.knees[1][some[m]]))
    return np.array(pairs)


def _moved(distance: Distance, family: Family, u: np.ndarray, j: int, near: int) -> Members:
    """Members whose j-th knee is at an input near by, or where the distance has its minimum between two of them."""
    n = int(np.searchsorted(family.knees[j], u[j]))
    knots = family.knees[j][max(0, n - near) : n + near]
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
