"""Longest steps on which no guard can rise: what most samples of a record are."""

from __future__ import annotations

from piezoharvest.engine import program as pg
from piezoharvest.engine import state as st
from piezoharvest.engine import tables as tb
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.motion import ARRIVED, TERM
from piezoharvest.engine.recording import account, observe
from piezoharvest.engine.state import vector
from piezoharvest.engine.tables import block_of, slot_of
from piezoharvest.engine.vector import copy, grow, multiply


@compiled
def glide(P, L, S, D, slot):
    """Make one longest step if no guard comes near zero on it; returns whether it was made.

    This is what most samples of a record are: four products of a matrix with a vector, and no look at rates.
    """
    rows, columns, block, forms = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot), L[tb.FORMS]
    now, then, arrived = D[st.NOW_GUARDS], D[st.THEN_GUARDS], vector(L, D, ARRIVED)
    multiply(P, block + L[tb.VALUES], forms, columns, S, 0, now)
    grow(P, block + L[tb.GROWTH], rows, columns, S, 0, arrived)
    multiply(P, block + L[tb.VALUES], forms, columns, S, arrived, then)
    if not _far(P, L, S, D, slot, now, then):
        return False
    step = P[block + L[tb.STEPS]]
    if D[st.SAMPLES_WANTED] > 0 or D[st.TRACKED] > 0:
        observe(P, L, S, D, slot, step, arrived)
    if D[st.ENERGIES] > 0 or D[st.SENSITIVITIES] > 0:
        account(P, L, S, D, slot, step, 0)
    copy(S, arrived, 0, rows)
    S[D[st.CLOCK]] += step
    return True


@compiled
def _far(P, L, S, D, slot, now, then):
    """Whether no guard can have come near zero within a longest step, by the bounds of its deviation from a line.

    The values at both ends stand at `now` and `then`; what the bounds allow is left behind the latter.
    """
    at, forms, rows = slot_of(L, slot), L[tb.FORMS], L[pg.ROWS]
    size, bound = vector(L, D, TERM), then + forms
    for i in range(rows):
        S[size + i] = abs(S[i])
    multiply(P, block_of(L, slot) + L[tb.DEVIATION], forms, L[pg.COLUMNS], S, size, bound)
    count, signs, offsets = L[at + tb.GUARD_COUNT], D[st.SIGN], D[st.OFFSET]
    for g in range(count - pg.WATCHED):
        row, sign = L[at + tb.FIRST_GUARD + 2 * g + 1], S[signs + g]
        highest = max(sign * S[now + row], sign * S[then + row]) + S[offsets + g]
        if not highest + S[bound + row] < 0.0 and not highest + _deviation(P, L, S, D, slot, row) < 0.0:
            return False
    if D[st.TRACKED]:
        for g in range(count - pg.WATCHED, count):
            row = L[at + tb.FIRST_GUARD + 2 * g + 1]
            f0, f1 = S[now + row], S[then + row]
            if not f0 * f1 > 0.0:
                return False
            nearest = min(abs(f0), abs(f1))
            if not nearest > S[bound + row] and not nearest > _deviation(P, L, S, D, slot, row):
                return False
    return True


@compiled
def _deviation(P, L, S, D, slot, row):
    """How far a guard goes from the straight line between its ends within a longest step from the state now.

    Sharper than the bound, in which a displacement and the force that holds it there do not cancel.
    """
    rungs, columns, ladder = tb.rungs_of(L[slot_of(L, slot) + tb.FINEST_LEVEL]), L[pg.COLUMNS], D[st.LADDER]
    multiply(P, block_of(L, slot) + L[tb.LADDERS] + row * columns * rungs, rungs, columns, S, 0, ladder)
    largest = 0.0
    for k in range(rungs):
        largest = max(largest, abs(S[ladder + k]))
    return 2.0 * largest
