"""Small dense linear algebra for compiled loops, where a library call would cost more than the work."""

from __future__ import annotations

from piezoharvest.engine.compiled import compiled_sums


@compiled_sums
def dot(row, z):
    """Linear form of a vector."""
    total = 0.0
    for j in range(len(z)):
        total += row[j] * z[j]
    return total


@compiled_sums
def product(left, right, out):
    """Out = left right, for matrices."""
    for i in range(left.shape[0]):
        for j in range(right.shape[1]):
            out[i, j] = 0.0
        for k in range(left.shape[1]):
            factor = left[i, k]
            if factor != 0.0:
                for j in range(right.shape[1]):
                    out[i, j] += factor * right[k, j]


@compiled_sums
def row_product(row, matrix, count, out):
    """Out = row matrix, over the first `count` rows of the matrix."""
    for j in range(matrix.shape[1]):
        out[j] = 0.0
    for k in range(count):
        factor = row[k]
        if factor != 0.0:
            for j in range(matrix.shape[1]):
                out[j] += factor * matrix[k, j]
