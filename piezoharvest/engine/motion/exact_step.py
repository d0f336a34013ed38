"""Exact motion within one linear mode: exp(A t) applied to a vector, from the tables of dyadic steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.cpython.unsafe import numbers

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.state import vector
from piezoharvest.engine.memory.tables import block_of, slot_of
from piezoharvest.engine.memory.vector import add_product, combine, copy, grow, multiply, multiply_top
from piezoharvest.engine.work_limit import products

trailing_zeros: Any = numbers.trailing_zeros  # its callers leave the context out, which type checkers do not know

# Scratch vectors, by who uses them; the terms of a series stand one after the other.
ARRIVED, FOUND, TRIAL, SAMPLE, KEPT, FLOW, SWAP, SERIES = range(8)

NEAR = 5 / 8  # finest steps


@compiled
def reach(P, L, S, D, slot, x, tau):
    """The finest steps that make up tau, to the nearest: state there, as the first of SERIES; returns what is left.

    Taken as digits of their number, each a product with a table: binary ones, or longer ones where there are tables of
    these, as each product waits for the one before.
    """
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    finest, out, square = L[slot_of(L, slot) + tb.FINEST_LEVEL], vector(L, D, SERIES), rows * columns
    growth, tables = block + L[tb.GROWTH] + finest * square, block + L[tb.DIGITS]
    short = P[block + L[tb.STEPS] + finest]
    source, here, there = x, out, vector(L, D, SWAP)
    # By rounding a time may lie before the step, and digits of a negative number are beyond the tables.
    count = min(max(int(tau / short + 0.5), 0), (2 << finest) - 1) if abs(tau) < np.inf else 0
    rest = tau - count * short
    products(L, 4)
    while count:
        if L[pg.SIGNAL_KIND] == pg.RAMPS:
            place = trailing_zeros(count) // tb.BITS
            digit = (count >> tb.BITS * place) & tb.LARGEST
            table, count = tables + (tb.LARGEST * place + digit - 1) * square, count - (digit << tb.BITS * place)
        else:
            table, count = growth - trailing_zeros(count) * square, count & (count - 1)
        grow(P, table, rows, columns, S, source, here)
        source = here
        here, there = there, here
    if source != out:
        copy(S, source, out, rows)
    return rest


@compiled
def expand(P, L, S, D, slot):
    """Terms of the Taylor series of the motion from the first of SERIES on, for time in finest steps.

    One product with all powers of the mode's matrix, so that no term waits for the one before.
    """
    z, rows = vector(L, D, SERIES), L[pg.ROWS]
    multiply(P, block_of(L, slot) + L[tb.POWERS], tb.TERMS * rows, L[pg.COLUMNS], S, z, z + rows)


@compiled
def drift(P, L, S, D, slot, share, out):
    """Out = the first of SERIES moved on by a share of the finest step, up to NEAR of it forwards or back.

    The Taylor series to the order 7: four terms and, behind the fourth power of the mode's matrix, four more. Half as
    many products as in `expand`, and what is left out is below 1e-16.
    """
    z, rows, columns = vector(L, D, SERIES), L[pg.ROWS], L[pg.COLUMNS]
    powers, stride, second, behind = block_of(L, slot) + L[tb.POWERS], tb.TERMS * rows, share * share, z + 4 * rows
    multiply_top(P, powers, stride, 3 * rows, columns, S, z, z + rows)
    third = second * share
    # The k-th term of the latter is that of the former times 4! k! / (k + 4)!; the matrix holds 1/4! already.
    fourth = second * second
    combine(S, z, rows, (fourth, fourth * share / 5.0, fourth * second / 15.0, fourth * third / 35.0), behind)
    combine(S, z, rows, (1.0, share, second, third), out)
    add_product(P, powers + 3 * rows, stride, rows, columns, S, behind, out)


@compiled
def exact(P, L, S, D, slot, x, tau, out):
    """Out = exp(A tau) x for any 0 <= tau <= longest step: to the nearest finest step, and forwards or back from it."""
    short = P[block_of(L, slot) + L[tb.STEPS] + L[slot_of(L, slot) + tb.FINEST_LEVEL]]
    drift(P, L, S, D, slot, reach(P, L, S, D, slot, x, tau) / short, out)
