"""Products, sums and solutions with parameters as the innermost axis, so that the loops over them are vectorised."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.predict.propagation.arguments import FIRST_ADDED, FIRST_END, SECOND_ADDED, SECOND_END


@compiled
def dot(rows, values, out):
    """Product of a matrix with a vector, into `out`."""
    for r in range(len(out)):
        total = 0.0
        for j in range(len(values)):
            total += rows[r, j] * values[j]
        out[r] = total


@compiled
def add_product(A, R, out):
    """Add A R to `out`, A being Sparse and the others matrices.

    Several rows of R at a time: a loop over few parameters is dominated by its overhead.
    """
    values, columns, counts = A
    P = out.shape[1]
    for r in range(len(out)):
        count, q = counts[r], 0
        while q + 4 <= count:
            a, b, c, d = columns[r, q], columns[r, q + 1], columns[r, q + 2], columns[r, q + 3]
            f, g, h, i = values[r, q], values[r, q + 1], values[r, q + 2], values[r, q + 3]
            for p in range(P):
                out[r, p] += f * R[a, p] + g * R[b, p] + h * R[c, p] + i * R[d, p]
            q += 4
        if q + 3 <= count:
            a, b, c = columns[r, q], columns[r, q + 1], columns[r, q + 2]
            f, g, h = values[r, q], values[r, q + 1], values[r, q + 2]
            for p in range(P):
                out[r, p] += f * R[a, p] + g * R[b, p] + h * R[c, p]
            q += 3
        while q < count:
            a, f = columns[r, q], values[r, q]
            for p in range(P):
                out[r, p] += f * R[a, p]
            q += 1


@compiled
def weighted_sums(tangent, values):
    """Derivatives of the product of a matrix with a vector of fixed values, into the memory of its Tangent."""
    tangents, out = tangent.values, tangent.sums
    for p in range(len(out)):
        out[p] = 0.0
    j = 0
    while j + 4 <= len(values):
        f, g, h, i = values[j], values[j + 1], values[j + 2], values[j + 3]
        for p in range(len(out)):
            out[p] += f * tangents[j, p] + g * tangents[j + 1, p] + h * tangents[j + 2, p] + i * tangents[j + 3, p]
        j += 4
    while j < len(values):
        f = values[j]
        for p in range(len(out)):
            out[p] += f * tangents[j, p]
        j += 1


@compiled
def assign(values, out):
    """Overwrite the first rows of a matrix by those of another."""
    for r in range(len(values)):
        for p in range(values.shape[1]):
            out[r, p] = values[r, p]


@compiled
def clear(out):
    """Overwrite a matrix by zeros."""
    for r in range(len(out)):
        for p in range(out.shape[1]):
            out[r, p] = 0.0


@compiled
def scatter(tangent, begin, end, first, out):
    """Add the sums begin:end of a Tangent to their entries of `out`, whose rows count from the first."""
    for k in range(begin, end):
        out[tangent.places[k, 0] - first, tangent.places[k, 1]] += tangent.sums[k]


@compiled
def solve(K, slopes, elements, off, J, right):
    """Overwrite `right` by the solution of (1 - K f') d = right, f' being the slopes for present inputs and rates."""
    m, places = len(J), elements.places
    half, count = len(elements.rated), len(places)
    for r in range(m):
        for c in range(m):
            J[r, c] = 1.0 if r == c else 0.0
    for j in range(count):
        if off[j]:
            continue
        a, b = places[j, 0], places[j, 1]
        for q in range(3 if elements.acts[j] else 1):
            by_first, by_rate = slopes[q, j, FIRST_END], slopes[q, j, FIRST_END + 1]
            by_second, by_its_rate = slopes[q, j, SECOND_END], slopes[q, j, SECOND_END + 1]
            for r in range(m):
                fed = K[r, q * count + j]
                J[r, a] -= fed * by_first
                J[r, half + a] -= fed * by_rate
                J[r, b] -= fed * by_second
                J[r, half + b] -= fed * by_its_rate
            at = elements.added[a]
            if at >= 0:
                for r in range(m):
                    J[r, at] -= K[r, q * count + j] * slopes[q, j, FIRST_ADDED]
                    J[r, at + elements.reached] -= K[r, q * count + j] * slopes[q, j, FIRST_ADDED + 1]
            at = elements.added[b]
            if at >= 0:
                for r in range(m):
                    J[r, at] -= K[r, q * count + j] * slopes[q, j, SECOND_ADDED]
                    J[r, at + elements.reached] -= K[r, q * count + j] * slopes[q, j, SECOND_ADDED + 1]
    for r in range(m):
        J[r, m] = 0.0
        for c in range(m):
            J[r, m] = max(J[r, m], abs(J[r, c]))
    for c in range(m):
        pivot = c
        for r in range(c + 1, m):
            # Rows have units of their own. An input that nothing present reaches keeps its row, and its value exactly.
            if abs(J[r, c]) * J[pivot, m] > abs(J[pivot, c]) * J[r, m]:
                pivot = r
        if pivot != c:
            for k in range(m + 1):
                J[c, k], J[pivot, k] = J[pivot, k], J[c, k]
            for p in range(right.shape[1]):
                right[c, p], right[pivot, p] = right[pivot, p], right[c, p]
        for r in range(m):
            if r != c and J[r, c] != 0.0:
                factor = J[r, c] / J[c, c]
                for k in range(c, m):
                    J[r, k] -= factor * J[c, k]
                for p in range(right.shape[1]):
                    right[r, p] -= factor * right[c, p]
    for c in range(m):
        inverse = 1.0 / J[c, c]
        for p in range(right.shape[1]):
            right[c, p] *= inverse
