"""Members of a family of formulas that are closest to a table, by variable projection.

What a formula is linear in is solved for, and only the rest of its values is varied, from all starts at once.
Sources: Golub & Pereyra, SIAM J. Numer. Anal. 10(2), 413-432, 1973 (variable projection); Kaufman, BIT 15(1), 49-57,
1975 (its derivative); Levenberg, Q. Appl. Math. 2, 164-168, 1944; Marquardt, J. SIAM 11(2), 431-441, 1963.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezoharvest.description.effects.nameless.forms import Form
from piezoharvest.description.parameters import COMPLEX_STEP
from piezoharvest.diagnose.discovery.forms.distance import Distance
from piezoharvest.diagnose.discovery.forms.family import Family

ITERATIONS = 200  # of a formula: far more than any needs that is not on its way to infinity
CONVERGED = 1e-10  # relative decrease of the distance: closer, no ranking changes
DAMPING = 0.1  # at the start: a full step from far away may go past the nearest place
AS_EXPECTED = 0.25  # of the expected decrease: after a step that had less it would go to and fro
LESS, MORE = 0.2, 4.0  # times as much damping after a step with as much as expected, and after one with less
DAMPED = 1e12  # damping beyond which a step is rounding
ALIKE = 1e-6  # of the squared distance: starts as close to each other are on their way to the same place
ROUNDING = 1e-12  # of what values of their size could add: below, they are a straight line but for rounding
DEPENDENT = 1e-10  # ratio of singular values below which what two factors add is the same


@dataclass(frozen=True)
class Members:
    """Members of a family: a of them, with d values that it is not linear in and m factors.

    Attributes
    ----------
    u : (a, d) array
    factors : (a, m) array
        The best for these values.
    residual : (a, k) array
        Difference of the found kinks from those that stand for the formula, whitened.
    slope : (a, k, d) array
        Decrease of the residual by u, with the factors always at their best.
    cost : (a,) array
        Square of the residual; infinite where a formula overflows, is beyond a limit, is not told from a straight line,
        or leaves nothing of the parameter that it is beside.
    """

    u: np.ndarray
    factors: np.ndarray
    residual: np.ndarray
    slope: np.ndarray
    cost: np.ndarray

    @classmethod
    def at(cls, distance: Distance, family: Family, u: np.ndarray) -> Members:
        """Those at values (a, d)."""
        columns, slopes = unit_columns(distance, family, u)
        inverse = pseudoinverse(columns)
        factors = inverse @ distance.found
        residual = distance.found - np.einsum("akm,am->ak", columns, factors)
        slope = np.einsum("akmd,am->akd", slopes, factors)
        slope = slope - columns @ (inverse @ slope)  # what the factors cannot make up for
        fine = np.any(columns, axis=(1, 2)) & np.all((u >= family.least) & (u <= family.most), axis=1)
        if np.isfinite(distance.most_line) and np.any(fine):
            fine[fine] = _lines(distance, family, u[fine], factors[fine]) < distance.most_line
        return cls(u.copy(), factors, residual, slope, np.where(fine, np.sum(residual**2, axis=1), np.inf))

    @property
    def best(self) -> Members:
        """The closest of them alone."""
        n = [np.argmin(self.cost)]
        return Members(*(getattr(self, field.name)[n] for field in dataclasses.fields(self)))

    def take(self, places: np.ndarray, other: Members, some: np.ndarray) -> None:
        """Replace the members at places by some of others."""
        for field in dataclasses.fields(self):
            getattr(self, field.name)[places] = getattr(other, field.name)[some]


def descended(distance: Distance, family: Family, starts: np.ndarray) -> Members:
    """Members at the minima of the distance that are reached from starts (a, d)."""
    found = Members.at(distance, family, starts)
    count, d = found.u.shape
    damping, size = np.full(count, DAMPING), np.zeros((count, d))
    done = ~np.isfinite(found.cost) | (d == 0)
    for _ in range(ITERATIONS):
        done |= _followers(found)
        some = np.flatnonzero(~done)
        if not len(some):
            break
        slope = found.slope[some]
        inside = np.einsum("aki,akj->aij", slope, slope)
        right = np.einsum("aki,ak->ai", slope, found.residual[some])
        size[some] = np.maximum(size[some], np.einsum("aii->ai", inside))  # else it would leap where it is flat
        added = damping[some, None] * np.where(size[some] > 0.0, size[some], 1.0)
        step = np.linalg.solve(inside + added[:, :, None] * np.eye(d), right[..., None])[..., 0]
        expected = np.einsum("ai,ai->a", step, right)  # at least half of the decrease that the linear model has
        trial = Members.at(distance, family, found.u[some] + step)
        decrease = found.cost[some] - trial.cost
        good = decrease > 0.0
        damping[some] *= np.where(decrease > AS_EXPECTED * expected, LESS, MORE)
        small = np.maximum(np.where(good, decrease, 0.0), expected) <= CONVERGED * found.cost[some]
        done[some] |= small | (damping[some] > DAMPED)
        found.take(some[good], trial, good)
    return found


def _followers(found: Members) -> np.ndarray:
    """True of members that are all but the same as a better one."""
    order = np.argsort(found.cost, kind="stable")
    residual, cost = found.residual[order], found.cost[order]
    apart = np.sum((residual[:, None] - residual[None]) ** 2, axis=2)
    followers = np.zeros(len(order), bool)
    followers[order] = np.tril(apart <= ALIKE * cost[None], -1).any(axis=1)
    return followers


def _lines(distance: Distance, family: Family, u: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Slopes (a,) of the straight lines in members: where a table tells little, two may all but cancel."""
    values = np.zeros((len(u), len(distance.x)))
    with np.errstate(all="ignore"):
        for n in range(family.factors):
            # As in `unit_columns` with a complex step, with which values on their way to infinity are no errors.
            unit: Any = np.atleast_2d(family.unit(n, u + 1j * COMPLEX_STEP).values(distance.x))
            values += factors[:, [n]] * unit.real
    return distance.lines(values)


def unit_columns(distance: Distance, family: Family, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What factors of one add to the whitened kinks, (a, k, m), and its derivatives by the values, (a, k, m, d).

    Zero of members that overflow.
    """
    (count, d), m, k = u.shape, family.factors, len(distance.found)
    columns, slopes = np.empty((count, k, m)), np.zeros((count, k, m, d))
    with np.errstate(all="ignore"):
        for n in range(m):
            for j in range(d):
                moved: Any = whitened(distance, family.unit(n, u + 1j * COMPLEX_STEP * (np.arange(d) == j)))
                columns[:, :, n], slopes[:, :, n, j] = moved.real, moved.imag / COMPLEX_STEP
            if not d:
                columns[:, :, n] = whitened(distance, family.unit(n, u))
        fine = np.isfinite(np.sum(columns**2, axis=(1, 2)) + np.sum(slopes**2, axis=(1, 2, 3)))
    columns[~fine], slopes[~fine] = 0.0, 0.0
    return columns, slopes


def whitened(distance: Distance, form: Form) -> np.ndarray:
    """Whitened kinks (a, k) that stand for a batch of forms; zero where a form is a straight line but for rounding."""
    values: Any = np.atleast_2d(form.values(distance.x))
    found = values @ distance.whitened.T
    size = np.linalg.norm(distance.whitened) * np.linalg.norm(values.real, axis=1)
    found[np.linalg.norm(found.real, axis=1) <= ROUNDING * size] = 0.0
    return found


def pseudoinverse(columns: np.ndarray) -> np.ndarray:
    """Pseudoinverses of matrices (a, k, m) whose columns may differ in size by any ratio."""
    size = np.linalg.norm(columns, axis=1)
    size = np.where(size > 0.0, size, 1.0)
    return np.linalg.pinv(columns / size[:, None], rcond=DEPENDENT) / size[:, :, None]
