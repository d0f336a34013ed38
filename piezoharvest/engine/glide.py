"""Longest steps on which no guard can rise: what most samples of a record are."""

from __future__ import annotations

from piezoharvest.engine import program as pg
from piezoharvest.engine import state as st
from piezoharvest.engine import tables as tb
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.motion import ARRIVED, TRIAL
from piezoharvest.engine.recording import SAME_TIME, account, observe
from piezoharvest.engine.state import vector
from piezoharvest.engine.tables import block_of, slot_of
from piezoharvest.engine.vector import copy, multiply


@compiled
def glide(P, L, S, D, slot):
    """Make one longest step if no guard comes near zero on it; returns whether it was made.

    This is what most samples of a record are: one product of a matrix with the state for where it leads, for the guards
    at both ends and for the outputs, so that nothing waits for the state that is arrived at; and no look at rates.
    """
    rows, forms, glided, clock = L[pg.ROWS], L[tb.FORMS], D[st.GLIDED], D[st.CLOCK]
    multiply(P, block_of(L, slot) + L[tb.GLIDE], L[tb.GLIDE_ROWS], L[pg.COLUMNS], S, 0, glided)
    now = glided + rows
    if not _far(P, L, S, D, slot, now, now + forms):
        return False
    step = P[block_of(L, slot) + L[tb.STEPS]]
    if D[st.TRACKED] > 0 or D[st.ENERGIES] > 0 or D[st.SENSITIVITIES] > 0:
        _record(P, L, S, D, slot, step)
    elif D[st.SAMPLED] < D[st.SAMPLES_WANTED]:
        _sample(P, L, S, D, slot, step)
    for i in range(rows):
        S[i] += S[glided + i]
    S[clock] += step
    return True


@compiled
def _sample(P, L, S, D, slot, step):
    """Keep the outputs at the end of a step, if these are all that is wanted within it."""
    k, times, end = D[st.SAMPLED], D[st.SAMPLE_TIME], S[D[st.CLOCK]] + step
    early = end - S[times + k]
    if early < -SAME_TIME * step:
        return
    if early > SAME_TIME * step or (k + 1 < D[st.SAMPLES_WANTED] and S[times + k + 1] <= end):
        _record(P, L, S, D, slot, step)
        return
    outputs = D[st.GLIDED] + L[pg.ROWS] + 2 * L[tb.FORMS]
    copy(S, outputs, D[st.SAMPLES] + k * len(pg.OUTPUTS), tb.OUTPUT_ROWS)
    D[st.SAMPLED] += 1


@compiled
def _record(P, L, S, D, slot, step):
    """Record a longest step in full."""
    arrived = vector(L, D, ARRIVED)
    for i in range(L[pg.ROWS]):
        S[arrived + i] = S[i] + S[D[st.GLIDED] + i]
    observe(P, L, S, D, slot, step, S[D[st.CLOCK]] + step, arrived)
    account(P, L, S, D, slot, step, 0)


@compiled
def _far(P, L, S, D, slot, now, then):
    """Whether no guard can have come near zero within a longest step, by the bounds of its deviation from a line.

    The values at both ends stand at `now` and `then`.
    """
    at, forms, rows = slot_of(L, slot), L[tb.FORMS], L[pg.ROWS]
    size, bound = vector(L, D, TRIAL), D[st.THERE_GUARDS]
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
