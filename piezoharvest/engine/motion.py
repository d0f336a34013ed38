"""Exact motion within one linear mode: exp(A t) applied to a vector, from the tables of dyadic steps."""

from __future__ import annotations

from piezoharvest.engine import program as pg
from piezoharvest.engine import tables as tb
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.exponentials import FINEST
from piezoharvest.engine.state import vector
from piezoharvest.engine.tables import ORDER, block_of, slot_of
from piezoharvest.engine.vector import add_term, copy, grow

# Scratch vectors, by who uses them.
ARRIVED, FOUND, TRIAL, SAMPLE, KEPT, FLOW, TERM, SWAP = 0, 1, 2, 3, 4, 5, 6, 8


@compiled
def taylor(P, L, S, D, block, z, tau, share):
    """Advance the vector at z in place by tau, no longer than the finest level; `share` is tau over it."""
    rows, columns, matrix = L[pg.ROWS], L[pg.COLUMNS], block + L[tb.MATRIX]
    source, target = z, vector(L, D, TERM)
    other = target + rows
    bound = 1.0
    for k in range(1, ORDER + 2):
        # |A tau|^k / k! bounds this term.
        bound *= FINEST * abs(share) / k
        if bound < 1e-17:
            break
        if k == 1:
            # The vector grows while its own product is formed, so that it is read from a copy.
            copy(S, z, other, rows)
            source = other
        add_term(P, matrix, rows, columns, tau / k, S, source, target, z)
        source, target = target, source


@compiled
def exact(P, L, S, D, slot, x, tau, out):
    """Out = exp(A tau) x for any 0 <= tau <= longest step: binary digits of tau, then a Taylor series.

    The digits are rounded to the nearest finest step, so that the series spans half of one, forwards or back.
    """
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    growth, steps, finest = block + L[tb.GROWTH], block + L[tb.STEPS], L[slot_of(L, slot) + tb.FINEST_LEVEL]
    short = P[steps + finest]
    source, rest = x, tau
    here, there = out, vector(L, D, SWAP)
    for level in range(finest + 1):
        h = P[steps + level]
        if rest >= (h if level < finest else 0.5 * h):
            grow(P, growth + level * rows * columns, rows, columns, S, source, here)
            rest -= h
            source = here
            here, there = there, here
    if source != out:
        copy(S, source, out, rows)
    if rest != 0.0:
        taylor(P, L, S, D, block, out, rest, rest / short)
