"""Tables of a linear mode: its matrix exponential on dyadic steps, its guards and its energies, built when first met.

A mode is a configuration of the shunt with the set of stop operators that slip. exp(A h) - 1, not exp(A h), is kept
and doubled: slow motions beside fast ones then lose no digits, however many times the step is doubled.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine.algebra import dot, product, row_product
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.reference import reference

MODES = 64  # kept at once; met again after that, they are built anew
# |A| h on the finest level: a Taylor series over less than that is short. A step begins FIRST levels above it, where
# |A| h is 1/2 and every motion of the mode is still followed.
FINEST, FIRST = 1.0 / 16.0, 3
ORDER = 9  # Taylor terms: on the finest level the rest is below 1e-17
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS


class Tables(NamedTuple):
    """Tables of up to m modes; a, n, g, o as in `Program`, l levels of halved steps, e categories of energy."""

    size: np.ndarray  # (1,) int, modes held
    key: np.ndarray  # (m,) int64
    matrix: np.ndarray  # (m, a, a): z' = matrix z
    growth: np.ndarray  # (m, l, a, a): exp(A h) - 1 at h = step / 2^level
    finest: np.ndarray  # (m,) int, level at which |A| h <= FINEST
    guards: np.ndarray  # (m, 3 g, a): value, rate and second rate of every guard, the watched outputs' rates last
    guard_size: np.ndarray  # (m, 3 g): largest coefficient of each
    products: np.ndarray  # (m, p, 2, a)
    gramian: np.ndarray  # (m, l, e, a, a): z gramian z is the energy of a step
    outputs: np.ndarray  # (m, o, a)
    powers: np.ndarray  # (order + 1, a, a) scratch: terms of the Taylor series
    square: np.ndarray  # (3, a, a) scratch


TablesRef, TablesType = reference(Tables)


@compiled
def point(tables):
    """The tables by pointer, for compiled code."""
    return TablesRef(*tables)


def allocate(program: pg.Program, ledger: bool, levels: int = 60):
    """Empty tables, by pointer; without `ledger` the energies take no room."""
    a = program.rate.shape[-1]
    configurations, guards = program.guard_target.shape
    stops = len(program.stop_state)
    rows = 3 * (guards + 1 + 2 * stops + pg.WATCHED)
    modes = int(min(MODES, configurations * 2 ** min(stops, 10)))
    energy = program.categories if ledger else 0
    tables = Tables(
        size=np.zeros(1, np.int64),
        key=np.full(modes, -1, np.int64),
        matrix=np.zeros((modes, a, a)),
        growth=np.empty((modes, levels, a, a)),
        finest=np.zeros(modes, np.int64),
        guards=np.zeros((modes, rows, a)),
        guard_size=np.zeros((modes, rows)),
        products=np.zeros((modes, program.product_category.shape[1] + stops, 2, a)),
        gramian=np.empty((modes, levels if ledger else 0, energy, a, a)),
        outputs=np.empty((modes, len(pg.OUTPUTS), a)),
        powers=np.empty((ORDER + 1, a, a)),
        square=np.empty((3, a, a)),
    )
    return point(tables)


@compiled
def seek(T, configuration, slip):
    """Index of a mode in the tables, or -1."""
    key = mode_key(configuration, slip)
    for slot in range(T.size[0]):
        if T.key[slot] == key:
            return slot
    return -1


@compiled
def mode_key(configuration, slip):
    """One number for a mode."""
    key = np.int64(configuration)
    for j in range(len(slip)):
        key = 2 * key + (1 if slip[j] != 0 else 0)
    return key


@compiled
def build(P, T, configuration, slip):
    """Tables of a mode that is not there yet; the oldest are dropped where there is no room left."""
    if T.size[0] == len(T.key):
        T.size[0] = 0
    slot = T.size[0]
    T.size[0] += 1
    T.key[slot] = mode_key(configuration, slip)
    _motion(P, T, slot, configuration, slip)
    _forms(P, T, slot, configuration, slip)
    _exponentials(T, slot, P.step)
    if T.gramian.shape[1]:
        _energies(P, T, slot, configuration)


@compiled
def _motion(P, T, slot, configuration, slip):
    """Z' = matrix z, the sticking stops tied to their inputs one after the other (Sherman-Morrison)."""
    n, a = P.rate.shape[1], P.rate.shape[2]
    matrix = T.matrix[slot]
    matrix[:n] = P.rate[configuration]
    matrix[n:, n:] = P.exosystem
    response = T.square[0]
    for i in range(n):
        for j in range(len(slip)):
            response[i, j] = P.stop_response[configuration, i, j]
    row = T.square[1, 0]
    for j in range(len(slip)):
        if slip[j] != 0:
            continue
        gain = 1.0
        for i in range(n):
            gain -= P.stop_input[j, i] * response[i, j]
        row_product(P.stop_input[j], matrix, n, row)
        for i in range(n):
            factor = response[i, j] / gain
            if factor != 0.0:
                for k in range(a):
                    matrix[i, k] += factor * row[k]
        for other in range(j + 1, len(slip)):
            shared = 0.0
            for i in range(n):
                shared += P.stop_input[j, i] * response[i, other]
            for i in range(n):
                response[i, other] += response[i, j] * shared / gain


@compiled
def _forms(P, T, slot, configuration, slip):
    """Guards (the circuit's, the extremum, two for each stop, the watched), products, outputs over the whole state."""
    n, a = P.rate.shape[1], P.rate.shape[2]
    matrix, rows, scratch = T.matrix[slot], T.guards[slot], T.square[0, 0]
    own = P.guard_target.shape[1]
    rows[:] = 0.0
    for g in range(own):
        row_product(P.guard_d[configuration, g], matrix, n, rows[3 * g])
        rows[3 * g] += P.guard_z[configuration, g]
    if P.switched:
        rows[3 * own] = P.trigger_row
    for j in range(len(slip)):
        first, second = 3 * (own + 1 + 2 * j), 3 * (own + 2 + 2 * j)
        if slip[j] == 0:
            limit = P.stop_limit[j] * P.exo_scale[a - n - 1]
            rows[first, P.stop_state[j]], rows[second, P.stop_state[j]] = 1.0, -1.0
            rows[first, a - 1], rows[second, a - 1] = -limit, -limit
        else:
            row_product(P.stop_input[j], matrix, n, scratch)
            rows[first] = -scratch
    for o in range(T.outputs.shape[1]):
        row_product(P.output_d[configuration, o], matrix, n, T.outputs[slot, o])
        T.outputs[slot, o] += P.output_z[configuration, o]
    watched = rows.shape[0] - 3 * pg.WATCHED
    row_product(T.outputs[slot, pg.DISPLACEMENT], matrix, a, rows[watched])
    row_product(T.outputs[slot, pg.VOLTAGE], matrix, a, rows[watched + 3])
    for g in range(rows.shape[0] // 3):
        row_product(rows[3 * g], matrix, a, rows[3 * g + 1])
        row_product(rows[3 * g + 1], matrix, a, rows[3 * g + 2])
    for r in range(rows.shape[0]):
        T.guard_size[slot, r] = 0.0
        for j in range(a):
            T.guard_size[slot, r] = max(T.guard_size[slot, r], abs(rows[r, j]))
    count = P.product_category.shape[1]
    for p in range(count):
        for k in range(2):
            row_product(P.product_d[configuration, p, k], matrix, n, T.products[slot, p, k])
            T.products[slot, p, k] += P.product_z[configuration, p, k]
    for j in range(len(slip)):
        # What a slipping stop dissipates: its force-like output times the rate of its input.
        T.products[slot, count + j] = 0.0
        if slip[j] != 0:
            T.products[slot, count + j, 0, P.stop_state[j]] = P.stop_weight[j]
            row_product(P.stop_input[j], matrix, n, T.products[slot, count + j, 1])


@compiled
def _exponentials(T, slot, longest):
    """exp(A h) - 1 on the finest level by its Taylor series, then doubled up to the longest step."""
    a = T.matrix.shape[1]
    matrix, growth, powers, square = T.matrix[slot], T.growth[slot], T.powers, T.square
    norm = 0.0
    for i in range(a):
        total = 0.0
        for j in range(a):
            total += abs(matrix[i, j])
        norm = max(norm, total)
    finest, h = 0, longest
    while norm * h > FINEST and finest < growth.shape[0] - 1:
        finest += 1
        h *= 0.5
    T.finest[slot] = finest
    powers[0] = 0.0
    for i in range(a):
        powers[0, i, i] = 1.0
    square[0] = matrix
    square[0] *= h
    growth[finest] = 0.0
    for k in range(1, ORDER + 1):
        product(square[0], powers[k - 1], powers[k])
        powers[k] *= 1.0 / k
    for k in range(ORDER, 0, -1):
        growth[finest] += powers[k]
    for level in range(finest, 0, -1):
        product(growth[level], growth[level], growth[level - 1])
        growth[level - 1] += growth[level]
        growth[level - 1] += growth[level]


@compiled
def _energies(P, T, slot, configuration):
    """Energies of a step as quadratic forms of the state at its beginning, on every level.

    On the finest level by Gauss-Legendre quadrature of polynomials, exact to rounding; then doubled.
    """
    a, finest = T.matrix.shape[1], T.finest[slot]
    gramian, exponential, scratch = T.gramian[slot], T.square[0], T.square[1]
    count = P.product_category.shape[1]
    gramian[finest] = 0.0
    for q in range(len(NODES)):
        exponential[:] = 0.0
        for k in range(ORDER, -1, -1):
            exponential *= NODES[q]
            exponential += T.powers[k]
        for p in range(T.products.shape[1]):
            category, weight = pg.HYSTERESIS, WEIGHTS[q] * P.step * 0.5**finest
            if p < count:
                category = P.product_category[configuration, p]
                weight *= P.product_coefficient[configuration, p]
            if category < 0:
                continue
            row_product(T.products[slot, p, 0], exponential, a, scratch[0])
            row_product(T.products[slot, p, 1], exponential, a, scratch[1])
            for i in range(a):
                for j in range(a):
                    gramian[finest, category, i, j] += weight * scratch[0, i] * scratch[1, j]
    for level in range(finest, 0, -1):
        exponential[:] = T.growth[slot, level]
        for i in range(a):
            exponential[i, i] += 1.0
        for e in range(gramian.shape[1]):
            product(gramian[level, e], exponential, scratch)
            gramian[level - 1, e] = gramian[level, e]
            for i in range(a):
                for k in range(a):
                    factor = exponential[k, i]
                    for j in range(a):
                        gramian[level - 1, e, i, j] += factor * scratch[k, j]


@compiled
def quadratic(form, z):
    """Z form z."""
    total = 0.0
    for i in range(len(z)):
        total += z[i] * dot(form[i], z)
    return total
