"""Sizes of the terms of a form, of its rate and of its second rate, of which rounding errors and zeros are shares."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory.vector import total_size


@compiled
def term_sizes(L, S):
    """Sums of the absolute values of what values, rates, and second rates of forms are made of, in the present state.

    The derivatives of a smooth element's output count from the rate on that has them: those of a curve that bends fast
    are many times as large as the output itself.
    """
    first = L[pg.N]
    last = first + pg.DERIVATIVES * L[pg.ELEMENTS]
    if first == last:
        size = total_size(S, 0, L[pg.ROWS])
        return size, size, size
    size, slopes, bends = 0.0, 0.0, 0.0
    for i in range(L[pg.ROWS]):
        if not first <= i < last:
            size += abs(S[i])
    for place in range(first, last, pg.DERIVATIVES):
        size, slopes, bends = size + abs(S[place]), slopes + abs(S[place + 1]), bends + abs(S[place + 2])
    return size, size + slopes, size + slopes + bends
