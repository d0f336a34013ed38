"""Sizes of the terms of a form, of its rate and of its second rate, of which rounding errors and zeros are shares."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.tables import block_of, slot_of
from piezoharvest.engine.memory.vector import total_size

STRONG_SHARE = 1e-3  # a constant with less of the largest coefficient counts with this share only


@compiled
def constant_share(P, L, slot):
    """Share with which the constant counts in the sizes of a mode's terms: its coefficients over the largest beside.

    The constant has the scale of diode drops. The motion, and a static load, may be any number of decades smaller: with
    open electrodes, where no drop acts, rounding is not that of a drop.
    """
    last, block, rows = L[pg.A] - 1, block_of(L, slot), L[pg.ROWS]
    if last != L[pg.SIGNAL] + 2 * max(L[pg.TONE_COUNT], 1):
        return 1.0
    held, forms = L[slot_of(L, slot) + tb.CLAMPED_FORM], 3 * L[tb.FORMS]
    share, own, largest = 0.0, 0.0, 0.0
    for i in range(L[pg.N]):
        for j in range(L[pg.A]):
            largest = max(largest, abs(P[block + L[tb.MATRIX] + j * rows + i]))
        own = max(own, abs(P[block + L[tb.MATRIX] + last * rows + i]))
    if own > 0.0:
        share = own / largest
    for row in range(forms):
        share = max(share, _share_of_last(P, block + L[tb.GUARDS] + row, forms, last))
    if held != NONE:
        share = max(share, _share_of_last(P, held, 1, last))
    return share if share < STRONG_SHARE else 1.0


@compiled
def _share_of_last(P, at, stride, last):
    """Last coefficient of a form over its largest one."""
    largest = 0.0
    for j in range(last + 1):
        largest = max(largest, abs(P[at + j * stride]))
    return abs(P[at + last * stride]) / largest if largest > 0.0 else 0.0


@compiled
def bound_by_clamp(P, L, slot):
    """Lower the sizes of guards by what conducting diodes hold at zero, any multiple of which may be added to a form.

    The voltage of a small smoothing capacitor has a small weight in the state and a large coefficient, but it cannot be
    larger than the other terms of the form that is held.
    """
    held, forms, a = L[slot_of(L, slot) + tb.CLAMPED_FORM], 3 * L[tb.FORMS], L[pg.A]
    block = block_of(L, slot)
    for row in range(forms if held != NONE else 0):
        at, first = block + L[tb.GUARDS] + row, 0
        for j in range(1, a):
            if abs(P[at + j * forms]) > abs(P[at + first * forms]):
                first = j
        if P[held + first] != 0.0:
            factor, largest = P[at + first * forms] / P[held + first], 0.0
            for j in range(a):
                if j != first:
                    largest = max(largest, abs(P[at + j * forms] - factor * P[held + j]))
            size = block + L[tb.SIZES] + row
            P[size] = min(P[size], largest)


@compiled
def term_sizes(P, L, S, slot):
    """Sums of the absolute values of what values, rates, and second rates of forms are made of, in the present state.

    The derivatives of a smooth element's output count from the rate on that has them: those of a curve that bends fast
    are many times as large as the output itself.
    """
    first, share = L[pg.N], P[block_of(L, slot) + L[tb.CONSTANT_SHARE]]
    last = first + pg.DERIVATIVES * L[pg.ELEMENTS]
    size, slopes, bends = 0.0, 0.0, 0.0
    if first == last and share == 1.0:
        size = total_size(S, 0, L[pg.ROWS])
        return size, size, size
    for i in range(L[pg.A] - 1):
        if not first <= i < last:
            size += abs(S[i])
    size += share * abs(S[L[pg.A] - 1])
    for place in range(first, last, pg.DERIVATIVES):
        size, slopes, bends = size + abs(S[place]), slopes + abs(S[place + 1]), bends + abs(S[place + 2])
    return size, size + slopes, size + slopes + bends
