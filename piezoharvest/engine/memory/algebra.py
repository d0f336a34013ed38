"""Small dense linear algebra in flat memory: matrices of a shooting method, stored row by row from a place in W."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory.vector import GROUP, multiply_all

PIVOT_TOLERANCE = 1e-10  # relative to the largest: a smaller pivot counts as zero
MAX_DOUBLINGS, MIN_DOUBLINGS = 26, 8  # of the power whose root is the spectral radius: most, and fewest
RADIUS_TOLERANCE = 1e-9  # relative, of the radius


@compiled
def is_unit(W, a, n):
    """True if the matrix at a is the unit matrix, whose equations are solved already."""
    for k in range(n):
        for m in range(n):
            if W[a + k * n + m] != (1.0 if k == m else 0.0):
                return False
    return True


@compiled
def eliminate(W, V, a, b, n, columns, order):
    """Gaussian elimination of the matrix at a with the right sides at b, complete pivoting, in place; returns the rank.

    `order` in V receives the columns in the order in which they were taken. A pivot below 1e-10 of the largest counts
    as zero: a motion that decays over fewer than 1e10 periods is not mistaken for a conserved one.
    """
    for j in range(n):
        V[order + j] = j
    largest = 0.0
    for step in range(n):
        best, row, column = 0.0, step, step
        for i in range(step, n):
            for j in range(step, n):
                if abs(W[a + i * n + j]) > best:
                    best, row, column = abs(W[a + i * n + j]), i, j
        largest = max(largest, best)
        if best <= PIVOT_TOLERANCE * largest:
            return step
        for j in range(n):
            W[a + step * n + j], W[a + row * n + j] = W[a + row * n + j], W[a + step * n + j]
        for j in range(columns):
            here, there = b + step * columns + j, b + row * columns + j
            W[here], W[there] = W[there], W[here]
        for i in range(n):
            W[a + i * n + step], W[a + i * n + column] = W[a + i * n + column], W[a + i * n + step]
        V[order + step], V[order + column] = V[order + column], V[order + step]
        for i in range(step + 1, n):
            factor = W[a + i * n + step] / W[a + step * n + step]
            if factor != 0.0:
                for j in range(step, n):
                    W[a + i * n + j] -= factor * W[a + step * n + j]
                for j in range(columns):
                    W[b + i * columns + j] -= factor * W[b + step * columns + j]
    return n


@compiled
def back_substitute(W, V, a, b, n, columns, order, rank, out):
    """Solve the triangular system of `eliminate`; unknowns beyond the rank keep their values in `out` (n, columns)."""
    for c in range(columns):
        for step in range(rank - 1, -1, -1):
            total = W[b + step * columns + c]
            for j in range(step + 1, n):
                total -= W[a + step * n + j] * W[out + V[order + j] * columns + c]
            W[out + V[order + step] * columns + c] = total / W[a + step * n + step]


@compiled
def solve_conserving(W, V, matrix, right, n, order, work, out):
    """Solve matrix x = right; what the matrix conserves (its left null vectors) is left unchanged by the solution.

    With c' matrix = 0 the equation does not determine c' x: among all solutions the one with c' x = 0 is returned.
    `work` has room for 3 n^2 numbers; the matrix is overwritten.
    """
    copied, free, nothing = work, work + n * n, work + 2 * n * n
    for k in range(n * n):
        W[copied + k] = W[matrix + k]
    for i in range(n):
        W[free + i] = W[right + i]
    rank = eliminate(W, V, copied, free, n, 1, order)
    if rank == n:
        back_substitute(W, V, copied, free, n, 1, order, rank, out)
        return
    for i in range(n):
        for j in range(n):
            W[copied + j * n + i] = W[matrix + i * n + j]
    rank = eliminate(W, V, copied, nothing, n, 0, order)
    count = n - rank
    for k in range(n * count):
        W[free + k] = W[nothing + k] = 0.0
    for k in range(count):
        W[free + V[order + rank + k] * count + k] = 1.0
    back_substitute(W, V, copied, nothing, n, count, order, rank, free)
    for k in range(count):
        size = 0.0
        for i in range(n):
            size += W[free + i * count + k] ** 2
        for i in range(n):
            for j in range(n):
                W[matrix + i * n + j] += W[free + i * count + k] * W[free + j * count + k] / size
    rank = eliminate(W, V, matrix, right, n, 1, order)
    for i in range(n):
        W[out + i] = 0.0
    back_substitute(W, V, matrix, right, n, 1, order, rank, out)


@compiled
def radius(W, matrix, n, work):
    """Spectral radius of a matrix by repeated squaring, to about 1e-6. `work` has room for 2 (n + 3)^2 numbers.

    The matrices are padded with zeros, so that a square is made of products in vector registers; that they stand by
    rows, and not by columns, changes no eigenvalue.
    """
    side = -(-n // GROUP) * GROUP
    here, there, logarithm = work, work + side * side, 0.0
    for i in range(side):
        for j in range(side):
            W[here + i * side + j] = W[matrix + i * n + j] if i < n and j < n else 0.0
    for doubling in range(MAX_DOUBLINGS + 1):
        size = 0.0
        for k in range(side * side):
            size = max(size, abs(W[here + k]))
        if size == 0.0:
            return 0.0
        if not np.isfinite(size):
            return np.inf
        for k in range(side * side):
            W[here + k] /= size
        # `size` belongs to the power 2^doubling, of which the root is taken.
        growth = np.log(size) * 0.5**doubling
        logarithm += growth
        if doubling > MIN_DOUBLINGS and abs(growth) < RADIUS_TOLERANCE:
            break
        multiply_all(W, here, side, side, side, W, here, side, there)
        here, there = there, here
    return np.exp(logarithm)
