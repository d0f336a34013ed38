"""Matrix exponentials of a mode on dyadic steps, and what a step means for its energies and its guards."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine.clamp import held_form, hold
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.tables import (
    DEVIATION,
    FINEST_LEVEL,
    FORMS,
    GLIDE,
    GLIDE_ROWS,
    GRAMIAN,
    GROWTH,
    LADDERS,
    LEDGER,
    LEVELS,
    MATRIX,
    ORDER,
    OUTPUT_ROWS,
    OUTPUTS,
    POWERS,
    PRODUCTS,
    SCRATCH,
    STEPS,
    TERMS,
    VALUES,
    block_of,
    rungs_of,
    slot_of,
)
from piezoharvest.engine.vector import accumulate, copy, dot, grow, multiply, polynomial

# |A| h on the finest level: a Taylor series over half of that is short.
FINEST = 1.0 / 16.0
BOLD = 5  # levels above the finest on which a motion begins: |A| h is 2, and every motion of the mode is followed
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS


@compiled
def exponentials(P, L, slot, configuration, longest):
    """exp(A h) - 1 on the finest level by its Taylor series, then doubled up to the longest step."""
    a, rows, columns, block = L[pg.A], L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    matrix, square, powers = block + L[MATRIX], rows * columns, L[SCRATCH]
    norm = 0.0
    for i in range(a):
        total = 0.0
        for j in range(a):
            total += abs(P[matrix + j * rows + i])
        norm = max(norm, total)
    finest, h = 0, longest
    P[block + L[STEPS]] = h
    while norm * h > FINEST and finest < LEVELS - 1:
        finest += 1
        h *= 0.5
        P[block + L[STEPS] + finest] = h
    L[slot_of(L, slot) + FINEST_LEVEL] = finest
    growth = block + L[GROWTH] + finest * square
    for k in range(square):
        P[powers + k] = 0.0
    for j in range(a):
        P[powers + j * rows + j] = 1.0
    for k in range(1, ORDER + 1):
        before, here = powers + (k - 1) * square, powers + k * square
        for j in range(a):
            multiply(P, matrix, rows, columns, P, before + j * rows, here + j * rows)
        for j in range(a * rows):
            P[here + j] *= h / k
        for j in range(a * rows, square):
            P[here + j] = 0.0
    for j in range(columns):
        for k in range(TERMS):
            copy(P, powers + (k + 1) * square + j * rows, block + L[POWERS] + (j * TERMS + k) * rows, rows)
    copy(P, powers + ORDER * square, growth, square)
    for k in range(ORDER - 1, 0, -1):
        accumulate(P, powers + k * square, 1.0, growth, square)
    held = powers + (ORDER + 2) * square
    holds = held_form(P, L, slot, configuration, held)
    for _ in range(finest):
        coarser = growth - square
        for j in range(a):
            # (1 + G)^2 - 1 = G + (1 + G) G
            grow(P, growth, rows, columns, P, growth + j * rows, coarser + j * rows)
        for j in range(a * rows, square):
            P[coarser + j] = 0.0
        accumulate(P, growth, 1.0, coarser, square)
        if holds:
            hold(P, L, coarser, held)
        growth = coarser


@compiled
def energies_of_steps(P, L, slot, configuration):
    """Energies of a step as quadratic forms of the state at its beginning, on every level.

    On the finest level by Gauss-Legendre quadrature of polynomials, exact to rounding; then doubled:
    the form of a double step is Q + (1 + G)' Q (1 + G).
    """
    a, rows, columns, block = L[pg.A], L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    finest, square, powers = L[slot_of(L, slot) + FINEST_LEVEL], rows * columns, L[SCRATCH]
    energies, own = L[LEDGER], L[pg.PRODUCTS]
    gramian = block + L[GRAMIAN] + finest * energies * square
    transposed = powers + (ORDER + 1) * square
    first = transposed + square
    second = first + rows
    for k in range(energies * square):
        P[gramian + k] = 0.0
    for order in range(ORDER + 1):
        _transpose(P, L, powers + order * square)
    for q in range(len(NODES)):
        polynomial(P, powers, square, ORDER, NODES[q], transposed)
        for p in range(own + L[pg.H]):
            category, weight = pg.HYSTERESIS, WEIGHTS[q] * P[block + L[STEPS] + finest]
            if p < own:
                category = L[L[pg.PRODUCT_CATEGORY] + configuration * own + p]
                weight *= P[L[pg.PRODUCT_COEFFICIENT] + configuration * own + p]
            if category < 0 or weight == 0.0:
                continue
            product = block + L[PRODUCTS] + 2 * p * rows
            multiply(P, transposed, rows, columns, P, product, first)
            multiply(P, transposed, rows, columns, P, product + rows, second)
            for j in range(a):
                accumulate(P, first, weight * P[second + j], gramian + category * square + j * rows, rows)
    for level in range(finest, 0, -1):
        gramian = block + L[GRAMIAN] + level * energies * square
        coarser = gramian - energies * square
        growth = block + L[GROWTH] + level * square
        copy(P, growth, transposed, square)
        _transpose(P, L, transposed)
        for e in range(energies):
            _double_form(P, L, gramian + e * square, coarser + e * square, growth, transposed)


@compiled
def _transpose(P, L, matrix):
    """Transpose a matrix where it stands; its padding is zero."""
    rows = L[pg.ROWS]
    for j in range(L[pg.A]):
        for i in range(j):
            P[matrix + j * rows + i], P[matrix + i * rows + j] = P[matrix + i * rows + j], P[matrix + j * rows + i]


@compiled
def _double_form(P, L, form, double, growth, transposed):
    """Double = Q + (1 + G)' Q (1 + G) for a form Q."""
    rows, columns = L[pg.ROWS], L[pg.COLUMNS]
    copy(P, form, double, rows * columns)
    if dot(P, form, P, form, rows * columns) == 0.0:
        return
    turned, out = transposed + rows * columns, transposed + rows * columns + rows
    for j in range(L[pg.A]):
        # Q (1 + G), a column at a time
        multiply(P, form, rows, columns, P, growth + j * rows, turned)
        accumulate(P, form + j * rows, 1.0, turned, rows)
        grow(P, transposed, rows, columns, P, turned, out)
        accumulate(P, out, 1.0, double + j * rows, rows)


@compiled
def deviations(P, L, slot):
    """How far within a longest step a guard may be from the straight line between its ends.

    As forms of the state at the ends of all dyadic steps, a ladder for each guard, and as bounds for a unit of each
    state: twice what the ladder shows, for a transient may be higher between two of its rungs.
    """
    a, forms, rows, columns = L[pg.A], L[FORMS], L[pg.ROWS], L[pg.COLUMNS]
    block, square, finest = block_of(L, slot), rows * columns, L[slot_of(L, slot) + FINEST_LEVEL]
    values, deviation, growth = block + L[VALUES], block + L[DEVIATION], block + L[GROWTH]
    scratch, rungs = L[SCRATCH], rungs_of(finest)
    for k in range(forms * columns):
        P[deviation + k] = 0.0
    for k in range(forms * rungs * columns):
        P[block + L[LADDERS] + k] = 0.0
    for level in range(1, finest + 1):
        share = P[block + L[STEPS] + level] / P[block + L[STEPS]]
        for j in range(a):
            for k in range(rows):
                P[scratch + k] = P[growth + level * square + j * rows + k] - share * P[growth + j * rows + k]
            multiply(P, values, forms, columns, P, scratch, scratch + rows)
            for r in range(forms):
                off = P[scratch + rows + r]
                P[block + L[LADDERS] + (r * columns + j) * rungs + level - 1] = off
                P[deviation + j * forms + r] = max(P[deviation + j * forms + r], 2.0 * abs(off))


@compiled
def glides(P, L, slot):
    """What a longest step leads to, as one matrix over the state: growth, guards before and after, outputs after."""
    a, rows, columns, forms, block = L[pg.A], L[pg.ROWS], L[pg.COLUMNS], L[FORMS], block_of(L, slot)
    growth, values, outputs, height = block + L[GROWTH], block + L[VALUES], block + L[OUTPUTS], L[GLIDE_ROWS]
    for j in range(columns):
        here, column = block + L[GLIDE] + j * height, growth + j * rows
        copy(P, column, here, rows)
        now = here + rows
        copy(P, values + j * forms, now, forms)
        if j < a:
            multiply(P, values, forms, columns, P, column, now + forms)
            multiply(P, outputs, OUTPUT_ROWS, columns, P, column, now + 2 * forms)
        for r in range(forms):
            P[now + forms + r] = P[now + r] + P[now + forms + r] if j < a else 0.0
        for r in range(OUTPUT_ROWS):
            after = now + 2 * forms + r
            P[after] = P[outputs + j * OUTPUT_ROWS + r] + P[after] if j < a else 0.0
