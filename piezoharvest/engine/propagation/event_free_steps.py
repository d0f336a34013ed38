"""Longest steps in which no guard can rise, as between most samples of a record and in most stages of a switch."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.state import set_one, set_ramp, vector
from piezoharvest.engine.memory.tables import block_of, rows_read, slot_of
from piezoharvest.engine.memory.vector import accumulate, copy, dot, inside, multiply_top
from piezoharvest.engine.motion.exact_step import ARRIVED, CLOCK_ROUNDING
from piezoharvest.engine.propagation.recording import TIME_TOLERANCE, record_energies, record_outputs
from piezoharvest.engine.propagation.tangents import propagate_sensitivities
from piezoharvest.engine.work_limit import spend_products


@compiled
def make_free_steps(P, L, S, D, ramps, last, piece, t_end):
    """Make longest steps while no guard comes near zero, and return the present piece.

    One product of a matrix with the state gives the next state, the guards at both ends, the outputs and the second
    derivatives, so that nothing depends on the next state; rates are not needed.
    """
    slot, glided, clock = D[st.MODE], D[st.FREE_STEP], D[st.CLOCK]
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    step, bends, pairs = P[block + L[tb.STEPS]], glided + rows, glided + 2 * rows
    full = D[st.TRACKED] > 0 or D[st.ENERGIES] > 0
    # Forms that no guard uses, and outputs that are not recorded, are left out.
    forms, height = rows_read(L, D[st.TRACKED], slot), L[tb.FREE_STEP_ROWS]
    if not full and D[st.SAMPLED] >= D[st.SAMPLES_WANTED]:
        height = 2 * rows + 2 * forms
    if D[st.TRACKED]:
        _set_watched_limits(P, L, S, D, slot)
    times, starts, slopes = ramps
    # As in `set_ramp_piece`, without a division in every sample.
    signal = L[pg.SIGNAL]
    scale = L[pg.EXO_SCALE] + signal - L[pg.N]
    of_value, of_slope = 1.0 / P[scale], 1.0 / P[scale + 1]
    set_one(P, L, S)
    while piece < last:
        ends = times[piece + 1]
        if ends > t_end or not abs(ends - S[clock] - step) <= 1e-9 * step:
            break
        S[signal] = (starts[piece] + slopes[piece] * (S[clock] - times[piece])) * of_value
        S[signal + 1] = slopes[piece] * of_slope
        multiply_top(P, block + L[tb.FREE_STEP], L[tb.FREE_STEP_ROWS], height, columns, S, 0, glided)
        if not inside(
            P, block + L[tb.DEVIATION], L[tb.FORMS], forms, columns, S, bends, pairs, D[st.LOWER], D[st.UPPER]
        ):
            break
        if full:
            _record(P, L, S, D, slot, step)
        elif D[st.SAMPLED] < D[st.SAMPLES_WANTED]:
            _sample(P, L, S, D, slot, step)
        accumulate(S, glided, 1.0, 0, rows)
        S[clock] = ends
        piece += 1
    return piece


@compiled
def make_free_stage(P, L, S, D, slot, t_stop):
    """Pass through a whole stage of the switch, which ends at t_stop, if no guard comes near zero; True if it did.

    As `make_free_steps`. In most stages of a flip on capacitors the voltage is far from where the diodes conduct.
    """
    if D[st.TRACKED] or L[L[pg.OPENED] + D[st.CONFIGURATION]] == D[st.CONFIGURATION]:
        return False
    clock, block, glided = S[D[st.CLOCK]], block_of(L, slot), D[st.FREE_STEP]
    rows, columns, step = L[pg.ROWS], L[pg.COLUMNS], P[block + L[tb.STEPS]]
    if not abs(t_stop - clock - step) <= TIME_TOLERANCE * step + CLOCK_ROUNDING * clock:
        return False
    forms, bends, pairs = rows_read(L, False, slot), glided + rows, glided + 2 * rows
    spend_products(L, 3)
    multiply_top(P, block + L[tb.FREE_STEP], L[tb.FREE_STEP_ROWS], 2 * (rows + forms), columns, S, 0, glided)
    if not inside(P, block + L[tb.DEVIATION], L[tb.FORMS], forms, columns, S, bends, pairs, D[st.LOWER], D[st.UPPER]):
        return False
    if D[st.SAMPLED] < D[st.SAMPLES_WANTED] or D[st.ENERGIES]:
        _record(P, L, S, D, slot, step)
    if D[st.SENSITIVITIES]:
        propagate_sensitivities(P, L, S, D, slot, step)
    accumulate(S, glided, 1.0, 0, rows)
    S[D[st.CLOCK]] = t_stop
    return True


@inlined
def set_ramp_piece(P, L, S, D, ramps, last, piece):
    """Set the signal to one of the `last` pieces of ramps, or after these to their end value."""
    times, starts, slopes = ramps
    if piece < last:
        since = S[D[st.CLOCK]] - times[piece]
        set_ramp(P, L, S, starts[piece] + slopes[piece] * since, slopes[piece])
    else:
        set_ramp(P, L, S, starts[piece - 1] + slopes[piece - 1] * (times[piece] - times[piece - 1]), 0.0)


@compiled
def _set_watched_limits(P, L, S, D, slot):
    """Set limits of the watched outputs' rates, as those of the guards, so that their signs do not change."""
    at, rows = slot_of(L, slot), L[pg.ROWS]
    for g in range(L[at + tb.GUARD_COUNT] - pg.WATCHED, L[at + tb.GUARD_COUNT]):
        row = L[at + tb.FIRST_GUARD + 2 * g + 1]
        positive = dot(P, block_of(L, slot) + L[tb.LINES] + 2 * row * rows, S, 0, rows) > 0.0
        S[D[st.LOWER] + row], S[D[st.UPPER] + row] = (0.0, np.inf) if positive else (-np.inf, 0.0)


@compiled
def _sample(P, L, S, D, slot, step):
    """Record the outputs at the end of a step, if these are its only samples."""
    k, times, end = D[st.SAMPLED], D[st.SAMPLE_TIME], S[D[st.CLOCK]] + step
    early = end - S[times + k]
    if early < -TIME_TOLERANCE * step:
        return
    if early > TIME_TOLERANCE * step or (k + 1 < D[st.SAMPLES_WANTED] and S[times + k + 1] <= end):
        _record(P, L, S, D, slot, step)
        return
    outputs = D[st.FREE_STEP] + 2 * L[pg.ROWS] + 2 * L[tb.FORMS]
    copy(S, outputs, D[st.SAMPLES] + k * len(pg.OUTPUTS), tb.OUTPUT_ROWS)
    D[st.SAMPLED] += 1


@compiled
def _record(P, L, S, D, slot, step):
    """Record a longest step in full."""
    arrived = vector(L, D, ARRIVED)
    for i in range(L[pg.ROWS]):
        S[arrived + i] = S[i] + S[D[st.FREE_STEP] + i]
    record_outputs(P, L, S, D, slot, step, S[D[st.CLOCK]] + step, arrived)
    record_energies(P, L, S, D, slot, step, 0)
