"""Steps with smooth nonlinear elements: their outputs as cubics of time, iterated until consistent with the motion.

Within a step every output is a cubic with the value and the slope of the true output at both ends (Hermite). The motion
under it is exact, with events and energies; only the outputs are approximated, with an error of fourth order that
determines the step. A step ends at every event.
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
    NEXT,
    START,
    corners,
    element_of,
    input_of,
    outputs,
    release,
    scale_of,
    scratch,
    segment_at,
    set_outputs_and_rates,
    set_rates,
    size_of,
    tolerance_of,
)
from piezoharvest.engine.propagation.event_cascade import present_mode, process_due_events
from piezoharvest.engine.propagation.propagate import propagate_mode, read_guards
from piezoharvest.engine.propagation.trajectory import begin_tape, end_tape, set_beginning
from piezoharvest.equations.terms import PIECEWISE

# Of the admissible error: difference at the end of a step between a cubic and the output that the motion gives.
AGREEMENT = 0.1
MAX_ITERATIONS = 8  # iterations for cubic and motion to agree; a step in which they do not is halved
CORNER = 1e-10  # of the way of an input over a step: so close to a corner it is there
ROUNDING = 1e-15  # of the terms of an input: what their sum is wrong by
UNSEEN = 1e-10  # of these terms: so little of an input is far below what a step is right to, and its bends are rounding
MAX_BISECTIONS = 60
# Difference of the second derivatives of an input and of its cubic, of its values: the cubic is off by a thirtieth of
# it, and by so much an input may pass a corner and come back unseen.
COARSE = 1e-3
MAX_PASSES = 6  # to end a step at a corner: the second one meets it to rounding, others are for inputs that turn there
MIN_STEP = 1e-9  # of a longest step: if a shorter one were needed, the outputs have no solution
DIFFERENCE = 1e-7  # of the state: size of a finite difference
FIRST_STEP = 1.0 / 256.0  # of a longest step: first trial step


@compiled
def begin_step(P, L, S, D, slot):
    """Set the outputs at the present state, with slope and second derivative, for the beginning of a step.

    Outputs that already agree with the state are left unchanged: conducting diodes fix a voltage that depends on them.
    The second derivative is a finite difference of the slope along the rate of the state.
    """
    now, moved, rows = S[D[st.CLOCK]], scratch(L, D, MOVED), L[pg.ROWS]
    copy(S, 0, moved, rows)
    release(L, D)
    outputs(P, L, S, D, 0, now)
    if corners(L):
        _hold(P, L, S, D, slot)
        outputs(P, L, S, D, 0, now)
    _begin_outputs(P, L, S, D, slot)


@compiled
def _begin_outputs(P, L, S, D, slot):
    """Set the slopes and second derivatives of the outputs at the present state; what it was before is at MOVED."""
    now, moved, rows = S[D[st.CLOCK]], scratch(L, D, MOVED), L[pg.ROWS]
    set_rates(P, L, S, D, slot, 0, now)
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        if abs(S[place] - S[moved + place]) <= tolerance_of(S, D) * size_of(L, S, 0):
            S[place] = S[moved + place]
        S[place + 2] = S[place + 3] = 0.0
    flow = scratch(L, D, FLOW)
    multiply(P, block_of(L, slot) + L[tb.MATRIX], rows, L[pg.COLUMNS], S, 0, flow)
    # Short compared with the fastest motion of the mode.
    moment = 1e-5 * P[block_of(L, slot) + L[tb.STEPS] + L[slot_of(L, slot) + tb.FINEST_LEVEL]]
    for i in range(rows):
        S[moved + i] = S[i] + moment * S[flow + i]
    set_outputs_and_rates(P, L, S, D, slot, moved, now + moment)
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        share = scale_of(P, L, place + 1) / scale_of(P, L, place + 2)
        S[place + 2] = (S[moved + place + 1] - S[place + 1]) / moment * share


@compiled
def _hold(P, L, S, D, slot):
    """Hold the pieces of piecewise elements over the step that begins: those into which their inputs go."""
    flow, ahead = scratch(L, D, FLOW), NEXT * S[D[st.CURVE]]
    multiply(P, block_of(L, slot) + L[tb.MATRIX], L[pg.ROWS], L[pg.COLUMNS], S, 0, flow)
    for k in range(L[pg.ELEMENTS]):
        if L[L[pg.ELEMENT_POWER] + k] == PIECEWISE:
            first = input_of(P, L, S, 0, k, 0) + ahead * input_of(P, L, S, flow, k, 0)
            D[D[st.SEGMENTS] + k] = 1 + segment_at(P, L, k, first)


@compiled
def process_due_events_smooth(P, L, S, D):
    """As `process_due_events`, with outputs consistent with the state; repeated if they change the mode."""
    if D[st.MODE] == NONE:  # the state is new: its outputs are zero, or those of another one
        begin_step(P, L, S, D, present_mode(P, L, D))
    slot = process_due_events(P, L, S, D)
    for _ in range(4):
        if slot == NONE:
            break
        begin_step(P, L, S, D, slot)
        before, slot = slot, process_due_events(P, L, S, D)
        if slot == before:
            break
    return slot


@compiled
def _set_cubics(P, L, S, z, end, length):
    """Set the cubics that begin at a state to given values and slopes at the end."""
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        scale, of_slope = scale_of(P, L, place), scale_of(P, L, place + 1)
        slope, last = of_slope * S[z + place + 1], of_slope * S[end + place + 1]
        rise, turn = scale * (S[end + place] - S[z + place]) - slope * length, (last - slope) * length
        S[z + place + 2] = (6.0 * rise - 2.0 * turn) / length**2 / scale_of(P, L, place + 2)
        S[z + place + 3] = (6.0 * turn - 12.0 * rise) / length**3 / scale_of(P, L, place + 3)


@compiled
def _error(P, L, S, z, known, length):
    """Error of the cubics within a step, from the second derivatives that are known at its beginning.

    By the error formula of Hermite interpolation an error x in the middle implies 32 x / length^2 in the second
    derivative.
    """
    error = 0.0
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        bend = (S[z + place + 2] - S[known + place + 2]) * scale_of(P, L, place + 2) / scale_of(P, L, place)
        error = max(error, abs(bend) * length**2 / 32.0)
    return error


@compiled
def _mismatch(P, L, S, z, end, length):
    """Difference of the outputs in a state from consistent ones; that of the slopes is multiplied by the step."""
    gap = 0.0
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        ratio = scale_of(P, L, place + 1) / scale_of(P, L, place)
        slopes = abs(S[end + place + 1] - S[z + place + 1]) * ratio * length
        gap = max(gap, slopes, abs(S[end + place] - S[z + place]))
    return gap


@compiled
def _propagate_again(P, L, S, D, slot, t_stop):
    """Propagate from a state whose outputs have been changed: its guards are evaluated again."""
    read_guards(P, L, S, D, slot, L[tb.GUARDS], 0, D[st.NOW_GUARDS])
    return propagate_mode(P, L, S, D, slot, t_stop)


@compiled
def _propagate_unrecorded(P, L, S, D, slot, t_stop, count):
    """Propagate without recording, with `count` sensitivities only."""
    wanted, tracked, energies, all_of_them = D[st.SAMPLES_WANTED], D[st.TRACKED], D[st.ENERGIES], D[st.SENSITIVITIES]
    D[st.SAMPLES_WANTED] = D[st.TRACKED] = D[st.ENERGIES] = 0
    D[st.SENSITIVITIES] = count
    guard = _propagate_again(P, L, S, D, slot, t_stop)
    D[st.SAMPLES_WANTED], D[st.TRACKED], D[st.ENERGIES], D[st.SENSITIVITIES] = wanted, tracked, energies, all_of_them
    return guard


@compiled
def _consistent_step(P, L, S, D, slot, step, left):
    """Propagate over a step with cubics that agree with the motion; the initial state, with these, stays at START.

    Returns the guard that ended the step, and the error of the outputs, infinite if no cubic agrees.
    """
    start, end, known = scratch(L, D, START), scratch(L, D, END), scratch(L, D, MOVED)
    clock, rows, guard, error = D[st.CLOCK], L[pg.ROWS], NONE, np.inf
    now = S[clock]
    for _ in range(MAX_ITERATIONS):
        copy(S, start, 0, rows)
        S[clock] = now
        guard = _propagate_unrecorded(P, L, S, D, slot, now + step if step < left else now + left, 0)
        length = S[clock] - now
        if not np.isfinite(S[0]):
            return guard, np.inf
        if length <= 0.0:
            return guard, 0.0
        copy(S, 0, end, rows)
        set_outputs_and_rates(P, L, S, D, slot, end, S[clock])
        agreed = _mismatch(P, L, S, 0, end, length) <= AGREEMENT * tolerance_of(S, D) * size_of(L, S, 0)
        _set_cubics(P, L, S, start, end, length)
        error = _error(P, L, S, start, known, length) / max(size_of(L, S, 0), 1e-300)
        if agreed:
            return guard, error
    return guard, np.inf


@compiled
def _until_corner(P, L, S, D, slot, length):
    """Share of the step from START to the present state after which an input first leaves the piece that is held.

    By the cubic of the input with the values and rates at both ends (Hermite); 1 where none does, and -1 where the
    cubic is too coarse to tell. Of an input that began at a corner and is now beyond it the next piece is held, and the
    share is 0.
    """
    start, share = scratch(L, D, START), 1.0
    for k in range(L[pg.ELEMENTS]):
        at, end = L[L[pg.FIRST_CORNER] + k], L[L[pg.FIRST_CORNER] + k + 1]
        if at == end:
            continue
        a, da, bend = _course(P, L, S, D, slot, start, k, length)
        b, db, turn = _course(P, L, S, D, slot, 0, k, length)
        coarse = max(abs(6.0 * (b - a) - 4.0 * da - 2.0 * db - bend), abs(6.0 * (a - b) + 2.0 * da + 4.0 * db - turn))
        way, terms = abs(a) + abs(b) + abs(b - a), _terms_of(P, L, S, 0, k)
        if coarse > COARSE * way + UNSEEN * terms:
            return -1.0
        segment = D[D[st.SEGMENTS] + k] - 1
        for side in range(2):  # the lower end of the piece, and the upper one
            corner = at + segment - 1 + side
            if not at <= corner < end:
                continue
            sign, knot = (1.0 if side else -1.0), P[L[pg.CORNERS] + corner]
            near = CORNER * abs(b - a) + ROUNDING * (terms + abs(knot))
            own = _crossing(sign * (a - knot), sign * da, sign * (b - knot), sign * db, near)
            if own >= 1.0:
                continue
            if own * length <= MIN_STEP * P[L[pg.STEP]]:
                D[D[st.SEGMENTS] + k] += 1 if side else -1
                return 0.0
            share = min(share, own)
    return share


@compiled
def _terms_of(P, L, S, z, k):
    """Sum of the sizes of the terms of an input."""
    form, total = L[pg.ELEMENT_Z] + 2 * k * L[pg.A], 0.0
    for j in range(L[pg.A]):
        total += abs(P[form + j] * S[z + j])
    return total


@compiled
def _course(P, L, S, D, slot, z, k, length):
    """Input of an element at a state, and its first and second derivatives, of time in units of a step."""
    first, second, matrix = scratch(L, D, FLOW), scratch(L, D, END), block_of(L, slot) + L[tb.MATRIX]
    multiply(P, matrix, L[pg.ROWS], L[pg.COLUMNS], S, z, first)
    multiply(P, matrix, L[pg.ROWS], L[pg.COLUMNS], S, first, second)
    rate, bend = input_of(P, L, S, first, k, 0), input_of(P, L, S, second, k, 0)
    return input_of(P, L, S, z, k, 0), length * rate, length * length * bend


@compiled
def _crossing(a, da, b, db, near):
    """Where the cubic with values a <= 0 and b, and slopes da and db at 0 and 1, first rises beyond `near`; else 1."""
    c, d, high = 3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db, 1.0
    root = c * c - 3.0 * d * da
    if root > 0.0:  # a largest value inside
        top = -da / (c - np.sqrt(root)) if c < 0.0 else (-c - np.sqrt(root)) / (3.0 * d) if d != 0.0 else 1.0
        if 0.0 < top < 1.0 and a + top * (da + top * (c + top * d)) > near:
            high = top
    if high == 1.0 and b <= near:
        return 1.0
    if a >= -near:
        return 0.0
    low, s = 0.0, high * min(max(a / (a - max(b, near)), 0.0), 1.0)
    for _ in range(MAX_BISECTIONS):
        value, slope = a + s * (da + s * (c + s * d)), da + s * (2.0 * c + 3.0 * s * d)
        if value < 0.0:
            low = s
        else:
            high = s
        newton = s - value / slope if slope != 0.0 else low
        moved = newton if low < newton < high else 0.5 * (low + high)
        if abs(moved - s) <= 1e-15:
            return moved
        s = moved
    return s


@compiled
def _step_growth(error, tolerance):
    """Factor by which the next step may be longer than one with this error."""
    return 0.9 * (tolerance / max(error, 1e-3 * tolerance)) ** 0.25


@compiled
def _step(P, L, S, D, slot, t_stop):
    """Propagate over a step of admissible error without recording; return the guard that ended it."""
    clock, length_at, rows, longest = D[st.CLOCK], D[st.CURVE], L[pg.ROWS], P[L[pg.STEP]]
    start, known = scratch(L, D, START), scratch(L, D, MOVED)
    now, left, tolerance = S[clock], t_stop - S[clock], tolerance_of(S, D)
    step = S[length_at] if S[length_at] > 0.0 else FIRST_STEP * longest
    copy(S, 0, known, rows)
    to_corner, changed, passes = False, False, 0
    while True:
        step = min(step, left)
        S[length_at + 1] = step
        copy(S, known, start, rows)
        guard, error = _consistent_step(P, L, S, D, slot, step, left)
        if error <= tolerance:
            length = S[clock] - now
            again = corners(L) and passes < MAX_PASSES and length > MIN_STEP * longest
            share = _until_corner(P, L, S, D, slot, length) if again else 1.0
            if share >= 1.0:
                break
            if share < 0.0:
                S[clock], step = now, 0.5 * length
                S[length_at] = step
                continue
            passes += 1
            if share == 0.0 and changed:  # it has turned within the step
                share = 0.5
            if share == 0.0:
                changed = True
                S[clock] = now
                copy(S, known, 0, rows)
                outputs(P, L, S, D, 0, now)
                _begin_outputs(P, L, S, D, slot)
                copy(S, 0, known, rows)
                continue
            S[clock], step, to_corner = now, share * length, True
            continue
        if step <= MIN_STEP * longest:
            # The motion diverges, or a charge is not single-valued: there is no solution.
            S[0] = np.nan
            return NONE
        S[clock] = now
        step *= min(0.5, max(0.1, _step_growth(error, tolerance))) if error < np.inf else 0.25
    if (guard == NONE and step < left and not to_corner) or _step_growth(error, tolerance) < 1.0:
        S[length_at] = step * min(2.0, max(0.5, _step_growth(error, tolerance)))
    return guard


@compiled
def _tangents(P, L, S, D, slot, now):
    """Set sensitivities of the outputs over a step from START to the present state, by differences of outputs.

    Those at its end follow from the motion, on which they have little influence: they are computed with linear outputs
    first, and from the result with cubics.
    """
    rows, count, phi, kept = L[pg.ROWS], D[st.SENSITIVITIES], D[st.PHI], D[st.CURVE_PHI]
    start, moved, end = scratch(L, D, START), scratch(L, D, MOVED), scratch(L, D, END)
    then = S[D[st.CLOCK]]
    copy(S, start, end, rows)
    set_outputs_and_rates(P, L, S, D, slot, end, now)
    for s in range(count):
        _output_differences(P, L, S, D, slot, end, phi + s * rows, moved, now)
        copy(S, phi + s * rows, kept + s * rows, rows)
    copy(S, start, 0, rows)
    S[D[st.CLOCK]] = now
    _propagate_unrecorded(P, L, S, D, slot, then, count)
    copy(S, 0, end, rows)
    set_outputs_and_rates(P, L, S, D, slot, end, then)
    for s in range(count):
        _output_differences(P, L, S, D, slot, end, phi + s * rows, moved, then)
        _set_cubics(P, L, S, kept + s * rows, phi + s * rows, then - now)
        copy(S, kept + s * rows, phi + s * rows, rows)


@compiled
def _output_differences(P, L, S, D, slot, z, phi, moved, time):
    """Set the outputs of a sensitivity, and their slopes, by finite differences of those of a state."""
    size = 0.0
    for i in range(L[pg.N]):
        size += S[phi + i] ** 2
    share = DIFFERENCE * max(size_of(L, S, z), 1e-300) / np.sqrt(size) if size > 0.0 else 0.0
    for i in range(L[pg.ROWS]):
        S[moved + i] = S[z + i] + (share * S[phi + i] if i < L[pg.N] else 0.0)
    set_outputs_and_rates(P, L, S, D, slot, moved, time)
    for k in range(L[pg.ELEMENTS]):
        place = element_of(L, k)
        for d in range(2):
            change = S[moved + place + d] - S[z + place + d]
            S[phi + place + d] = change / share if share > 0.0 else 0.0
        S[phi + place + 2] = S[phi + place + 3] = 0.0


@compiled
def propagate_smooth(P, L, S, D, slot, t_stop):
    """Propagate within a mode until t_stop or until a guard crosses zero, as `propagate_mode` does, step by step.

    A step is made without recording until its cubics agree, then repeated with recording.
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
            guard = _propagate_again(P, L, S, D, slot, now + step if step < left else t_stop)
        if D[st.STEPS_TAPED] and D[st.TAPED] < D[st.TAPE_ROOM]:
            set_beginning(L, S, D, start)
        if guard != NONE:
            return guard
        if S[clock] < t_stop:
            if D[st.STEPS_TAPED] and D[st.TAPED] < D[st.TAPE_ROOM]:
                end_tape(L, S, D, slot, NONE, np.inf, 0)
            begin_step(P, L, S, D, slot)
            if D[st.STEPS_TAPED] and D[st.TAPED] < D[st.TAPE_ROOM]:
                begin_tape(L, S, D)
    return NONE
