"""Motion of the sensitivities: derivatives of the state, which the motion within a mode takes along."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.tables import block_of, slot_of
from piezoharvest.engine.memory.vector import GROUP, add_all, combine, copy, grow_all, multiply_all
from piezoharvest.engine.motion.exact_step import CLOCK_ROUNDING, series_factors, trailing_zeros
from piezoharvest.engine.work_limit import spend_products


@compiled
def propagate_sensitivities(P, L, S, D, slot, tau):
    """Propagate all sensitivities over 0 <= tau < twice the longest step: to the nearest finest step, then a fraction.

    As `propagate_exactly` does with a state, but with all of them in each product.
    """
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    finest, count = L[slot_of(L, slot) + tb.FINEST_LEVEL], -(-D[st.SENSITIVITIES] // GROUP) * GROUP
    square, short = rows * columns, P[block + L[tb.STEPS] + finest]
    growth, here = block + L[tb.GROWTH] + finest * square, D[st.PHI]
    there = here + count * rows
    steps = min(max(int(tau / short + 0.5), 0), (2 << finest) - 1)
    rest = tau - steps * short
    while steps:
        spend_products(L, count)
        grow_all(P, growth - trailing_zeros(steps) * square, rows, columns, S, here, count, there)
        here, there = there, here
        steps &= steps - 1
    if here != D[st.PHI]:
        copy(S, here, D[st.PHI], count * rows)
    if abs(rest) > CLOCK_ROUNDING * S[D[st.CLOCK]]:
        _propagate_fraction(P, L, S, D, slot, rest / short, count)


@compiled
def _propagate_fraction(P, L, S, D, slot, share, count):
    """Propagate all sensitivities by a fraction of the finest step: the series of `exact_step.propagate_fraction`."""
    rows, columns, phi, size = L[pg.ROWS], L[pg.COLUMNS], D[st.PHI], count * L[pg.ROWS]
    powers, stride, behind = block_of(L, slot) + L[tb.POWERS], tb.TERMS * rows, phi + 4 * size
    spend_products(L, 4 * count)
    for term in range(3):
        multiply_all(P, powers + term * rows, stride, rows, columns, S, phi, count, phi + (term + 1) * size)
    later, sooner = series_factors(share)
    combine(S, phi, size, later, behind)
    combine(S, phi, size, sooner, phi)
    add_all(P, powers + 3 * rows, stride, rows, columns, S, behind, count, phi)
