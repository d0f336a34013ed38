"""What happens at an instant: diodes, the switch and its clocks, stops that slip and stick, and their sensitivities."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine.algebra import dot
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.march import NONE, march
from piezoharvest.engine.state import (
    ACTED,
    BETWEEN,
    CLOSED,
    COLUMNS,
    CONFIGURATION,
    DIRECTION,
    LOGGED,
    NOW,
    OPENS,
    QUEUE,
    WAITING,
    orient,
    set_tones,
)  # fmt: skip
from piezoharvest.engine.tables import seek

DONE, MISSING, CHATTER, INVALID = range(4)
TINY = 1e-12  # a guard this small, relative to its terms, is zero
AT_ONCE = 60  # events at one instant beyond which the model chatters


@compiled
def log(S, code):
    """Write an event down."""
    if S.discrete[LOGGED] < len(S.log_time):
        S.log_time[S.discrete[LOGGED]] = S.clock[NOW]
        S.log_code[S.discrete[LOGGED]] = code
    S.discrete[LOGGED] += 1


@compiled
def stored(P, z):
    """Stored energy, J."""
    total, own = 0.0, z[: P.storage.shape[0]]
    for i in range(len(own)):
        total += 0.5 * own[i] * dot(P.storage[i], own)
    return total


@compiled
def cut(P, S, state):
    """Set a current to zero; its energy is lost in the shunt."""
    before = stored(P, S.z)
    S.z[state] = 0.0
    for s in range(S.discrete[COLUMNS]):
        S.phi[s, state] = 0.0
    if len(S.energy):
        S.energy[pg.SHUNT_LOSS] += before - stored(P, S.z)


@compiled
def extract(P, S):
    """Take the electrode voltage to zero at once: charge moves, stops with it, piece by piece as they saturate."""
    delivered = 0.0
    for _ in range(2 * len(S.slip) + 2):
        voltage = dot(P.voltage_row, S.z)
        if voltage == 0.0:
            break
        sign = -1 if voltage > 0.0 else 1
        # A stop that slipped the other way sticks as soon as the charge turns.
        slope = P.voltage_row[P.charge]
        for j in range(len(S.slip)):
            if S.slip[j] == -sign:
                S.slip[j] = 0
            if S.slip[j] == 0:
                slope += P.voltage_row[P.stop_state[j]]
        move, first = -voltage / slope, NONE
        for j in range(len(S.slip)):
            if S.slip[j] == 0:
                reach = sign * P.stop_limit[j] - S.z[P.stop_state[j]]
                if abs(reach) < abs(move):
                    move, first = reach, j
        for s in range(S.discrete[COLUMNS]):
            shift = -dot(P.voltage_row, S.phi[s]) / slope if first == NONE else -S.phi[s, P.stop_state[first]]
            _shift(P, S.phi[s], S.slip, shift)
        delivered -= P.scale[P.charge] * move * (voltage + 0.5 * slope * move)
        if len(S.energy):
            for j in range(len(S.slip)):
                if S.slip[j] != 0:
                    S.energy[pg.HYSTERESIS] += P.stop_weight[j] * P.stop_limit[j] * abs(move)
        _shift(P, S.z, S.slip, move)
        if first == NONE:
            break
        S.slip[first] = sign
        S.z[P.stop_state[first]] = sign * P.stop_limit[first]
    if len(S.energy):
        S.energy[pg.HARVESTED] += P.efficiency * delivered
        S.energy[pg.SHUNT_LOSS] += (1.0 - P.efficiency) * delivered


@compiled
def _shift(P, z, slip, move):
    z[P.charge] += move
    for j in range(len(slip)):
        if slip[j] == 0:
            z[P.stop_state[j]] += move


@compiled
def act(P, S, polarity):
    """The switch acts, at a maximum (polarity +1) or a minimum of sum T_i x_i."""
    if P.switched == 2:
        extract(P, S)
        log(S, pg.EXTRACT)
        return
    if S.discrete[CLOSED]:
        return
    S.discrete[CLOSED] = 1
    S.discrete[CONFIGURATION] = P.closed[1 if polarity > 0 else 0, S.discrete[CONFIGURATION]]
    S.clock[OPENS] = S.clock[NOW] + P.on_time
    S.opens_phi[:] = S.event_phi
    log(S, pg.CLOSE)


@compiled
def release(P, S):
    """The switch opens; current that still flows is cut."""
    S.discrete[CLOSED] = 0
    S.discrete[CONFIGURATION] = P.opened[S.discrete[CONFIGURATION]]
    S.clock[OPENS] = np.inf
    cut(P, S, P.cut)
    log(S, pg.OPEN)


@compiled
def extremum(P, S):
    """Sum T_i x_i is at an extremum: an action is due after the lag, unless the last one was too short ago."""
    polarity = S.discrete[DIRECTION]
    S.discrete[DIRECTION] = -polarity
    if P.switched == 0:
        return
    due = S.clock[NOW] + P.lag
    if due - S.clock[ACTED] < P.hold_off * (1 - 1e-9) or S.discrete[WAITING] == QUEUE:
        return
    S.clock[ACTED] = due
    if P.early:
        polarity = -polarity
    if P.lag == 0.0:
        act(P, S, polarity)
        return
    place = S.discrete[WAITING]
    S.queue[place], S.queue_polarity[place] = due, polarity
    S.queue_phi[place] = S.event_phi
    S.discrete[WAITING] += 1


@compiled
def happen(P, S, guard):
    """Carry out what a guard stands for."""
    own = P.guard_target.shape[1]
    if guard < own:
        configuration = S.discrete[CONFIGURATION]
        if P.guard_cut[configuration, guard] >= 0:
            cut(P, S, P.guard_cut[configuration, guard])
        log(S, P.guard_code[configuration, guard])
        S.discrete[CONFIGURATION] = P.guard_target[configuration, guard]
    elif guard == own:
        extremum(P, S)
    else:
        j, side = (guard - own - 1) // 2, (guard - own - 1) % 2
        if S.slip[j] != 0:
            S.slip[j] = 0
            log(S, pg.STICK)
        else:
            S.slip[j] = 1 if side == 0 else -1
            S.z[P.stop_state[j]] = S.slip[j] * P.stop_limit[j]
            log(S, pg.SLIP)


@compiled
def overdue(P, T, S, slot):
    """First guard that is above zero, or at zero and about to rise: value, rate and second rate decide in turn.

    Zero is judged against the size of the guard's terms and of what its rate makes of a short step.
    """
    z, sign, guards, sizes, slip = S.z, S.sign, T.guards, T.guard_size, S.slip
    targets, configuration, own = P.guard_target, S.discrete[CONFIGURATION], P.guard_target.shape[1]
    size = 0.0
    for i in range(len(z)):
        size += abs(z[i])
    short = 0.5 ** T.finest[slot] * P.step
    for g in range(len(sign) - pg.WATCHED):
        if g < own and targets[configuration, g] < 0:
            continue
        if g > own and (g - own - 1) % 2 == 1 and slip[(g - own - 1) // 2] != 0:
            continue
        for k in range(3):
            value = 0.0
            for i in range(len(z)):
                value += guards[slot, 3 * g + k, i] * z[i]
            value *= sign[g]
            tolerance = sizes[slot, 3 * g + k] + (short * sizes[slot, 3 * g + k + 1] if k < 2 else 0.0)
            tolerance *= TINY * 10.0**k * size
            if value > tolerance:
                return g
            if value < -tolerance:
                break
    return NONE


@compiled
def _flow(matrix, z, out):
    for i in range(len(z)):
        out[i] = dot(matrix[i], z)


@compiled
def enter_event(P, T, S, slot, guard):
    """Sensitivity of the time of an event, and the sensitivities of the state taken to that time."""
    if S.discrete[COLUMNS] == 0:
        return
    flow = S.work[6]
    _flow(T.matrix[slot], S.z, flow)
    if guard != NONE:
        # The sign with which the guard is read cancels in the quotient.
        row = T.guards[slot, 3 * guard]
        rate = dot(row, flow)
        for s in range(S.discrete[COLUMNS]):
            S.event_phi[s] = -dot(row, S.phi[s]) / rate if rate != 0.0 else 0.0
    _move(P, S, flow, 1.0)


@compiled
def leave_event(P, T, S, slot):
    """Sensitivities at fixed time again, on the motion after the event (the saltation)."""
    if S.discrete[COLUMNS]:
        flow = S.work[6]
        _flow(T.matrix[slot], S.z, flow)
        _move(P, S, flow, -1.0)


@compiled
def _move(P, S, flow, sign):
    for s in range(S.discrete[COLUMNS]):
        for i in range(P.rate.shape[1]):
            S.phi[s, i] += sign * flow[i] * S.event_phi[s]


@compiled
def leave_rest(P, T, S, slot):
    """Direction in which sum T_i x_i begins to move: the sign of its first rate that is not zero to rounding."""
    first, size = 3 * P.guard_target.shape[1], 0.0
    for i in range(len(S.z)):
        size += abs(S.z[i])
    for k in range(3):
        value = dot(T.guards[slot, first + k], S.z)
        if abs(value) > TINY * size * T.guard_size[slot, first + k]:
            S.discrete[DIRECTION] = 1 if value > 0.0 else -1
            break
    orient(P, S)


@compiled
def settle(P, T, S):
    """Carry out whatever is due at this instant without time passing.

    Returns DONE with the mode, or MISSING where the tables of the mode have to be built first, or CHATTER.
    """
    for _ in range(AT_ONCE):
        orient(P, S)
        slot = seek(T, S.discrete[CONFIGURATION], S.slip)
        if slot == NONE:
            return MISSING, slot
        if S.discrete[DIRECTION] == 0:
            leave_rest(P, T, S, slot)
        guard = overdue(P, T, S, slot)
        if guard == NONE:
            return DONE, slot
        happen(P, S, guard)
    return CHATTER, NONE


@compiled
def clock_event(P, S):
    """The next scheduled event: its time, and whether the switch opens (1) or acts (0), or NONE."""
    due, kind = S.clock[OPENS], 1 if S.clock[OPENS] < np.inf else NONE
    if S.discrete[WAITING] and S.queue[0] < due:
        due, kind = S.queue[0], 0
    return due, kind


@compiled
def clock_happens(P, S, kind):
    """Carry out a scheduled event."""
    if kind == 1:
        release(P, S)
        return
    polarity = S.queue_polarity[0]
    for k in range(1, S.discrete[WAITING]):
        S.queue[k - 1], S.queue_polarity[k - 1] = S.queue[k], S.queue_polarity[k]
        S.queue_phi[k - 1] = S.queue_phi[k]
    S.discrete[WAITING] -= 1
    act(P, S, polarity)


@compiled
def advance(P, T, S, t_end):
    """Run to t_end through all events; returns DONE, MISSING, CHATTER or INVALID (the state is not finite).

    MISSING asks for the tables of the mode that the state is in; after that, call again: it goes on where it was.
    """
    busy, last = 0, S.clock[NOW]
    while True:
        status, slot = settle(P, T, S)
        if status != DONE:
            return status
        if S.discrete[BETWEEN]:
            leave_event(P, T, S, slot)
            S.discrete[BETWEEN] = 0
        due, kind = clock_event(P, S)
        guard = march(P, T, S, slot, min(due, t_end))
        if not np.isfinite(S.z[0]):
            return INVALID
        if guard == NONE and due > t_end:
            return DONE
        busy, last = busy + 1 if S.clock[NOW] == last else 0, S.clock[NOW]
        if busy > AT_ONCE:
            return CHATTER
        if P.signal_kind == pg.TONES:
            set_tones(P, S, S.clock[NOW])
        if guard == NONE:
            for s in range(S.discrete[COLUMNS]):
                S.event_phi[s] = S.opens_phi[s] if kind == 1 else S.queue_phi[0, s]
        enter_event(P, T, S, slot, guard)
        S.discrete[BETWEEN] = 1
        if guard != NONE:
            happen(P, S, guard)
        else:
            clock_happens(P, S, kind)
