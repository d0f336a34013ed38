"""Exact motion within one linear mode: exp(A t) applied to a vector, from the tables of dyadic steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.cpython.unsafe import numbers

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.state import vector
from piezoharvest.engine.memory.tables import block_of, slot_of
from piezoharvest.engine.memory.vector import add_product, combine, copy, grow, multiply, multiply_top
from piezoharvest.engine.work_limit import spend_products

trailing_zeros: Any = numbers.trailing_zeros  # callers omit the context argument, which type checkers do not know

# Scratch vectors, by use; the terms of a series stand one after the other.
ARRIVED, FOUND, TRIAL, SAMPLE, SAVED, FLOW, SWAP, SERIES = range(8)

MAX_FRACTION = 5 / 8  # finest steps
CLOCK_ROUNDING = 1e-15  # of the time now: what a few sums of times are wrong by


@compiled
def propagate_finest_steps(P, L, S, D, slot, x, tau):
    """Propagate over tau rounded to finest steps: the state becomes the first of SERIES; returns the remaining time.

    The number of steps is written in digits, each a product with a table: binary ones, or longer ones if their tables
    exist, as the products are sequential.
    """
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    finest, out, square = L[slot_of(L, slot) + tb.FINEST_LEVEL], vector(L, D, SERIES), rows * columns
    growth, tables = block + L[tb.GROWTH] + finest * square, block + L[tb.DIGITS]
    short = P[block + L[tb.STEPS] + finest]
    source, here, there = x, out, vector(L, D, SWAP)
    # By rounding a time may lie before the step; digits of a negative number would be outside the tables.
    count = min(max(int(tau / short + 0.5), 0), (2 << finest) - 1) if abs(tau) < np.inf else 0
    rest = tau - count * short
    spend_products(L, 4)
    while count:
        if L[pg.SIGNAL_KIND] == pg.RAMPS:
            place = trailing_zeros(count) // tb.DIGIT_BITS
            digit = (count >> tb.DIGIT_BITS * place) & tb.LARGEST
            table, count = tables + (tb.LARGEST * place + digit - 1) * square, count - (digit << tb.DIGIT_BITS * place)
        else:
            table, count = growth - trailing_zeros(count) * square, count & (count - 1)
        grow(P, table, rows, columns, S, source, here)
        source = here
        here, there = there, here
    if source != out:
        copy(S, source, out, rows)
    return rest


@compiled
def taylor_terms(P, L, S, D, slot):
    """Taylor terms of the motion from the first of SERIES, for time in finest steps.

    One product with all powers of the mode's matrix, so that the terms are independent.
    """
    z, rows = vector(L, D, SERIES), L[pg.ROWS]
    multiply(P, block_of(L, slot) + L[tb.POWERS], tb.TERMS * rows, L[pg.COLUMNS], S, z, z + rows)


@inlined
def series_factors(share):
    """Factors of the terms of a series behind the fourth power of the mode's matrix, and of those before it.

    The k-th term of the former is that of the latter times 4! k! / (k + 4)!; the matrix holds 1/4! already.
    """
    second = share * share
    third, fourth = second * share, second * second
    later = fourth, fourth * share / 5.0, fourth * second / 15.0, fourth * third / 35.0
    return later, (1.0, share, second, third)


@compiled
def propagate_fraction(P, L, S, D, slot, share, out):
    """Out = the first of SERIES propagated by a fraction of the finest step, up to NEAR forwards or backwards.

    The Taylor series to the order 7: four terms and, behind the fourth power of the mode's matrix, four more. Half as
    many products as in `taylor_terms`, and the remainder is below 1e-16.
    """
    z, rows, columns = vector(L, D, SERIES), L[pg.ROWS], L[pg.COLUMNS]
    powers, stride, behind = block_of(L, slot) + L[tb.POWERS], tb.TERMS * rows, z + 4 * rows
    multiply_top(P, powers, stride, 3 * rows, columns, S, z, z + rows)
    later, sooner = series_factors(share)
    combine(S, z, rows, later, behind)
    combine(S, z, rows, sooner, out)
    add_product(P, powers + 3 * rows, stride, rows, columns, S, behind, out)


@compiled
def propagate_exactly(P, L, S, D, slot, x, tau, out):
    """Out = exp(A tau) x for any 0 <= tau <= longest step: to the nearest finest step, then forwards or backwards.

    What is as short as the rounding of the clock is left out: a stage of a switch is a whole number of finest steps.
    """
    short = P[block_of(L, slot) + L[tb.STEPS] + L[slot_of(L, slot) + tb.FINEST_LEVEL]]
    rest = propagate_finest_steps(P, L, S, D, slot, x, tau)
    if abs(rest) <= CLOCK_ROUNDING * S[D[st.CLOCK]]:
        copy(S, vector(L, D, SERIES), out, L[pg.ROWS])
    else:
        propagate_fraction(P, L, S, D, slot, rest / short, out)
