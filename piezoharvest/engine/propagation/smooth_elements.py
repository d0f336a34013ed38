"""Smooth nonlinear elements: their outputs as cubics of time, made to agree with the motion that they bring about.

Within a step every output is a cubic with the value and the slope that the motion gives it at both ends (Hermite), so
that the motion under it is exact, events and energies included, and what is approximated is the outputs alone: to the
fourth power of the step, which is as short as that error asks for. A step ends at every event.
"""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.tables import block_of, slot_of
from piezoharvest.engine.memory.vector import copy, multiply
from piezoharvest.engine.motion.element_outputs import (
    END,
    FLOW,
    MOVED,
    START,
    element_of,
    lift,
    scale_of,
    scratch,
    size_of,
)
from piezoharvest.engine.propagation.event_cascade import settle
from piezoharvest.engine.propagation.propagate import march, read_guards

TOLERANCE = 1e-11  # error of an output within a step, against the state: both are scaled to the root of energy
AGREED = 1e-12  # of the state: what an output may differ from what the motion gives it at the end of a step
ROUNDS = 8  # in which cubic and motion have to agree; a step in which they do not is halved
SHORTEST = 1e-9  # of a longest step: where the outputs cannot be followed in this, they have no solution
NEARBY = 1e-7  # of the state: a difference that stands for a derivative
FIRST = 1.0 / 256.0  # of a longest step: what is tried first


@compiled
def begin(P, L, S, D, slot):
    """Outputs at the present state with slope and bend, to begin a step with.

    Outputs that agree with the state already stay as they are: diodes that conduct hold a voltage that is made of them.
    The bend is the change of the slope a moment later: the motion is carried on along its own rate.
    """
    now, moved, rows = S[D[st.CLOCK]], scratch(L, D, MOVED), L[pg.ROWS]
    copy(S, 0, moved, rows)
    lift(P, L, S, D, slot, 0, now)
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        if abs(S[place] - S[moved + place]) <= 10.0 * AGREED * size_of(L, S, 0):
            S[place] = S[moved + place]
        S[place + 2] = S[place + 3] = 0.0
    flow = scratch(L, D, FLOW)
    multiply(P, block_of(L, slot) + L[tb.MATRIX], rows, L[pg.COLUMNS], S, 0, flow)
    # Small beside the fastest motion of the mode.
    moment = 1e-5 * P[block_of(L, slot) + L[tb.STEPS] + L[slot_of(L, slot) + tb.FINEST_LEVEL]]
    for i in range(rows):
        S[moved + i] = S[i] + moment * S[flow + i]
    lift(P, L, S, D, slot, moved, now + moment)
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        share = scale_of(P, L, place + 1) / scale_of(P, L, place + 2)
        S[place + 2] = (S[moved + place + 1] - S[place + 1]) / moment * share


@compiled
def settle_smooth(P, L, S, D):
    """As `settle`, with the outputs that belong to the state and its mode; a mode that they change is settled again."""
    slot = settle(P, L, S, D)
    for _ in range(4):
        if slot == NONE:
            break
        begin(P, L, S, D, slot)
        before, slot = slot, settle(P, L, S, D)
        if slot == before:
            break
    return slot


@compiled
def _bend(P, L, S, z, end, length):
    """Give the cubics from a state on the values and slopes that they have at the end."""
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        scale, of_slope = scale_of(P, L, place), scale_of(P, L, place + 1)
        slope, last = of_slope * S[z + place + 1], of_slope * S[end + place + 1]
        rise, turn = scale * (S[end + place] - S[z + place]) - slope * length, (last - slope) * length
        S[z + place + 2] = (6.0 * rise - 2.0 * turn) / length**2 / scale_of(P, L, place + 2)
        S[z + place + 3] = (6.0 * turn - 12.0 * rise) / length**3 / scale_of(P, L, place + 3)


@compiled
def _error(P, L, S, z, known, length):
    """Error of the cubics from a state within a step, from the bends that are known to be there.

    By the formula of Hermite's interpolation an error of x in the middle makes one of 32 x / length^2 in the bend.
    """
    error = 0.0
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        bend = (S[z + place + 2] - S[known + place + 2]) * scale_of(P, L, place + 2) / scale_of(P, L, place)
        error = max(error, abs(bend) * length**2 / 32.0)
    return error


@compiled
def _gap(P, L, S, z, end, length):
    """Difference of the outputs of a state from those that belong to it, that of the slopes times the step."""
    gap = 0.0
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        ratio = scale_of(P, L, place + 1) / scale_of(P, L, place)
        slopes = abs(S[end + place + 1] - S[z + place + 1]) * ratio * length
        gap = max(gap, slopes, abs(S[end + place] - S[z + place]))
    return gap


@compiled
def _again(P, L, S, D, slot, t_stop):
    """March from a state whose outputs have been changed: its guards are read anew."""
    read_guards(P, L, S, D, slot, L[tb.GUARDS], 0, D[st.NOW_GUARDS])
    return march(P, L, S, D, slot, t_stop)


@compiled
def _quietly(P, L, S, D, slot, t_stop, count):
    """March with nothing recorded but so many sensitivities."""
    wanted, tracked, energies, all_of_them = D[st.SAMPLES_WANTED], D[st.TRACKED], D[st.ENERGIES], D[st.SENSITIVITIES]
    D[st.SAMPLES_WANTED] = D[st.TRACKED] = D[st.ENERGIES] = 0
    D[st.SENSITIVITIES] = count
    guard = _again(P, L, S, D, slot, t_stop)
    D[st.SAMPLES_WANTED], D[st.TRACKED], D[st.ENERGIES], D[st.SENSITIVITIES] = wanted, tracked, energies, all_of_them
    return guard


@compiled
def _agree(P, L, S, D, slot, step, left):
    """Move a step on with cubics that agree with the motion; the beginning stays at START, with these cubics.

    Returns the guard that ended the step, and the error of the outputs, infinite where no cubic agrees.
    """
    start, end, known = scratch(L, D, START), scratch(L, D, END), scratch(L, D, MOVED)
    clock, rows, guard, error = D[st.CLOCK], L[pg.ROWS], NONE, np.inf
    now = S[clock]
    for _ in range(ROUNDS):
        copy(S, start, 0, rows)
        S[clock] = now
        guard = _quietly(P, L, S, D, slot, now + step if step < left else now + left, 0)
        length = S[clock] - now
        if not np.isfinite(S[0]):
            return guard, np.inf
        if length <= 0.0:
            return guard, 0.0
        copy(S, 0, end, rows)
        lift(P, L, S, D, slot, end, S[clock])
        agreed = _gap(P, L, S, 0, end, length) <= AGREED * size_of(L, S, 0)
        _bend(P, L, S, start, end, length)
        error = _error(P, L, S, start, known, length) / max(size_of(L, S, 0), 1e-300)
        if agreed:
            return guard, error
    return guard, np.inf


@compiled
def _longer(error):
    """How many times as long a step may be as one with this error."""
    return 0.9 * (TOLERANCE / max(error, 1e-3 * TOLERANCE)) ** 0.25


@compiled
def _step(P, L, S, D, slot, t_stop):
    """Move a step on, as long as the error of the outputs allows, nothing recorded; returns the guard that ended it."""
    clock, length_at, rows, longest = D[st.CLOCK], D[st.CURVE], L[pg.ROWS], P[L[pg.STEP]]
    start, known = scratch(L, D, START), scratch(L, D, MOVED)
    now, left = S[clock], t_stop - S[clock]
    step = S[length_at] if S[length_at] > 0.0 else FIRST * longest
    copy(S, 0, known, rows)
    while True:
        step = min(step, left)
        S[length_at + 1] = step
        copy(S, known, start, rows)
        guard, error = _agree(P, L, S, D, slot, step, left)
        if error <= TOLERANCE:
            break
        if step <= SHORTEST * longest:
            # The motion runs away, or a charge folds back on itself: there is no way on.
            S[0] = np.nan
            return NONE
        S[clock] = now
        step *= min(0.5, max(0.1, _longer(error))) if error < np.inf else 0.25
    if (guard == NONE and step < left) or _longer(error) < 1.0:
        S[length_at] = step * min(2.0, max(0.5, _longer(error)))
    return guard


@compiled
def _tangents(P, L, S, D, slot, now):
    """Sensitivities of the outputs through a step from START to the present state, by differences of outputs.

    Those at its end follow from the motion, which depends on them but little: they are made once with straight lines,
    and from where these lead with cubics.
    """
    rows, count, phi, kept = L[pg.ROWS], D[st.SENSITIVITIES], D[st.PHI], D[st.CURVE_PHI]
    start, moved, end = scratch(L, D, START), scratch(L, D, MOVED), scratch(L, D, END)
    then = S[D[st.CLOCK]]
    copy(S, start, end, rows)
    lift(P, L, S, D, slot, end, now)
    for s in range(count):
        _differ(P, L, S, D, slot, end, phi + s * rows, moved, now)
        copy(S, phi + s * rows, kept + s * rows, rows)
    copy(S, start, 0, rows)
    S[D[st.CLOCK]] = now
    _quietly(P, L, S, D, slot, then, count)
    copy(S, 0, end, rows)
    lift(P, L, S, D, slot, end, then)
    for s in range(count):
        _differ(P, L, S, D, slot, end, phi + s * rows, moved, then)
        _bend(P, L, S, kept + s * rows, phi + s * rows, then - now)
        copy(S, kept + s * rows, phi + s * rows, rows)


@compiled
def _differ(P, L, S, D, slot, z, phi, moved, time):
    """Set the outputs of a sensitivity, and their slopes, to what it makes of those of a state."""
    size = 0.0
    for i in range(L[pg.N]):
        size += S[phi + i] ** 2
    share = NEARBY * max(size_of(L, S, z), 1e-300) / np.sqrt(size) if size > 0.0 else 0.0
    for i in range(L[pg.ROWS]):
        S[moved + i] = S[z + i] + (share * S[phi + i] if i < L[pg.N] else 0.0)
    lift(P, L, S, D, slot, moved, time)
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        for d in range(2):
            change = S[moved + place + d] - S[z + place + d]
            S[phi + place + d] = change / share if share > 0.0 else 0.0
        S[phi + place + 2] = S[phi + place + 3] = 0.0


@compiled
def follow(P, L, S, D, slot, t_stop):
    """Move within a mode until t_stop or until a guard rises through zero, as `march` does, step by step.

    A step is made without a record until its cubics agree, and then once more with it.
    """
    clock, rows, start = D[st.CLOCK], L[pg.ROWS], scratch(L, D, START)
    while S[clock] < t_stop:
        now, left = S[clock], t_stop - S[clock]
        guard = _step(P, L, S, D, slot, t_stop)
        if not np.isfinite(S[0]):
            return NONE
        if D[st.SAMPLES_WANTED] > 0 or D[st.TRACKED] or D[st.ENERGIES] or D[st.SENSITIVITIES]:
            if D[st.SENSITIVITIES]:
                _tangents(P, L, S, D, slot, now)
            copy(S, start, 0, rows)
            S[clock], step = now, S[D[st.CURVE] + 1]
            guard = _again(P, L, S, D, slot, now + step if step < left else t_stop)
        if guard != NONE:
            return guard
        if S[clock] < t_stop:
            begin(P, L, S, D, slot)
    return NONE
