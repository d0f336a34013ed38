"""Tables of a linear mode: its matrix exponential on dyadic steps, its guards and its energies, built when first met.

A mode is a configuration of the shunt with the set of stop operators that slip. exp(A h) - 1, not exp(A h), is kept
and doubled: slow motions beside fast ones then lose no digits, however many times the step is doubled.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from piezoharvest.engine import program as pg

MODES = 64  # kept at once; met again after that, they are built anew
ORDER = 14  # Taylor terms: at |A| h <= 1/2 the rest is below 1e-16
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS


class Tables(NamedTuple):
    """Tables of up to m modes; a, n, g, o as in `Program`, l levels of halved steps, e categories of energy."""

    size: np.ndarray  # (1,) int, modes held
    key: np.ndarray  # (m,) int64
    matrix: np.ndarray  # (m, a, a): z' = matrix z
    growth: np.ndarray  # (m, l, a, a): exp(A h) - 1 at h = step / 2^level
    finest: np.ndarray  # (m,) int, level at which |A| h <= 1/2
    guards: np.ndarray  # (m, g, 3, a): value, rate and second rate of every guard
    guard_count: np.ndarray  # (m,) int
    products: np.ndarray  # (m, p, 2, a)
    gramian: np.ndarray  # (m, l, e, a, a): z gramian z is the energy of a step
    outputs: np.ndarray  # (m, o, a)


def allocate(program: pg.Program, ledger: bool, levels: int = 60) -> Tables:
    """Empty tables; without `ledger` the energies take no room."""
    a = program.rate.shape[-1]
    configurations, guards = program.guard_target.shape
    stops = len(program.stop_state)
    modes = int(min(MODES, configurations * 2 ** min(stops, 10)))
    energy = program.categories if ledger else 0
    return Tables(
        size=np.zeros(1, np.int64),
        key=np.full(modes, -1, np.int64),
        matrix=np.empty((modes, a, a)),
        growth=np.empty((modes, levels, a, a)),
        finest=np.zeros(modes, np.int64),
        guards=np.zeros((modes, guards + 1 + 2 * stops, 3, a)),
        guard_count=np.zeros(modes, np.int64),
        products=np.empty((modes, program.product_category.shape[1] + stops, 2, a)),
        gramian=np.empty((modes, levels if ledger else 0, energy, a, a)),
        outputs=np.empty((modes, len(pg.OUTPUTS), a)),
    )


@njit(cache=True)
def find(P, T, configuration, slip):
    """Index of a mode in the tables; built if it is not there."""
    key = np.int64(configuration)
    for j in range(len(slip)):
        key = 2 * key + (1 if slip[j] != 0 else 0)
    for slot in range(T.size[0]):
        if T.key[slot] == key:
            return slot
    if T.size[0] == len(T.key):
        T.size[0] = 0
    slot = T.size[0]
    T.size[0] += 1
    T.key[slot] = key
    _build(P, T, slot, configuration, slip)
    return slot


@njit(cache=True)
def _build(P, T, slot, configuration, slip):
    n, a = P.mass.shape[2], P.rate.shape[2]
    mass = P.mass[configuration].copy()
    for j in range(len(slip)):
        if slip[j] == 0:
            mass[P.stop_state[j]] -= P.stop_input[j]
    matrix = T.matrix[slot]
    matrix[:] = 0.0
    matrix[:n] = np.linalg.solve(mass, P.rate[configuration])
    matrix[n:, n:] = P.exosystem
    norm = 0.0
    for i in range(a):
        norm = max(norm, np.sum(np.abs(matrix[i])))
    finest = 0
    while norm * P.step * 0.5**finest > 0.5 and finest < T.growth.shape[1] - 1:
        finest += 1
    T.finest[slot] = finest
    _guards(P, T, slot, configuration, slip)
    count = P.product_category.shape[1]
    for p in range(count):
        for k in range(2):
            T.products[slot, p, k] = P.product_z[configuration, p, k] + P.product_d[configuration, p, k] @ matrix[:n]
    for j in range(len(slip)):
        # What a slipping stop dissipates: its force-like output times the rate of its input.
        T.products[slot, count + j] = 0.0
        if slip[j] != 0:
            T.products[slot, count + j, 0, P.stop_state[j]] = P.stop_weight[j]
            T.products[slot, count + j, 1] = P.stop_input[j] @ matrix[:n]
    for o in range(T.outputs.shape[1]):
        T.outputs[slot, o] = P.output_z[configuration, o] + P.output_d[configuration, o] @ matrix[:n]
    _exponentials(P, T, slot, configuration)


@njit(cache=True)
def _guards(P, T, slot, configuration, slip):
    """Guards in the order: the circuit's, the extremum, two for each stop."""
    n, a = P.mass.shape[2], P.rate.shape[2]
    matrix, rows = T.matrix[slot], T.guards[slot]
    own = P.guard_target.shape[1]
    for g in range(own):
        rows[g, 0] = P.guard_z[configuration, g] + P.guard_d[configuration, g] @ matrix[:n]
    rows[own, 0] = P.trigger_row
    for j in range(len(slip)):
        first, second = own + 1 + 2 * j, own + 2 + 2 * j
        rows[first, 0] = 0.0
        rows[second, 0] = 0.0
        if slip[j] == 0:
            limit = P.stop_limit[j] * P.exo_scale[a - n - 1]
            rows[first, 0, P.stop_state[j]] = 1.0
            rows[second, 0, P.stop_state[j]] = -1.0
            rows[first, 0, a - 1] = -limit
            rows[second, 0, a - 1] = -limit
        else:
            rows[first, 0] = -(P.stop_input[j] @ matrix[:n])
    for g in range(rows.shape[0]):
        rows[g, 1] = rows[g, 0] @ matrix
        rows[g, 2] = rows[g, 1] @ matrix


@njit(cache=True)
def _exponentials(P, T, slot, configuration):
    a = T.matrix.shape[1]
    finest = T.finest[slot]
    h = P.step * 0.5**finest
    powers = np.empty((ORDER + 1, a, a))
    powers[0] = np.eye(a)
    scaled = T.matrix[slot] * h
    for k in range(1, ORDER + 1):
        powers[k] = (scaled @ powers[k - 1]) / k
    growth = T.growth[slot]
    growth[finest] = 0.0
    for k in range(ORDER, 0, -1):
        growth[finest] += powers[k]
    for level in range(finest, 0, -1):
        growth[level - 1] = 2.0 * growth[level] + growth[level] @ growth[level]
    if T.gramian.shape[1] == 0:
        return
    gramian = T.gramian[slot]
    gramian[: finest + 1] = 0.0
    # The energy of the finest step by Gauss-Legendre quadrature of polynomials: exact to rounding; then doubled.
    for q in range(len(NODES)):
        exponential = np.zeros((a, a))
        for k in range(ORDER, -1, -1):
            exponential = exponential * NODES[q] + powers[k]
        for p in range(T.products.shape[1]):
            category = pg.HYSTERESIS
            weight = WEIGHTS[q] * h
            if p < P.product_category.shape[1]:
                category = P.product_category[configuration, p]
                weight *= P.product_coefficient[configuration, p]
            if category >= 0:
                first, second = T.products[slot, p, 0] @ exponential, T.products[slot, p, 1] @ exponential
                gramian[finest, category] += weight * np.outer(first, second)
    for level in range(finest, 0, -1):
        whole = growth[level] + np.eye(a)
        for e in range(gramian.shape[1]):
            gramian[level - 1, e] = gramian[level, e] + whole.T @ (gramian[level, e] @ whole)
