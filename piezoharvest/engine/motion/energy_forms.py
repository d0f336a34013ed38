"""Energies of a step of a mode, as quadratic forms of the state at its beginning."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.tables import LEVELS, block_of, slot_of
from piezoharvest.engine.memory.vector import accumulate, copy, dot, grow_all, multiply, multiply_all, polynomial
from piezoharvest.engine.work_limit import spend_products

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(tb.NODE_COUNT)
NODES, WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS


@compiled
def energies_of_steps(P, L, slot, configuration):
    """Energies of a step as quadratic forms of the state at its beginning, on every level.

    On the finest level by Gauss-Legendre quadrature of polynomials, exact to rounding; then doubled: the form of a
    double step is Q + (1 + G)' Q (1 + G). Computed when first needed: a search also uses modes without energies.
    Returns bits: the first one is set, and those of the energies that are not zero in this mode (see `bit_of_energy`).
    """
    a, rows, columns, block = L[pg.A], L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    finest, square, powers = L[slot_of(L, slot) + tb.FINEST_LEVEL], rows * columns, L[tb.SCRATCH]
    energies, own = L[tb.LEDGER], L[pg.PRODUCTS]
    spend_products(L, 2 * energies * finest * a)
    gramian = block + L[tb.GRAMIAN] + finest * energies * square
    transposed = powers + (tb.TERMS + 1) * square
    first = transposed + square
    second = first + rows
    for k in range(energies * square):
        P[gramian + k] = 0.0
    _transposed_powers(P, L, block + L[tb.POWERS], powers)
    for q in range(len(NODES)):
        polynomial(P, powers, square, tb.TERMS, NODES[q], transposed)
        for p in range(own + L[pg.H]):
            category, weight = pg.HYSTERESIS, WEIGHTS[q] * P[block + L[tb.STEPS] + finest]
            if p < own:
                category = L[L[pg.PRODUCT_CATEGORY] + configuration * own + p]
                weight *= P[L[pg.PRODUCT_COEFFICIENT] + configuration * own + p]
            if category < 0 or weight == 0.0:
                continue
            product = block + L[tb.PRODUCTS] + 2 * p * rows
            multiply(P, transposed, rows, columns, P, product, first)
            multiply(P, transposed, rows, columns, P, product + rows, second)
            for j in range(a):
                accumulate(P, first, weight * P[second + j], gramian + category * square + j * rows, rows)
    for level in range(finest, 0, -1):
        gramian = block + L[tb.GRAMIAN] + level * energies * square
        coarser = gramian - energies * square
        growth = block + L[tb.GROWTH] + level * square
        for j in range(a):
            for i in range(a):
                P[transposed + i * rows + j] = P[growth + j * rows + i]
        for e in range(energies):
            _double_form(P, L, gramian + e * square, coarser + e * square, growth, transposed)
    _factors_by_columns(P, L, slot)
    bits, gramian = 1, block + L[tb.GRAMIAN] + finest * energies * square
    for e in range(energies):
        if dot(P, gramian + e * square, P, gramian + e * square, square) > 0.0:
            bits |= bit_of_energy(e)
    return bits


@compiled
def _factors_by_columns(P, L, slot):
    """The factors of all powers once more, as a matrix by columns: all first ones, then all second ones.

    None are tabulated at nodes yet.
    """
    block, rows, height, at = block_of(L, slot), L[pg.ROWS], L[tb.FACTOR_ROWS], slot_of(L, slot)
    products, columns = block + L[tb.PRODUCTS], block + L[tb.FACTOR_COLUMNS]
    for k in range(L[pg.COLUMNS] * height):
        P[columns + k] = 0.0
    for p in range(L[pg.PRODUCTS] + L[pg.H]):
        for side in range(2):
            for j in range(L[pg.A]):
                P[columns + j * height + side * height // 2 + p] = P[products + (2 * p + side) * rows + j]
    L[at + tb.NODE_SETS] = 0
    for level in range(LEVELS):
        L[at + tb.NODE_USES + level] = 0


@inlined
def bit_of_energy(e):
    """Bit of an energy in a mode's flags; beyond the number of bits several share one."""
    return 2 << min(e, 60)


@compiled
def _transposed_powers(P, L, powers, out):
    """Taylor terms of the finest step as matrices one after the other, each transposed, the unit matrix first."""
    a, rows, square = L[pg.A], L[pg.ROWS], L[pg.ROWS] * L[pg.COLUMNS]
    for k in range((tb.TERMS + 1) * square):
        P[out + k] = 0.0
    for j in range(a):
        P[out + j * rows + j] = 1.0
        for k in range(tb.TERMS):
            for i in range(a):
                P[out + (k + 1) * square + i * rows + j] = P[powers + (j * tb.TERMS + k) * rows + i]


@compiled
def _double_form(P, L, form, double, growth, transposed):
    """Double = Q + (1 + G)' Q (1 + G) for a form Q."""
    rows, columns = L[pg.ROWS], L[pg.COLUMNS]
    copy(P, form, double, rows * columns)
    if dot(P, form, P, form, rows * columns) == 0.0:
        return
    turned, out = transposed + rows * columns, transposed + 2 * rows * columns
    multiply_all(P, form, rows, rows, columns, P, growth, columns, turned)
    accumulate(P, form, 1.0, turned, rows * columns)  # Q (1 + G)
    grow_all(P, transposed, rows, columns, P, turned, columns, out)
    accumulate(P, out, 1.0, double, rows * columns)
