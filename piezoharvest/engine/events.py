"""What happens at an instant: diodes, the switch and its clocks, stops that slip and stick, and their sensitivities."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine import state as st
from piezoharvest.engine import tables as tb
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.march import FLOW, NONE, march, read_guards
from piezoharvest.engine.state import QUEUE_LENGTH, dot_column, set_tones, stored, vector
from piezoharvest.engine.tables import block_of, build, seek, slot_of
from piezoharvest.engine.vector import dot, multiply

DONE, CHATTER, INVALID = range(3)
TINY = 1e-12  # a guard this small, relative to its terms, is zero
# What ends a motion on the tape, beside guards.
NOTHING, OPENS, ACTS = -1, -2, -3
AT_ONCE = 60  # events at one instant beyond which the model chatters
REFRESHED = 32  # events after which the tones are set from their phase again


@compiled
def log(S, D, code):
    """Write an event down."""
    if D[st.LOGGED] < D[st.LOG_ROOM]:
        S[D[st.LOG_TIME] + D[st.LOGGED]] = S[D[st.CLOCK] + st.NOW]
        D[D[st.LOG_CODE] + D[st.LOGGED]] = code
    D[st.LOGGED] += 1


@compiled
def cut(P, L, S, D, state):
    """Set a current to zero; its energy is lost in the shunt."""
    before = stored(P, L, S) if D[st.ENERGIES] else 0.0
    S[state] = 0.0
    for s in range(D[st.SENSITIVITIES]):
        S[D[st.PHI] + s * L[pg.ROWS] + state] = 0.0
    if D[st.ENERGIES]:
        S[D[st.ENERGY] + pg.SHUNT_LOSS] += before - stored(P, L, S)


@compiled
def extract(P, L, S, D):
    """Take the electrode voltage to zero at once: charge moves, stops with it, piece by piece as they saturate."""
    delivered, a, slip, charge = 0.0, L[pg.A], D[st.SLIP], L[pg.CHARGE]
    row, limit = L[pg.VOLTAGE_ROW], L[pg.STOP_LIMIT]
    for _ in range(2 * L[pg.H] + 2):
        voltage = dot_column(P, row, 1, S, 0, a)
        if voltage == 0.0:
            break
        sign = -1 if voltage > 0.0 else 1
        # A stop that slipped the other way sticks as soon as the charge turns.
        slope = P[row + charge]
        for j in range(L[pg.H]):
            if D[slip + j] == -sign:
                D[slip + j] = 0
            if D[slip + j] == 0:
                slope += P[row + L[L[pg.STOP_STATE] + j]]
        move, first = -voltage / slope, NONE
        for j in range(L[pg.H]):
            if D[slip + j] == 0:
                reach = sign * P[limit + j] - S[L[L[pg.STOP_STATE] + j]]
                if abs(reach) < abs(move):
                    move, first = reach, j
        for s in range(D[st.SENSITIVITIES]):
            phi = D[st.PHI] + s * L[pg.ROWS]
            if first == NONE:
                shift = -dot_column(P, row, 1, S, phi, a) / slope
            else:
                shift = -S[phi + L[L[pg.STOP_STATE] + first]]
            _shift(L, S, D, phi, shift)
        delivered -= P[L[pg.SCALE] + charge] * move * (voltage + 0.5 * slope * move)
        if D[st.ENERGIES]:
            for j in range(L[pg.H]):
                if D[slip + j] != 0:
                    S[D[st.ENERGY] + pg.HYSTERESIS] += P[L[pg.STOP_WEIGHT] + j] * P[limit + j] * abs(move)
        _shift(L, S, D, 0, move)
        if first == NONE:
            break
        D[slip + first] = sign
        S[L[L[pg.STOP_STATE] + first]] = sign * P[limit + first]
    if D[st.ENERGIES]:
        S[D[st.ENERGY] + pg.HARVESTED] += P[L[pg.EFFICIENCY]] * delivered
        S[D[st.ENERGY] + pg.SHUNT_LOSS] += (1.0 - P[L[pg.EFFICIENCY]]) * delivered


@compiled
def _shift(L, S, D, z, move):
    S[z + L[pg.CHARGE]] += move
    for j in range(L[pg.H]):
        if D[D[st.SLIP] + j] == 0:
            S[z + L[L[pg.STOP_STATE] + j]] += move


@compiled
def act(P, L, S, D, polarity):
    """The switch acts, at a maximum (polarity +1) or a minimum of sum T_i x_i."""
    if L[pg.SWITCHED] == 2:
        extract(P, L, S, D)
        log(S, D, pg.EXTRACT)
        return
    if D[st.CLOSED]:
        return
    D[st.CLOSED] = 1
    D[st.CONFIGURATION] = L[L[pg.CLOSED] + (L[pg.C] if polarity > 0 else 0) + D[st.CONFIGURATION]]
    S[D[st.CLOCK] + st.OPENS] = S[D[st.CLOCK] + st.NOW] + P[L[pg.ON_TIME]]
    for s in range(D[st.SENSITIVITIES]):
        S[D[st.OPENS_PHI] + s] = S[D[st.EVENT_PHI] + s]
    log(S, D, pg.CLOSE)


@compiled
def release(P, L, S, D):
    """The switch opens; current that still flows is cut."""
    D[st.CLOSED] = 0
    D[st.CONFIGURATION] = L[L[pg.OPENED] + D[st.CONFIGURATION]]
    S[D[st.CLOCK] + st.OPENS] = np.inf
    cut(P, L, S, D, L[pg.CUT])
    log(S, D, pg.OPEN)


@compiled
def extremum(P, L, S, D):
    """Sum T_i x_i is at an extremum: an action is due after the lag, unless the last one was too short ago."""
    polarity = D[st.DIRECTION]
    D[st.DIRECTION] = -polarity
    if L[pg.SWITCHED] == 0:
        return
    lag, clock = P[L[pg.LAG]], D[st.CLOCK]
    due = S[clock + st.NOW] + lag
    if due - S[clock + st.ACTED] < P[L[pg.HOLD_OFF]] * (1 - 1e-9) or D[st.WAITING] == QUEUE_LENGTH:
        return
    S[clock + st.ACTED] = due
    if P[L[pg.EARLY]] != 0.0:
        polarity = -polarity
    if lag == 0.0:
        act(P, L, S, D, polarity)
        return
    place, count = D[st.WAITING], D[st.SENSITIVITIES]
    S[D[st.QUEUE] + place] = due
    D[D[st.POLARITY] + place] = polarity
    for s in range(count):
        S[D[st.QUEUE_PHI] + place * count + s] = S[D[st.EVENT_PHI] + s]
    D[st.WAITING] += 1


@compiled
def happen(P, L, S, D, what):
    """Carry out what a guard stands for."""
    own, configuration = L[pg.G], D[st.CONFIGURATION]
    if what < own:
        k = configuration * own + what
        if L[L[pg.GUARD_CUT] + k] >= 0:
            cut(P, L, S, D, L[L[pg.GUARD_CUT] + k])
        log(S, D, L[L[pg.GUARD_CODE] + k])
        D[st.CONFIGURATION] = L[L[pg.GUARD_TARGET] + k]
    elif what == own:
        extremum(P, L, S, D)
    else:
        j, side = (what - own - 1) // 2, (what - own - 1) % 2
        slip = D[st.SLIP] + j
        if D[slip] != 0:
            D[slip] = 0
            log(S, D, pg.STICK)
        else:
            D[slip] = 1 if side == 0 else -1
            S[L[L[pg.STOP_STATE] + j]] = D[slip] * P[L[pg.STOP_LIMIT] + j]
            log(S, D, pg.SLIP)


@compiled
def orient(P, L, S, D, slot):
    """Set how the guards of a mode are read: the extremum by the direction of motion, a stop by its side.

    The direction is 0 at rest, which is left without an extremum.
    """
    at, own = slot_of(L, slot), L[pg.G]
    for g in range(L[at + tb.GUARD_COUNT]):
        what, sign, offset = L[at + tb.FIRST_GUARD + 2 * g], 1.0, 0.0
        if what == own:
            sign = -D[st.DIRECTION] * 1.0
        elif what > own:
            j, side = (what - own - 1) // 2, (what - own - 1) % 2
            if D[D[st.SLIP] + j] == 0:
                sign, offset = 1.0 - 2.0 * side, -P[L[pg.STOP_LIMIT] + j]
            else:
                sign = -D[D[st.SLIP] + j] * 1.0
        S[D[st.SIGN] + g], S[D[st.OFFSET] + g] = sign, offset


@compiled
def overdue(P, L, S, D, slot):
    """First guard that is above zero, or at zero and about to rise: value, rate and second rate decide in turn.

    Zero is judged against the size of the guard's terms and of what its rate makes of a short step.
    """
    at, block, forms, now = slot_of(L, slot), block_of(L, slot), L[tb.FORMS], D[st.NOW_GUARDS]
    size = 0.0
    for i in range(L[pg.A]):
        size += abs(S[i])
    short = P[block + L[tb.STEPS] + L[at + tb.FINEST_LEVEL]]
    for g in range(L[at + tb.GUARD_COUNT] - pg.WATCHED):
        row, sign, value = L[at + tb.FIRST_GUARD + 2 * g + 1], S[D[st.SIGN] + g], S[D[st.OFFSET] + g]
        sizes = block + L[tb.SIZES] + 3 * row
        # What its terms leave of it by rounding; an offset (the limit of a stop) is as large as what it bounds.
        S[D[st.FLOOR] + g] = 1e-13 * (size * P[sizes] + abs(value))
        tolerance = TINY
        for k in range(3):
            value += sign * S[now + k * forms + row]
            zero = tolerance * size * (P[sizes + k] + (short * P[sizes + k + 1] if k < 2 else 0.0))
            if value > zero:
                return g
            if value < -zero:
                break
            value, tolerance = 0.0, tolerance * 10.0
    return NONE


@compiled
def flow(P, L, S, D, slot, out):
    """Rate of the state."""
    multiply(P, block_of(L, slot) + L[tb.MATRIX], L[pg.ROWS], L[pg.COLUMNS], S, 0, out)


@compiled
def enter_event(P, L, S, D, slot, guard):
    """Sensitivity of the time of an event, and the sensitivities of the state taken to that time."""
    count = D[st.SENSITIVITIES]
    if count == 0:
        return
    rate_at = vector(L, D, FLOW)
    flow(P, L, S, D, slot, rate_at)
    if guard != NONE:
        # The sign with which the guard is read cancels in the quotient.
        rows, form = L[pg.ROWS], L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * guard + 1]
        row = block_of(L, slot) + L[tb.LINES] + 2 * form * rows
        rate = dot(P, row, S, rate_at, rows)
        for s in range(count):
            change = dot(P, row, S, D[st.PHI] + s * rows, rows)
            S[D[st.EVENT_PHI] + s] = -change / rate if rate != 0.0 else 0.0
    _move(L, S, D, rate_at, 1.0)


@compiled
def leave_event(P, L, S, D, slot):
    """Sensitivities at fixed time again, on the motion after the event (the saltation)."""
    if D[st.SENSITIVITIES]:
        flow(P, L, S, D, slot, vector(L, D, FLOW))
        _move(L, S, D, vector(L, D, FLOW), -1.0)


@compiled
def _move(L, S, D, rate_at, sign):
    for s in range(D[st.SENSITIVITIES]):
        shift = sign * S[D[st.EVENT_PHI] + s]
        for i in range(L[pg.N]):
            S[D[st.PHI] + s * L[pg.ROWS] + i] += S[rate_at + i] * shift


@compiled
def leave_rest(P, L, S, D, slot):
    """Direction in which sum T_i x_i begins to move: the sign of its first rate that is not zero to rounding."""
    at, block, size = slot_of(L, slot), block_of(L, slot), 0.0
    for i in range(L[pg.A]):
        size += abs(S[i])
    for g in range(L[at + tb.GUARD_COUNT]):
        if L[at + tb.FIRST_GUARD + 2 * g] != L[pg.G]:
            continue
        row = L[at + tb.FIRST_GUARD + 2 * g + 1]
        for k in range(3):
            value = S[D[st.NOW_GUARDS] + k * L[tb.FORMS] + row]
            if abs(value) > TINY * size * P[block + L[tb.SIZES] + 3 * row + k]:
                D[st.DIRECTION] = 1 if value > 0.0 else -1
                break
    orient(P, L, S, D, slot)


@compiled
def settle(P, L, S, D):
    """Carry out whatever is due at this instant without time passing.

    Returns the mode, with its guards read at NOW_GUARDS, or NONE where the events do not end.
    """
    for _ in range(AT_ONCE):
        slot = seek(L, D, D[st.CONFIGURATION], D[st.SLIP])
        if slot == NONE:
            build(P, L, D, D[st.CONFIGURATION], D[st.SLIP])
            slot = L[tb.HELD] - 1
        orient(P, L, S, D, slot)
        read_guards(P, L, S, D, slot, 0, D[st.NOW_GUARDS])
        if D[st.DIRECTION] == 0:
            leave_rest(P, L, S, D, slot)
        guard = overdue(P, L, S, D, slot)
        if guard == NONE:
            return slot
        happen(P, L, S, D, L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * guard])
    return NONE


@compiled
def clock_event(S, D):
    """The next scheduled event: its time, and whether the switch opens (1) or acts (0), or NONE."""
    due = S[D[st.CLOCK] + st.OPENS]
    kind = 1 if due < np.inf else NONE
    if D[st.WAITING] and S[D[st.QUEUE]] < due:
        due, kind = S[D[st.QUEUE]], 0
    return due, kind


@compiled
def clock_happens(P, L, S, D, kind):
    """Carry out a scheduled event."""
    if kind == 1:
        release(P, L, S, D)
        return
    queue, polarities, phi, count = D[st.QUEUE], D[st.POLARITY], D[st.QUEUE_PHI], D[st.SENSITIVITIES]
    polarity = D[polarities]
    for k in range(1, D[st.WAITING]):
        S[queue + k - 1], D[polarities + k - 1] = S[queue + k], D[polarities + k]
        for s in range(count):
            S[phi + (k - 1) * count + s] = S[phi + k * count + s]
    D[st.WAITING] -= 1
    act(P, L, S, D, polarity)


@compiled
def begin_tape(L, S, D):
    """Write down where a motion from one event to the next begins: time and state, configuration and slips."""
    at, kind = D[st.TAPE] + D[st.TAPED] * (2 + L[pg.A]), D[st.TAPE_KIND] + D[st.TAPED] * (2 + L[pg.H])
    S[at] = S[D[st.CLOCK]]
    for i in range(L[pg.A]):
        S[at + 2 + i] = S[i]
    D[kind] = D[st.CONFIGURATION]
    for j in range(L[pg.H]):
        D[kind + 2 + j] = D[D[st.SLIP] + j]


@compiled
def end_tape(L, S, D, slot, guard, due, kind):
    """Write down when a motion ends, and by what: a guard, the switch that opens or acts, or nothing."""
    at = D[st.TAPED]
    S[D[st.TAPE] + at * (2 + L[pg.A]) + 1] = S[D[st.CLOCK]]
    what = L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * guard] if guard != NONE else NOTHING
    if guard == NONE and S[D[st.CLOCK]] >= due:
        what = OPENS if kind == 1 else ACTS
    D[D[st.TAPE_KIND] + at * (2 + L[pg.H]) + 1] = what
    D[st.TAPED] += 1


@compiled
def advance(P, L, S, D, t_end):
    """Run to t_end through all events; returns DONE, CHATTER or INVALID (the state is not finite)."""
    clock = D[st.CLOCK]
    busy, last = 0, S[clock]
    while True:
        slot = settle(P, L, S, D)
        if slot == NONE:
            return CHATTER
        if D[st.BETWEEN]:
            leave_event(P, L, S, D, slot)
            D[st.BETWEEN] = 0
        D[st.MODE] = slot
        due, kind = clock_event(S, D)
        if D[st.TAPED] < D[st.TAPE_ROOM]:
            begin_tape(L, S, D)
        guard = march(P, L, S, D, slot, min(due, t_end))
        if D[st.TAPED] < D[st.TAPE_ROOM]:
            end_tape(L, S, D, slot, guard, due, kind)
        if not np.isfinite(S[0]):
            return INVALID
        if guard == NONE and due > t_end:
            return DONE
        busy, last = busy + 1 if S[clock] == last else 0, S[clock]
        if busy > AT_ONCE:
            return CHATTER
        D[st.HAPPENED] += 1
        if D[st.HAPPENED] % REFRESHED == 0 and L[pg.SIGNAL_KIND] == pg.TONES:
            set_tones(P, L, S, S[clock])
        count = D[st.SENSITIVITIES]
        if guard == NONE:
            for s in range(count):
                known = D[st.OPENS_PHI] + s if kind == 1 else D[st.QUEUE_PHI] + s
                S[D[st.EVENT_PHI] + s] = S[known]
        enter_event(P, L, S, D, slot, guard)
        D[st.BETWEEN] = 1
        if guard != NONE:
            happen(P, L, S, D, L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * guard])
        else:
            clock_happens(P, L, S, D, kind)
