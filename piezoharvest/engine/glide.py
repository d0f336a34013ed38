"""Longest steps on which no guard can rise: what most samples of a record are."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine import state as st
from piezoharvest.engine import tables as tb
from piezoharvest.engine.compiled import compiled, inlined
from piezoharvest.engine.motion import ARRIVED, TRIAL
from piezoharvest.engine.recording import SAME_TIME, account, observe
from piezoharvest.engine.state import set_ramp, vector
from piezoharvest.engine.tables import block_of, slot_of
from piezoharvest.engine.vector import between, copy, multiply, sizes


@compiled
def glide(P, L, S, D, ramps, piece, t_end):
    """Make longest steps for as long as no guard comes near zero on them, and return the piece that holds then.

    One product of a matrix with the state gives where a step leads, the guards at both its ends, the outputs and how
    much everything bends, so that nothing waits for the state that is arrived at; and there is no look at rates.
    """
    slot, glided, clock = D[st.MODE], D[st.GLIDED], D[st.CLOCK]
    rows, columns, forms, height = L[pg.ROWS], L[pg.COLUMNS], L[tb.FORMS], L[tb.GLIDE_ROWS]
    block, now, size, bound = block_of(L, slot), glided + rows, vector(L, D, TRIAL), D[st.THERE_GUARDS]
    step, bends = P[block + L[tb.STEPS]], now + 2 * forms + tb.OUTPUT_ROWS
    full = D[st.TRACKED] > 0 or D[st.ENERGIES] > 0 or D[st.SENSITIVITIES] > 0
    times, last, first = ramps[0], len(ramps[1]), piece
    while piece < last:
        ends = times[piece + 1]
        if ends > t_end or not abs(ends - S[clock] - step) <= 1e-9 * step:
            break
        hold_ramp(P, L, S, D, ramps, piece)
        multiply(P, block + L[tb.GLIDE], height, columns, S, 0, glided)
        if piece == first:
            _fence(P, L, S, D, slot, now)
        sizes(S, bends, size, rows)
        multiply(P, block + L[tb.DEVIATION], forms, columns, S, size, bound)
        if not between(S, now, now + forms, bound, D[st.LOWER], D[st.UPPER], forms):
            break
        if full:
            _record(P, L, S, D, slot, step)
        elif D[st.SAMPLED] < D[st.SAMPLES_WANTED]:
            _sample(P, L, S, D, slot, step)
        for i in range(rows):
            S[i] += S[glided + i]
        S[clock] = ends
        piece += 1
    return piece


@inlined
def hold_ramp(P, L, S, D, ramps, piece):
    """Set the signal to a piece of ramps, or beyond the last to where that ends."""
    times, starts, slopes = ramps
    if piece < len(starts):
        since = S[D[st.CLOCK]] - times[piece]
        set_ramp(P, L, S, starts[piece] + slopes[piece] * since, slopes[piece])
    else:
        set_ramp(P, L, S, starts[piece - 1] + slopes[piece - 1] * (times[piece] - times[piece - 1]), 0.0)


@compiled
def _fence(P, L, S, D, slot, now):
    """Limits of every form that a guard reads; of what is watched, whose value stands at `now`, the sign stays."""
    at, lower, upper = slot_of(L, slot), D[st.LOWER], D[st.UPPER]
    for r in range(L[tb.FORMS]):
        S[lower + r], S[upper + r] = -np.inf, np.inf
    count = L[at + tb.GUARD_COUNT]
    for g in range(count if D[st.TRACKED] else count - pg.WATCHED):
        row, sign, limit = L[at + tb.FIRST_GUARD + 2 * g + 1], S[D[st.SIGN] + g], -S[D[st.OFFSET] + g]
        if g >= count - pg.WATCHED:
            sign, limit = -1.0 if S[now + row] > 0.0 else 1.0, 0.0
        if sign < 0.0:
            S[lower + row] = -limit
        else:
            S[upper + row] = limit if sign > 0.0 else -np.inf


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
