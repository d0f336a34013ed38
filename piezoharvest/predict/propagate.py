"""Compiled propagation over the samples of a record, with derivatives with respect to all parameters.

Between two samples all is linear except the elements, whose outputs at the end of a step depend on the state there:
their inputs are found by Newton's method. A stop whose input reverses within the step is evaluated at the turning point
first, which is found on the cubic through values and rates at both ends. Derivatives are propagated with the step,
parameters being the innermost axis so that the loops over them are vectorised.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from piezoharvest.engine.compilation.compiled import cached

_STOP, _PRODUCT, _POWER = 0, 1, 2
_MAX_ITERATIONS = 60
_MIN_STEP_SHARE = 0.01  # of a Newton step
_TOLERANCE = 1e-13  # relative residual of the inputs at which Newton ends
_ROUNDING_SHARE = 0.1  # of an input: its rounding error is well below this times _TOLERANCE
_ROUNDED_TOLERANCE = 1e-8  # the same, still accepted if rounding prevents convergence
_fast = njit(nogil=True, error_model="numpy", fastmath={"contract", "nsz"})


@_fast
def _turning(a, da, b, db, h):
    """First extreme value between two samples of values a, b and rates da, db, with derivatives with respect to these.

    On the cubic through them; the value is NaN where there is none inside.
    """
    # p(s) = a + h da s + c2 s^2 + c3 s^3
    c2, c3 = 3.0 * (b - a) - h * (2.0 * da + db), 2.0 * (a - b) + h * (da + db)
    root = c2 * c2 - 3.0 * c3 * h * da
    if root < 0.0:
        return np.nan, 0.0, 0.0, 0.0, 0.0
    # Both roots without cancellation. Of two inside the first one is used: it appears and vanishes without a jump of
    # the path as b and db vary, which Newton's method requires.
    q = -(c2 + math.copysign(math.sqrt(root), c2))
    s, other = h * da / q, q / (3.0 * c3)
    if not 0.0 < s < 1.0 or 0.0 < other < s:
        s = other
    if not 0.0 < s < 1.0:
        return np.nan, 0.0, 0.0, 0.0, 0.0
    s2, s3 = s * s, s * s * s
    # At an extremum its place has no influence to first order: the derivatives are those of the interpolation.
    w_b, w_da, w_db = 3.0 * s2 - 2.0 * s3, h * (s - 2.0 * s2 + s3), h * (s3 - s2)
    return (1.0 - w_b) * a + w_da * da + w_b * b + w_db * db, 1.0 - w_b, w_da, w_b, w_db


@_fast
def _clip(value, limit):
    return min(max(value, -limit), limit)


@_fast
def _element(kind, limit, before, a, da, b, db, second, h):
    """Output of an element, and its derivatives with respect to (previous output, a, da, b, db, second input, limit).

    a and da are input and rate at the previous sample, b and db the present ones.
    """
    if kind == _STOP:
        turn, w_a, w_da, w_b, w_db = _turning(a, da, b, db, h)
        if turn == turn:
            middle = _clip(before + turn - a, limit)
            free = 1.0 if abs(before + turn - a) < limit else 0.0
            held = (1.0 - free) * math.copysign(1.0, before + turn - a)
            value = middle + b - turn
            if abs(value) < limit:
                return (
                    value, free, free * (w_a - 1.0) - w_a, free * w_da - w_da, free * w_b + 1.0 - w_b,
                    free * w_db - w_db, 0.0, held,
                )  # fmt: skip
            return _clip(value, limit), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.copysign(1.0, value)
        value = before + b - a
        if abs(value) < limit:
            return value, 1.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0
        return _clip(value, limit), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.copysign(1.0, value)
    if kind == _PRODUCT:
        return b * second, 0.0, 0.0, 0.0, second, 0.0, b, 0.0
    if kind == _POWER:
        return b**limit, 0.0, 0.0, 0.0, limit * b ** (limit - 1.0), 0.0, 0.0, 0.0
    if b <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    return b**limit, 0.0, 0.0, 0.0, limit * b ** (limit - 1.0), 0.0, 0.0, 0.0


@_fast
def _dot(rows, values, out):
    """Product of a matrix with a vector, into `out`."""
    for r in range(len(out)):
        total = 0.0
        for j in range(len(values)):
            total += rows[r, j] * values[j]
        out[r] = total


@_fast
def _nonzeros(A):
    """Columns of the nonzero entries in each row of a matrix, and their number."""
    columns, counts = np.zeros(A.shape, np.int64), np.zeros(len(A), np.int64)
    for r in range(A.shape[0]):
        for j in range(A.shape[1]):
            if A[r, j] != 0.0:
                columns[r, counts[r]] = j
                counts[r] += 1
    return columns, counts


@_fast
def _multiply(A, columns, counts, R, out):
    """Add A R to out, all of them matrices; `columns` and `counts` as in `_nonzeros` of A.

    Several rows of R at a time: a loop over few parameters is dominated by its overhead. Rows are not taken as views,
    whose references would be counted atomically, which takes as long as the loop.
    """
    P = out.shape[1]
    for r in range(len(A)):
        count, q = counts[r], 0
        while q + 4 <= count:
            a, b, c, d = columns[r, q], columns[r, q + 1], columns[r, q + 2], columns[r, q + 3]
            f, g, h, i = A[r, a], A[r, b], A[r, c], A[r, d]
            for p in range(P):
                out[r, p] += f * R[a, p] + g * R[b, p] + h * R[c, p] + i * R[d, p]
            q += 4
        if q + 3 <= count:
            a, b, c = columns[r, q], columns[r, q + 1], columns[r, q + 2]
            f, g, h = A[r, a], A[r, b], A[r, c]
            for p in range(P):
                out[r, p] += f * R[a, p] + g * R[b, p] + h * R[c, p]
            q += 3
        while q < count:
            a = columns[r, q]
            f = A[r, a]
            for p in range(P):
                out[r, p] += f * R[a, p]
            q += 1


@_fast
def _weighted_sums(tangents, values, out):
    """Sum of derivatives of coefficients times the multiplied values, one for each nonzero entry."""
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


@_fast
def _assign(values, out):
    """Overwrite the first rows of a matrix by those of another."""
    for r in range(len(values)):
        for p in range(values.shape[1]):
            out[r, p] = values[r, p]


@_fast
def _clear(out):
    """Overwrite a matrix by zeros."""
    for r in range(len(out)):
        for p in range(out.shape[1]):
            out[r, p] = 0.0


@_fast
def _scatter(values, places, begin, end, first, out):
    """Add values begin:end to their entries (row, parameter) of a matrix.

    Rows count from the first.
    """
    for k in range(begin, end):
        out[places[k, 0] - first, places[k, 1]] += values[k]


@_fast
def _solve(K, slopes, places, J, right):
    """Overwrite `right` by the solution of (1 - K f') d = right, f' being the slopes for present inputs and rates."""
    m = len(J)
    half = m // 2
    for r in range(m):
        for c in range(m):
            J[r, c] = 1.0 if r == c else 0.0
    for j in range(len(places)):
        for r in range(m):
            J[r, places[j, 0]] -= K[r, j] * slopes[j, 3]
            J[r, half + places[j, 0]] -= K[r, j] * slopes[j, 4]
            J[r, places[j, 1]] -= K[r, j] * slopes[j, 5]
    for c in range(m):
        pivot = c
        for r in range(c + 1, m):
            if abs(J[r, c]) > abs(J[pivot, c]):
                pivot = r
        if pivot != c:
            for k in range(m):
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


@_fast
def _solve_outputs(K, base, limits, kinds, places, before, old, h, held, w, trial, slopes, J, residual, sizes, move):
    """Find outputs `w` of the elements and their inputs `trial` by Newton's method from `trial`; return True if found.

    `base` are the inputs without the contribution K w of the outputs; `before` and `old` are outputs and inputs at the
    previous sample. With `held` the stops keep their outputs.
    """
    half, worst, best, share = len(base) // 2, 0.0, np.inf, 1.0
    for _ in range(_MAX_ITERATIONS):
        for j in range(len(w)):
            a, b = places[j, 0], places[j, 1]
            if held and kinds[j] == _STOP:
                w[j] = before[j]
                slopes[j] = 0.0
                slopes[j, 0] = 1.0
                continue
            s = _element(kinds[j], limits[j], before[j], old[a], old[half + a], trial[a], trial[half + a], trial[b], h)
            w[j] = s[0]
            for q in range(7):
                slopes[j, q] = s[q + 1]
        worst = 0.0
        for r in range(len(base)):
            total, size = base[r], max(abs(base[r]), sizes[r])
            for j in range(len(w)):
                total += K[r, j] * w[j]
                # A stop at rest gives the difference of two inputs, with the rounding errors of these.
                size += abs(K[r, j]) * (abs(w[j]) + _ROUNDING_SHARE * abs(trial[places[j, 0]]))
            residual[r, 0] = total - trial[r]
            worst = max(worst, abs(residual[r, 0]) / (size + 1e-300))
        if worst < _TOLERANCE:
            for r in range(len(base)):
                sizes[r] = max(sizes[r], abs(trial[r]))
            return True
        if worst >= best and share > _MIN_STEP_SHARE:
            # Too far, across a corner of an operator: halve the step.
            share *= 0.5
            for r in range(len(base)):
                trial[r] -= share * move[r]
            continue
        best, share = worst, 1.0
        _solve(K, slopes, places, J, residual)
        for r in range(len(base)):
            move[r] = residual[r, 0]
            trial[r] += move[r]
    return worst < _ROUNDED_TOLERANCE


@cached
@_fast
def propagate_block(
    coefficients, every, lane, rise, first, share, at_start, h, M, H, O, limits, kinds, places,  # noqa: E741
    dM, dH, dO, M_at, H_at, O_at, dlimits, z, w, inputs, dz, dw, dinputs, local, sizes, Y, dY,
):  # fmt: skip
    """Propagate over a block of samples.

    Parameters
    ----------
    coefficients : (steps, 4) array
        Polynomial coefficients of the drive in every step.
    every : int
        Steps between two samples that are written.
    lane : int
        The first of two parameters that the drive depends on.
    rise : (steps, 2) array, or (0, 2)
        Derivatives of the drive in every step with respect to these.
    first : float
        Time at the first sample, as fraction of the record.
    share : float
        Step as fraction of the record.
    at_start : bool
        The record begins here: the first sample is written too, else it is the last one of the previous block.
    h : float
        s between samples.
    M, H, O, limits
        As in `Step`.
    kinds, places
        As in `Matrices`.
    dM : (n + elements + 6, entries) array
        Derivatives of M, column by column, only for those pairs of a row and a parameter with nonzero ones: with many
        effects these are few. dH and dO in the same form; dlimits (elements, parameters).
    M_at, H_at, O_at : (entries, 2) array
        Row and parameter of each entry.
    z, w, inputs, dz, dw, dinputs : arrays
        States, outputs and inputs of the elements (then their rates) at the first sample, with their derivatives;
        overwritten by those at the last.
    local : (elements, 2) array
        Sum over the steps of the elements' slopes with respect to their inputs, updated.
    sizes : (inputs,) array
        Largest inputs and rates so far, the scale of rounding; updated.
    Y : (samples, outputs) array
    dY : (samples, outputs, parameters) array
        Both outputs.

    Returns
    -------
    int
        -1, or the step in which Newton's method failed.
    """
    n, nw, m, P = len(z), len(w), len(inputs), dz.shape[1]
    half, size = m // 2, n + nw
    old, before, trial, base = inputs.copy(), w.copy(), np.zeros(m), np.zeros(m)
    slopes, J, residual, move = np.zeros((nw, 7)), np.zeros((m, m)), np.zeros((m, 1)), np.zeros(m)
    # Vectors multiplied by M and O: states, outputs of the elements, drive and time; derivatives of the first two.
    g, y, d = np.zeros(size + 6), np.zeros(size + 4), np.zeros((size, P))
    d[:n], d[n:] = dz, dw
    zl, dzl, right = z.copy(), dz.copy(), np.zeros((m, P))
    dstates, dforced, drows = np.zeros(len(M_at)), np.zeros(len(H_at)), np.zeros(len(O_at))
    inner = 0  # entries of O that are those of inputs
    while inner < len(O_at) and O_at[inner, 0] < m:
        inner += 1
    O_in, O_out = O[:m].copy(), O[m:].copy()
    K = O_in[:, n:size].copy()
    O_in[:, n:size] = 0.0  # the influence of outputs on inputs is treated by Newton's method
    M_d, in_d, out_d, H_d = M[:, :size].copy(), O[:m, :size].copy(), O_out[:, :size].copy(), np.zeros((n, size))
    H_d[:, n:] = H
    in_M, count_M = _nonzeros(M_d)
    in_in, count_in = _nonzeros(in_d)
    in_out, count_out = _nonzeros(out_d)
    in_H, count_H = _nonzeros(H_d)
    for k in range(-1 if at_start else 0, len(coefficients)):
        now = first + share * (k + 1)
        q = coefficients[max(k, 0)]
        if k < 0:
            y[size], y[size + 1] = q[0], q[1] / h
        else:
            if k == 0:
                K += O_in[:, :n].copy() @ H
                in_d[:, n:] = K
                in_in, count_in = _nonzeros(in_d)
            y[size], y[size + 1] = q[0] + q[1] + q[2] + q[3], (q[1] + 2 * q[2] + 3 * q[3]) / h
            g[:n], g[n:size] = z, w
            g[size : size + 4], g[size + 4], g[size + 5] = q, 1.0, now - share
            _dot(M, g, zl)
            if P:
                _weighted_sums(dM, g, dstates)
                _clear(dzl)
                _scatter(dstates, M_at, 0, len(dstates), 0, dzl)
                if len(rise):
                    for r in range(n):
                        dzl[r, lane] += M[r, size] * rise[k, 0]
                        dzl[r, lane + 1] += M[r, size] * rise[k, 1]
        y[:n], y[size + 2], y[size + 3] = zl, 1.0, now
        _dot(O_in, y, base)
        old[:], before[:] = inputs, w
        for r in range(m):
            trial[r] = base[r]
            for j in range(nw):
                trial[r] += K[r, j] * w[j]
        if not _solve_outputs(
            K, base, limits, kinds, places, before, old, h, k < 0, w, trial, slopes, J, residual, sizes, move
        ):
            return max(k, 0)
        inputs[:], z[:] = trial, zl
        if k >= 0:
            for j in range(nw):
                local[j, 0] += slopes[j, 3]
                local[j, 1] += slopes[j, 5]
            for r in range(n):
                for j in range(nw):
                    z[r] += H[r, j] * w[j]
        y[:n], y[n:size] = z, w
        sample, written = (k + 1) // every, (k + 1) % every == 0
        if written:
            _dot(O_out, y, Y[sample])
        if not P:
            continue
        # The same for the derivatives; first the part that does not depend on the elements' present inputs.
        _weighted_sums(dO, y, drows)
        _clear(right)
        _scatter(drows, O_at, 0, inner, 0, right)
        if k >= 0:
            _multiply(M_d, in_M, count_M, d, dzl)
            _weighted_sums(dH, w, dforced)
            _scatter(dforced, H_at, 0, len(dforced), 0, dzl)
        _assign(dzl, d)
        for j in range(nw):
            a, b = places[j, 0], places[j, 0] + half
            s0, s1, s2, s6 = slopes[j, 0], slopes[j, 1], slopes[j, 2], slopes[j, 6]
            for p in range(P):
                d[n + j, p] = s0 * d[n + j, p] + s1 * dinputs[a, p] + s2 * dinputs[b, p] + s6 * dlimits[j, p]
        _multiply(in_d, in_in, count_in, d, right)
        _solve(K, slopes, places, J, right)
        _assign(right, dinputs)
        for j in range(nw):
            a, b, c = places[j, 0], places[j, 0] + half, places[j, 1]
            s3, s4, s5 = slopes[j, 3], slopes[j, 4], slopes[j, 5]
            for p in range(P):
                d[n + j, p] += s3 * dinputs[a, p] + s4 * dinputs[b, p] + s5 * dinputs[c, p]
        if k >= 0:
            _multiply(H_d, in_H, count_H, d, dzl)
            _assign(dzl, d)
        if written:
            out = dY[sample]
            _clear(out)
            _scatter(drows, O_at, inner, len(drows), m, out)
            _multiply(out_d, in_out, count_out, d, out)
    dz[:], dw[:] = d[:n], d[n:]
    return -1
