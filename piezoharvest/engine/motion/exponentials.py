"""Matrix exponentials of a mode on dyadic steps, and the tables that give its guards over a step."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.tables import (
    CLAMPED_FORM,
    DEVIATION,
    DIGIT_BITS,
    DIGITS,
    FINEST_LEVEL,
    FORMS,
    FREE_STEP,
    FREE_STEP_ROWS,
    GROWTH,
    LARGEST,
    LEVELS,
    MATRIX,
    ORDER,
    OUTPUT_ROWS,
    OUTPUTS,
    POWERS,
    SCRATCH,
    STEPS,
    TAYLOR,
    TAYLOR_ROWS,
    TERMS,
    VALUES,
    block_of,
    slot_of,
)
from piezoharvest.engine.memory.vector import LANES, accumulate, copy, grow, grow_all, multiply, multiply_all
from piezoharvest.engine.motion.diode_clamp import clamped_form, enforce_clamp

# |A| h on the finest level: a Taylor series over half of that is short.
FINEST = 1.0 / 16.0
# Levels above the finest of a first step: |A| h is 2, so that every motion of the mode is resolved.
FIRST_STEP_LEVEL = 5


@compiled
def _norms(P, matrix, a, rows):
    """Infinity norm and 1-norm of a matrix: the largest absolute sum of a row, and of a column."""
    by_row, by_column = 0.0, 0.0
    for i in range(a):
        row, column = 0.0, 0.0
        for j in range(a):
            row += abs(P[matrix + j * rows + i])
            column += abs(P[matrix + i * rows + j])
        by_row, by_column = max(by_row, row), max(by_column, column)
    return by_row, by_column


@compiled
def exponentials(P, L, slot, configuration, longest):
    """exp(A h) - 1 on the finest level by its Taylor series, then doubled up to the longest step."""
    a, rows, columns, block = L[pg.A], L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    matrix, square, powers = block + L[MATRIX], rows * columns, L[SCRATCH]
    by_row, by_column = _norms(P, matrix, a, rows)
    # The series converges in either norm; the smaller one may save a digit in the steps through samples.
    norm = min(by_row, by_column) if L[pg.SIGNAL_KIND] == pg.RAMPS else by_row
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
        multiply_all(P, matrix, rows, rows, columns, P, before, columns, here)
        for j in range(square):
            P[here + j] *= h / k
    for j in range(columns):
        for k in range(TERMS):
            copy(P, powers + (k + 1) * square + j * rows, block + L[POWERS] + (j * TERMS + k) * rows, rows)
    _taylor(P, L, slot)
    copy(P, powers + ORDER * square, growth, square)
    for k in range(ORDER - 1, 0, -1):
        accumulate(P, powers + k * square, 1.0, growth, square)
    held = powers + (ORDER + 2) * square
    holds = clamped_form(P, L, slot, configuration, held)
    L[slot_of(L, slot) + CLAMPED_FORM] = holds
    for _ in range(finest):
        coarser = growth - square
        # (1 + G)^2 - 1 = G + (1 + G) G
        grow_all(P, growth, rows, columns, P, growth, columns, coarser)
        accumulate(P, growth, 1.0, coarser, square)
        if holds != NONE:
            enforce_clamp(P, L, coarser, held)
        growth = coarser


@compiled
def _taylor(P, L, slot):
    """Taylor series of every guard within a finest step, as forms of the initial state."""
    rows, columns, forms, block, powers = L[pg.ROWS], L[pg.COLUMNS], L[FORMS], block_of(L, slot), L[SCRATCH]
    out, found = block + L[TAYLOR], powers + (ORDER + 1) * rows * columns
    for j in range(columns):
        for k in range(TERMS + 1):
            column = powers + (k * columns + j) * rows
            multiply(P, block + L[VALUES], forms, columns, P, column, found)
            for r in range(forms):
                P[out + (r * columns + j) * TAYLOR_ROWS + k] = P[found + r]


@compiled
def digits(P, L, slot):
    """Tables of exp(A h) - 1 for every digit of a number of finest steps, from the lowest on.

    For a digit of one bit it is that of a level, for others the product of those of the highest bit and of the rest.
    """
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    square, finest, here = rows * columns, L[slot_of(L, slot) + FINEST_LEVEL], block + L[DIGITS]
    for level in range(finest, -1, -DIGIT_BITS):
        bit = 0
        for digit in range(1, LARGEST + 1):
            bit += 1 if digit >> bit > 1 else 0
            if bit > level:
                break
            growth, out = block + L[GROWTH] + (level - bit) * square, here + (digit - 1) * square
            copy(P, growth, out, square)
            rest = digit - (1 << bit)
            for j in range(columns if rest else 0):
                # (1 + G) (1 + R) - 1 = G + (1 + G) R
                grow(P, growth, rows, columns, P, here + (rest - 1) * square + j * rows, L[SCRATCH])
                accumulate(P, L[SCRATCH], 1.0, out + j * rows, rows)
        here += LARGEST * square


@compiled
def line_deviations(P, L, slot, staged):
    """Largest deviation of a guard from the straight line over a longest step, for a unit of each second derivative.

    The second derivatives are z'' = A^2 z: within a step h, z leaves the line by (B(t) - t/h B(h)) A^2 z, where B(t) is
    t^2/2 + A t^3/6 + ... Motion along a line is thereby recognised, even of a displacement beside a large force that
    keeps it constant.

    In a stage of the switch it is for a unit of each first derivative, by (B'(t) - t/h B'(h)) A z. Where capacitors
    exchange charge, the second derivative of one of them would have to count as if it moved the others for good.

    Evaluated at the ends of all dyadic steps and doubled: a transient may be higher between two of them.
    """
    forms, rows, columns, block = L[FORMS], L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    square, size, finest = rows * columns, forms * columns, L[slot_of(L, slot) + FINEST_LEVEL]
    powers, h = L[SCRATCH], P[block + L[STEPS] + finest]
    first = powers + (ORDER + 1) * square  # (exp(A t) - 1) / A
    second = first + square  # B(t)
    product = second + square
    rungs = product + square
    for k in range(first, product):
        P[k] = 0.0
    for k in range(ORDER + 1):
        accumulate(P, powers + k * square, h / (k + 1), first, square)
        accumulate(P, powers + k * square, h * h / ((k + 1) * (k + 2)), second, square)
    for level in range(finest, -1, -1):
        for j in range(columns):
            shape = (first if staged else second) + j * rows
            multiply(P, block + L[VALUES], forms, columns, P, shape, rungs + level * size + j * forms)
        for j in range(columns):
            multiply(P, first, rows, columns, P, first + j * rows, product + j * rows)
        accumulate(P, second, 1.0, second, square)
        accumulate(P, product, 1.0, second, square)
        for j in range(columns):
            multiply(P, first, rows, columns, P, block + L[GROWTH] + level * square + j * rows, product + j * rows)
        accumulate(P, first, 1.0, first, square)
        accumulate(P, product, 1.0, first, square)
    for k in range(size):
        largest = 0.0
        for level in range(1, finest + 1):
            share = P[block + L[STEPS] + level] / P[block + L[STEPS]]
            largest = max(largest, abs(P[rungs + level * size + k] - share * P[rungs + k]))
        P[block + L[DEVIATION] + k] = 2.0 * largest


@compiled
def free_step_matrix(P, L, slot, staged):
    """One matrix for a longest step: growth, derivatives before, guards before and after, outputs after.

    The derivatives are those that `line_deviations` are for. Registers of guards before and after alternate, so that
    the last ones, of watched outputs only, may be left out.
    """
    a, rows, columns, forms, block = L[pg.A], L[pg.ROWS], L[pg.COLUMNS], L[FORMS], block_of(L, slot)
    growth, values, outputs, height = block + L[GROWTH], block + L[VALUES], block + L[OUTPUTS], L[FREE_STEP_ROWS]
    matrix = block + L[MATRIX]
    for j in range(columns):
        here, column = block + L[FREE_STEP] + j * height, growth + j * rows
        copy(P, column, here, rows)
        if staged:
            copy(P, matrix + j * rows, here + rows, rows)
        else:
            multiply(P, matrix, rows, columns, P, matrix + j * rows, here + rows)
        pairs, after = here + 2 * rows, here + 2 * rows + 2 * forms
        if j < a:
            multiply(P, values, forms, columns, P, column, L[SCRATCH])
            multiply(P, outputs, OUTPUT_ROWS, columns, P, column, after)
        for r in range(forms):
            value, pair = P[values + j * forms + r], pairs + r + r // LANES * LANES
            P[pair], P[pair + LANES] = value, value + P[L[SCRATCH] + r] if j < a else 0.0
        for r in range(OUTPUT_ROWS):
            P[after + r] = P[outputs + j * OUTPUT_ROWS + r] + P[after + r] if j < a else 0.0
