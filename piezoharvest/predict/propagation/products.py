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
def _set_equations(step, slopes, elements, off, J):
    """Set the implicit inputs' rows of 1 - K f', and behind each its largest magnitude among those of all of these."""
    K, implicit, places = step.feed, step.implicit, elements.places
    m, half, count = len(step.feed), len(elements.rated), len(places)
    for i in range(len(implicit)):
        for c in range(m):
            J[i, c] = 1.0 if implicit[i] == c else 0.0
    for j in range(count):
        if off[j] or not step.feeds[j]:
            continue
        a, b = places[j, 0], places[j, 1]
        first, second = elements.added[a], elements.added[b]
        for q in range(3 if elements.acts[j] else 1):
            s = slopes[q, j]
            for i in range(len(implicit)):
                fed = K[implicit[i], q * count + j]
                if fed == 0.0:
                    continue
                J[i, a] -= fed * s[FIRST_END]
                J[i, half + a] -= fed * s[FIRST_END + 1]
                J[i, b] -= fed * s[SECOND_END]
                J[i, half + b] -= fed * s[SECOND_END + 1]
                if first >= 0:
                    J[i, first] -= fed * s[FIRST_ADDED]
                    J[i, first + elements.reached] -= fed * s[FIRST_ADDED + 1]
                if second >= 0:
                    J[i, second] -= fed * s[SECOND_ADDED]
                    J[i, second + elements.reached] -= fed * s[SECOND_ADDED + 1]
    for i in range(len(implicit)):
        J[i, m] = 0.0
        for c in implicit:
            J[i, m] = max(J[i, m], abs(J[i, c]))


@compiled
def solve(step, slopes, elements, off, J, right):
    """Overwrite `right` by the solution of (1 - K f') d = right, f' being the slopes for present inputs and rates.

    Rows of explicit inputs are those of the solution already.
    """
    implicit, m = step.implicit, len(step.feed)
    _set_equations(step, slopes, elements, off, J)
    for i in range(len(implicit)):
        for c in step.explicit:
            if J[i, c] != 0.0:
                for p in range(right.shape[1]):
                    right[implicit[i], p] -= J[i, c] * right[c, p]
    for i in range(len(implicit)):
        c, pivot = implicit[i], i
        for k in range(i + 1, len(implicit)):
            # Rows have units of their own.
            if abs(J[k, c]) * J[pivot, m] > abs(J[pivot, c]) * J[k, m]:
                pivot = k
        if pivot != i:
            for k in range(m + 1):
                J[i, k], J[pivot, k] = J[pivot, k], J[i, k]
            for p in range(right.shape[1]):
                right[c, p], right[implicit[pivot], p] = right[implicit[pivot], p], right[c, p]
        for k in range(len(implicit)):
            if k != i and J[k, c] != 0.0:
                factor = J[k, c] / J[i, c]
                for e in implicit[i:]:
                    J[k, e] -= factor * J[i, e]
                for p in range(right.shape[1]):
                    right[implicit[k], p] -= factor * right[c, p]
    for i in range(len(implicit)):
        inverse = 1.0 / J[i, implicit[i]]
        for p in range(right.shape[1]):
            right[implicit[i], p] *= inverse
