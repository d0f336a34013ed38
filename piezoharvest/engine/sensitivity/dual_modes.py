"""Linear modes of a program in NumPy, for one design or a batch, with derivatives if the program has them.

A program that was lowered from quantities x + i e has complex numbers: the real parts are the nominal values, the
imaginary parts over e the derivatives, one design of the batch for each quantity.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.parameters import COMPLEX_STEP
from piezoharvest.engine.memory import program as pg

# Difference of two eigenvalues times the longest time, below which a divided difference is computed by its series
# (exact to rounding there); above it, the difference of two exponentials loses two digits at most.
SERIES_LIMIT = 0.02


class Dual(NamedTuple):
    """A number or an array and its derivatives with respect to p quantities, on the first axis."""

    value: Any
    change: np.ndarray


def dual(batch: np.ndarray, rank: int) -> Dual:
    """Nominal value and derivatives from a batch of complex steps, of arrays with `rank` axes."""
    batch = np.asarray(batch)
    if batch.ndim == rank:
        return Dual(np.real(batch), np.zeros((1, *batch.shape)))
    return Dual(np.real(batch[0]), np.imag(batch) / COMPLEX_STEP)


def nominal(batch: pg.Program) -> pg.Program:
    """Nominal design of a batch of complex steps."""
    first = pg.part(batch, 0)
    return first._replace(**{name: np.real(np.asarray(getattr(first, name))).copy() for name in pg.NUMBERS})


class DualMode:
    """One linear mode: a configuration of the shunt and the set of stops that slip.

    Parameters
    ----------
    program : Program
        A batch lowered by complex steps.
    configuration : int
    slip : (h,) int array
        0 for a stop that sticks.
    """

    def __init__(self, program: pg.Program, configuration: int, slip: np.ndarray):
        self.program, self.configuration = program, configuration
        n, a = program.rate.shape[-2:]
        rate, response = program.rate[..., configuration, :, :], program.stop_response[..., configuration, :, :]
        stick = np.flatnonzero(np.asarray(slip) == 0)
        if len(stick):
            # A stop that sticks moves with its input: z' = rate z + response s', s' = input z'.
            into, out = program.stop_input[..., stick, :], response[..., stick]
            rate = rate + out @ np.linalg.solve(np.eye(len(stick)) - into @ out, into @ rate)
        batch = np.broadcast_shapes(rate.shape[:-2], program.exosystem.shape[:-2])
        self.batched = np.zeros((*batch, a, a), np.result_type(rate, program.exosystem))
        self.batched[..., :n, :] = rate
        self.batched[..., n:, n:] = program.exosystem
        self.matrix = dual(self.batched, 2)

    def form(self, over_state: np.ndarray, over_rate: np.ndarray) -> Dual:
        """Linear forms over the state and over its rate, (..., f, a) and (..., f, n), as forms of the state alone."""
        n = self.program.rate.shape[-2]
        return dual(over_state + over_rate @ self.batched[..., :n, :], 2)

    def guard(self, number: int) -> Dual:
        """Row of a guard of the circuit."""
        p, c = self.program, self.configuration
        rows = self.form(p.guard_z[..., c, number : number + 1, :], p.guard_d[..., c, number : number + 1, :])
        return Dual(rows.value[0], rows.change[:, 0])

    def stop_rate(self, number: int) -> Dual:
        """Row of the rate of a stop's input."""
        into = self.program.stop_input[..., number : number + 1, :]
        rows = self.form(np.zeros((1, self.program.rate.shape[-1])), into)
        return Dual(rows.value[0], rows.change[:, 0])

    @cached_property
    def outputs(self) -> Dual:
        """Rows of the outputs."""
        c = self.configuration
        return self.form(self.program.output_z[..., c, :, :], self.program.output_d[..., c, :, :])

    @cached_property
    def harvest(self) -> tuple[Dual, Dual, Dual]:
        """Harvested power: coefficients and the two factors of its products."""
        p, c = self.program, self.configuration
        which = np.flatnonzero(p.product_category[c] == pg.HARVESTED)
        first, second = (self.form(p.product_z[..., c, which, k, :], p.product_d[..., c, which, k, :]) for k in (0, 1))
        return dual(p.product_coefficient[..., c, which], 1), first, second


class Flow:
    """exp(A t) of a mode and its derivatives, at any times, from the eigenvectors of A.

    The derivative of a matrix exponential along B has in these coordinates the elements of B times divided differences
    of the exponential (Daleckii & Krein; Higham, Functions of Matrices, 2008, theorem 3.9).
    """

    def __init__(self, matrix: Dual):
        self.matrix = matrix
        self.rates, self.vectors = _eigenvectors(matrix.value)
        self.inverse = np.linalg.inv(self.vectors)
        self.change = self.inverse @ matrix.change @ self.vectors

    def states(self, start: np.ndarray, times: np.ndarray) -> np.ndarray:
        """States (m, ..., a) at m times from initial states (..., a)."""
        growth = np.exp(np.multiply.outer(times, self.rates))
        modal = start @ self.inverse.T
        shape = (len(times),) + (1,) * (start.ndim - 1) + (-1,)
        return np.real((growth.reshape(shape) * modal) @ self.vectors.T)

    def forced(self, start: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Derivatives (m, p, a) of the motion from a given state (a,) at m times with respect to the quantities.

        For eigenvalues further apart than the limit, the divided difference is that of two exponentials, whose products
        with the factors that do not depend on time are computed once for all times.
        """
        a, driven = len(self.rates), self.change * (self.inverse @ start)  # (p, i, j)
        gap = self.rates[:, None] - self.rates[None, :]
        close = np.abs(gap) * np.max(times, initial=0.0) < SERIES_LIMIT
        growth = np.exp(np.multiply.outer(times, self.rates))
        apart = np.where(close, 0.0, driven) / np.where(close, 1.0, gap)
        modal = growth[:, None, :] * apart.sum(axis=2)
        modal -= (growth @ apart.reshape(-1, a).T).reshape(modal.shape)
        rows, columns = np.nonzero(close)
        mean = 0.5 * (self.rates[rows] + self.rates[columns])
        half = 0.5 * np.multiply.outer(times, gap[rows, columns])
        divided = times[:, None] * np.exp(np.multiply.outer(times, mean)) * (1 + half**2 / 6 + half**4 / 120)
        for row in range(a):
            own = rows == row
            modal[:, :, row] += divided[:, own] @ driven[:, row, columns[own]].T
        return np.real(modal @ self.vectors.T)


def _eigenvectors(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and eigenvectors, with conserved forms (stops that stick, open electrodes) separated.

    A multiple eigenvalue zero would be found with nearly parallel eigenvectors. A conserved form c'z has c' matrix = 0;
    in a basis of such forms and their orthogonal complement, the rest has no zero eigenvalue.
    """
    left, size, _ = np.linalg.svd(matrix)
    lost = size <= len(size) * np.finfo(float).eps * size[0]
    conserved, rest = left[:, lost], left[:, ~lost]
    rates, vectors = np.linalg.eig(rest.T @ matrix @ rest)
    follows = np.linalg.solve(rest.T @ matrix @ rest, rest.T @ matrix @ conserved)
    return np.concatenate([np.zeros(np.sum(lost)), rates]), np.hstack([conserved - rest @ follows, rest @ vectors])
