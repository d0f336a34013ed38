"""What happens at an instant: diodes, the switch and its clocks, stops that slip and stick, and their sensitivities."""

from __future__ import annotations

import numpy as np
from numba import njit

from piezoharvest.engine import program as pg
from piezoharvest.engine.march import NONE, TINY, dot, march, read_guards
from piezoharvest.engine.state import (
    ACTED, CLOSED, CONFIGURATION, DIRECTION, LOGGED, NOW, OPENS, QUEUE, WAITING, set_tones,
)  # fmt: skip
from piezoharvest.engine.tables import find

DONE, CHATTER, INVALID = range(3)
AT_ONCE = 60  # events at one instant beyond which the model chatters


@njit(cache=True)
def log(S, code):
    """Write an event down."""
    if S.discrete[LOGGED] < len(S.log_time):
        S.log_time[S.discrete[LOGGED]] = S.clock[NOW]
        S.log_code[S.discrete[LOGGED]] = code
    S.discrete[LOGGED] += 1


@njit(cache=True)
def stored(P, z):
    """Stored energy, J."""
    total, own = 0.0, z[: P.storage.shape[0]]
    for i in range(len(own)):
        total += 0.5 * own[i] * dot(P.storage[i], own)
    return total


@njit(cache=True)
def cut(P, S, state):
    """Set a current to zero; its energy is lost in the shunt."""
    before = stored(P, S.z)
    S.z[state] = 0.0
    S.phi[state] = 0.0
    if len(S.energy):
        S.energy[pg.SHUNT_LOSS] += before - stored(P, S.z)


@njit(cache=True)
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
        for s in range(S.phi.shape[1]):
            if first == NONE:
                shift = -dot(P.voltage_row, S.phi[:, s].copy()) / slope
            else:
                shift = -S.phi[P.stop_state[first], s]
            _shift(P, S.phi[:, s], S.slip, shift)
        delivered -= move * (voltage + 0.5 * slope * move)
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


@njit(cache=True)
def _shift(P, z, slip, move):
    z[P.charge] += move
    for j in range(len(slip)):
        if slip[j] == 0:
            z[P.stop_state[j]] += move


@njit(cache=True)
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


@njit(cache=True)
def release(P, S):
    """The switch opens; current that still flows is cut."""
    S.discrete[CLOSED] = 0
    S.discrete[CONFIGURATION] = P.opened[S.discrete[CONFIGURATION]]
    S.clock[OPENS] = np.inf
    cut(P, S, P.cut)
    log(S, pg.OPEN)


@njit(cache=True)
def extremum(P, S):
    """sum T_i x_i is at an extremum: an action is due after the lag, unless the last one was too short ago."""
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


@njit(cache=True)
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


@njit(cache=True)
def active(P, S, guard):
    """Whether a guard exists in the mode now."""
    own = P.guard_target.shape[1]
    if guard < own:
        return P.guard_target[S.discrete[CONFIGURATION], guard] >= 0
    if guard == own:
        return True
    j, side = (guard - own - 1) // 2, (guard - own - 1) % 2
    return S.slip[j] == 0 or side == 0


@njit(cache=True)
def _size(row, z):
    """Sum of the magnitudes of a form's terms."""
    total = 0.0
    for i in range(len(z)):
        total += abs(row[i] * z[i])
    return total


@njit(cache=True)
def overdue(P, T, S, slot):
    """First guard that is above zero, or at zero and about to rise: value, rate and second rate decide in turn."""
    rows = T.guards[slot]
    trigger = P.guard_target.shape[1]
    short = P.step * 0.5 ** T.finest[slot]
    for g in range(rows.shape[0]):
        if not active(P, S, g):
            continue
        sign = -1.0 * S.discrete[DIRECTION] if g == trigger else 1.0
        # Zero is judged against the terms of the guard and of what its rate makes of a short step.
        terms = (_size(rows[g, 0], S.z), _size(rows[g, 1], S.z), _size(rows[g, 2], S.z))
        for k in range(3):
            value = sign * dot(rows[g, k], S.z)
            tolerance = TINY * 10.0**k * (terms[k] + (short * terms[k + 1] if k < 2 else 0.0))
            if value > tolerance:
                return g
            if value < -tolerance:
                break
    return NONE


@njit(cache=True)
def enter_event(P, T, S, slot, guard):
    """Sensitivity of the time of an event, and the sensitivities of the state taken to that time."""
    if S.phi.shape[1] == 0:
        return
    flow = T.matrix[slot] @ S.z
    if guard != NONE:
        # The sign by which the extremum's guard is read cancels in the quotient.
        row = T.guards[slot, guard, 0]
        rate = dot(row, flow)
        if rate != 0.0:
            S.event_phi[:] = -(row @ S.phi) / rate
        else:
            S.event_phi[:] = 0.0
    S.phi[:] += np.outer(flow, S.event_phi)
    S.phi[P.mass.shape[2] :] = 0.0


@njit(cache=True)
def leave_event(P, T, S, slot):
    """Sensitivities at fixed time again, on the motion after the event (the saltation)."""
    if S.phi.shape[1]:
        flow = T.matrix[slot] @ S.z
        S.phi[:] -= np.outer(flow, S.event_phi)
        S.phi[P.mass.shape[2] :] = 0.0


@njit(cache=True)
def settle(P, T, S, slot):
    """Carry out whatever is due at this instant without time passing, and return the mode, or NONE if it chatters."""
    for _ in range(AT_ONCE):
        guard = overdue(P, T, S, slot)
        if guard == NONE:
            return slot
        happen(P, S, guard)
        slot = find(P, T, S.discrete[CONFIGURATION], S.slip)
    return NONE


@njit(cache=True)
def clock_event(P, S):
    """The next scheduled event: its time, and whether the switch opens (1) or acts (0), or NONE."""
    due, kind = S.clock[OPENS], 1 if S.clock[OPENS] < np.inf else NONE
    if S.discrete[WAITING] and S.queue[0] < due:
        due, kind = S.queue[0], 0
    return due, kind


@njit(cache=True)
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


@njit(cache=True)
def advance(P, T, S, t_end):
    """Run to t_end through all events; returns DONE, CHATTER or INVALID (the state is not finite)."""
    S.event_phi[:] = 0.0
    slot = settle(P, T, S, find(P, T, S.discrete[CONFIGURATION], S.slip))
    while slot != NONE:
        due, kind = clock_event(P, S)
        guard = march(P, T, S, slot, min(due, t_end))
        if not np.isfinite(S.z[0]):
            return INVALID
        if guard == NONE and due > t_end:
            return DONE
        if P.signal_kind == pg.TONES:
            set_tones(P, S, S.clock[NOW])
        if guard != NONE:
            enter_event(P, T, S, slot, guard)
            happen(P, S, guard)
        else:
            if S.phi.shape[1]:
                S.event_phi[:] = S.opens_phi if kind == 1 else S.queue_phi[0]
            enter_event(P, T, S, slot, NONE)
            clock_happens(P, S, kind)
        slot = settle(P, T, S, find(P, T, S.discrete[CONFIGURATION], S.slip))
        if slot != NONE:
            leave_event(P, T, S, slot)
    return CHATTER
