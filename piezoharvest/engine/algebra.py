"""Small dense linear algebra for compiled loops, where a library call would cost more than the work."""

from __future__ import annotations

import numpy as np
from numba import njit

_FAST = {"reassoc", "contract"}  # sums may be reordered, so that they run in vector registers


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def dot(row, z):
    """Linear form of a vector."""
    total = 0.0
    for j in range(len(z)):
        total += row[j] * z[j]
    return total


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def product(left, right, out):
    """out = left right, for matrices."""
    for i in range(left.shape[0]):
        for j in range(right.shape[1]):
            out[i, j] = 0.0
        for k in range(left.shape[1]):
            factor = left[i, k]
            if factor != 0.0:
                for j in range(right.shape[1]):
                    out[i, j] += factor * right[k, j]


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def row_product(row, matrix, count, out):
    """out = row matrix, over the first `count` rows of the matrix."""
    for j in range(matrix.shape[1]):
        out[j] = 0.0
    for k in range(count):
        factor = row[k]
        if factor != 0.0:
            for j in range(matrix.shape[1]):
                out[j] += factor * matrix[k, j]


@njit(cache=True, error_model="numpy")
def eliminate(matrix, right, order):
    """Gaussian elimination with complete pivoting, in place; returns the rank.

    `order` receives the columns in the order in which they were taken. A pivot below 1e-10 of the largest counts as
    zero: a motion whose memory of a period is shorter than that of 1e10 periods is not mistaken for a conserved one.
    """
    n = matrix.shape[0]
    for j in range(n):
        order[j] = j
    largest = 0.0
    for step in range(n):
        best, row, column = 0.0, step, step
        for i in range(step, n):
            for j in range(step, n):
                if abs(matrix[i, j]) > best:
                    best, row, column = abs(matrix[i, j]), i, j
        largest = max(largest, best)
        if best <= 1e-10 * largest:
            return step
        for j in range(n):
            matrix[step, j], matrix[row, j] = matrix[row, j], matrix[step, j]
        for j in range(right.shape[1]):
            right[step, j], right[row, j] = right[row, j], right[step, j]
        for i in range(n):
            matrix[i, step], matrix[i, column] = matrix[i, column], matrix[i, step]
        order[step], order[column] = order[column], order[step]
        for i in range(step + 1, n):
            factor = matrix[i, step] / matrix[step, step]
            if factor != 0.0:
                for j in range(step, n):
                    matrix[i, j] -= factor * matrix[step, j]
                for j in range(right.shape[1]):
                    right[i, j] -= factor * right[step, j]
    return n


@njit(cache=True, error_model="numpy")
def back_substitute(matrix, right, order, rank, out):
    """Solve the triangle that `eliminate` left, for every column of `right`; free unknowns beyond the rank stay as set."""
    for c in range(right.shape[1]):
        for step in range(rank - 1, -1, -1):
            total = right[step, c]
            for j in range(step + 1, matrix.shape[0]):
                total -= matrix[step, j] * out[order[j], c]
            out[order[step], c] = total / matrix[step, step]


@njit(cache=True, error_model="numpy")
def solve_conserving(matrix, right, out):
    """Solve matrix out = right; what the matrix conserves (its left null vectors) is left unchanged by the solution.

    With c' matrix = 0 the equation says nothing of c' out: among all solutions the one with c' out = 0 is returned.
    """
    n = matrix.shape[0]
    order = np.empty(n, np.int64)
    none = np.zeros((n, 0))
    transposed = matrix.T.copy()
    rank = eliminate(transposed, none, order)
    work = matrix.copy()
    if rank < n:
        free = np.zeros((n, n - rank))
        for k in range(n - rank):
            free[order[rank + k], k] = 1.0
        back_substitute(transposed, np.zeros((n, n - rank)), order, rank, free)
        for k in range(n - rank):
            size = dot(free[:, k].copy(), free[:, k].copy())
            for i in range(n):
                for j in range(n):
                    work[i, j] += free[i, k] * free[j, k] / size
    system = right.copy()
    rank = eliminate(work, system, order)
    out[:] = 0.0
    back_substitute(work, system, order, rank, out)
