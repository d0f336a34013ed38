"""Actions of events: diodes, the switch and its clocks, stops that slip and stick."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.events.charge_extraction import extract_charge
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import QUEUE_LENGTH, dot_column


@compiled
def log_event(S, D, code):
    """Record an event in the log, and count it by its kind."""
    if D[D[st.COUNTS] + code] == 0:
        S[D[st.FIRST_TIMES] + code] = S[D[st.CLOCK] + st.NOW]
    D[D[st.COUNTS] + code] += 1
    if D[st.LOGGED] < D[st.LOG_ROOM]:
        S[D[st.LOG_TIME] + D[st.LOGGED]] = S[D[st.CLOCK] + st.NOW]
        D[D[st.LOG_CODE] + D[st.LOGGED]] = code
    D[st.LOGGED] += 1


@compiled
def cut_state(P, L, S, D, state):
    """Set a state to zero: a share of its energy is harvested, the rest counts as loss of the shunt."""
    # Of the state alone: the difference of all stored energies would be that of numbers which hardly differ.
    released = 0.5 * P[L[pg.STORAGE] + state * (L[pg.SIGNAL] + 1)] * S[state] ** 2
    S[state] = 0.0
    for s in range(D[st.SENSITIVITIES]):
        S[D[st.PHI] + s * L[pg.ROWS] + state] = 0.0
    if D[st.ENERGIES]:
        harvested = P[L[pg.RECOVERED] + state] * released
        S[D[st.ENERGY] + pg.HARVESTED] += harvested
        S[D[st.ENERGY] + pg.SHUNT_LOSS] += released - harvested


@compiled
def drive_gate(P, L, S, D):
    """Take the energy of one action of the switch from what is harvested."""
    if D[st.ENERGIES]:
        S[D[st.ENERGY] + pg.HARVESTED] -= P[L[pg.GATE_ENERGY]]
        S[D[st.ENERGY] + pg.SHUNT_LOSS] += P[L[pg.GATE_ENERGY]]


@compiled
def operate_switch(P, L, S, D, polarity):
    """Operate the switch, at a maximum (polarity +1) or a minimum of sum T_i x_i."""
    if L[pg.SWITCHED] == 2:
        extract_charge(P, L, S, D)
        drive_gate(P, L, S, D)
        log_event(S, D, pg.EXTRACT)
        return
    after = L[L[pg.CLOSED] + (L[pg.C] if polarity > 0 else 0) + D[st.CONFIGURATION]]
    if D[st.CLOSED] or after == D[st.CONFIGURATION]:  # a switch without power stays as it is
        return
    D[st.CLOSED] = 1
    drive_gate(P, L, S, D)
    D[st.CONFIGURATION] = after
    S[D[st.CLOCK] + st.OPENS] = S[D[st.CLOCK] + st.NOW] + P[L[pg.ON_TIME]] * P[L[pg.STAGE] + D[st.CONFIGURATION]]
    for s in range(D[st.SENSITIVITIES]):
        S[D[st.OPENS_PHI] + s] = S[D[st.EVENT_PHI] + s]
    log_event(S, D, pg.CLOSE)


@compiled
def assign(P, L, S, D, configuration):
    """Set the states that a controller sets at the end of a configuration, one after the other."""
    rows, a = L[pg.ROWS], L[pg.A]
    for m in range(L[L[pg.ASSIGNED_FIRST] + configuration], L[L[pg.ASSIGNED_FIRST] + configuration + 1]):
        row, k, step = L[pg.ASSIGNED_ROW] + m * a, L[L[pg.ASSIGNED_STATE] + m], P[L[pg.ASSIGNED_STEP] + m]
        value, limit, slope = dot_column(P, row, 1, S, 0, a), P[L[pg.ASSIGNED_LIMIT] + m], 1.0
        if step > 0.0:
            value = step * np.floor(value / step + 0.5)
        if abs(value) > limit:
            value, slope = min(max(value, -limit), limit), 0.0
        S[k] = value
        for s in range(D[st.SENSITIVITIES]):
            phi = D[st.PHI] + s * rows
            S[phi + k] = slope * dot_column(P, row, 1, S, phi, L[pg.N])


@compiled
def tick(P, L, S, D):
    """Let a controller act, and set its clock."""
    assign(P, L, S, D, D[st.CONFIGURATION])
    D[st.CONFIGURATION] = L[L[pg.OPENED] + D[st.CONFIGURATION]]
    S[D[st.CLOCK] + st.OPENS] += P[L[pg.ON_TIME]] * P[L[pg.STAGE] + D[st.CONFIGURATION]]
    log_event(S, D, pg.TICK)


@compiled
def open_switch(P, L, S, D):
    """Open the switch, or move on to its next stage, and cut the currents that remain."""
    after = L[L[pg.OPENED] + D[st.CONFIGURATION]]
    D[st.CONFIGURATION] = after
    for k in range(L[pg.N]):
        if L[L[pg.CUT] + k]:
            cut_state(P, L, S, D, k)
    if L[L[pg.OPENED] + after] != after:
        S[D[st.CLOCK] + st.OPENS] = S[D[st.CLOCK] + st.NOW] + P[L[pg.ON_TIME]] * P[L[pg.STAGE] + after]
        drive_gate(P, L, S, D)
        log_event(S, D, pg.STEP_ON)
        return
    D[st.CLOSED] = 0
    S[D[st.CLOCK] + st.OPENS] = np.inf
    log_event(S, D, pg.OPEN)


@compiled
def schedule_action(P, L, S, D):
    """Schedule an action after an extremum of sum T_i x_i, with the lag, unless the last one was too recent.

    Nothing is scheduled where the electrode voltage is below the detector's threshold. With an action more than the
    queue has room for, more are `WAITING` than that, and the run ends.
    """
    polarity = D[st.DIRECTION]
    D[st.DIRECTION] = -polarity
    if L[pg.SWITCHED] == 0:
        return
    threshold = P[L[pg.THRESHOLD]]
    if threshold > 0.0 and abs(dot_column(P, L[pg.VOLTAGE_ROW], 1, S, 0, L[pg.A])) < threshold:
        return
    lag, clock = P[L[pg.LAG]], D[st.CLOCK]
    due = S[clock + st.NOW] + lag
    if due - S[clock + st.ACTED] < P[L[pg.HOLD_OFF]] * (1 - 1e-9):
        return
    S[clock + st.ACTED] = due
    if P[L[pg.EARLY]] != 0.0:
        polarity = -polarity
    if lag == 0.0:
        operate_switch(P, L, S, D, polarity)
        return
    if D[st.WAITING] >= QUEUE_LENGTH:
        D[st.WAITING] = QUEUE_LENGTH + 1
        return
    place, count = D[st.WAITING], D[st.SENSITIVITIES]
    S[D[st.QUEUE] + place] = due
    D[D[st.POLARITY] + place] = polarity
    for s in range(count):
        S[D[st.QUEUE_PHI] + place * count + s] = S[D[st.EVENT_PHI] + s]
    D[st.WAITING] += 1


@compiled
def trigger_event(P, L, S, D, what):
    """Carry out the event of a guard."""
    own, configuration = L[pg.G], D[st.CONFIGURATION]
    if what < own:
        k = configuration * own + what
        if L[L[pg.GUARD_CUT] + k] >= 0:
            cut_state(P, L, S, D, L[L[pg.GUARD_CUT] + k])
        if L[L[pg.GUARD_CODE] + k] != NONE:
            log_event(S, D, L[L[pg.GUARD_CODE] + k])
        D[st.CONFIGURATION] = L[L[pg.GUARD_TARGET] + k]
    elif what == own:
        schedule_action(P, L, S, D)
    else:
        j, side = (what - own - 1) // 2, (what - own - 1) % 2
        slip = D[st.SLIP] + j
        if D[slip] != 0:
            D[slip] = 0
            log_event(S, D, pg.STICK)
        else:
            D[slip] = 1 if side == 0 else -1
            S[L[L[pg.STOP_STATE] + j]] = D[slip] * P[L[pg.STOP_LIMIT] + j]
            log_event(S, D, pg.SLIP)


@compiled
def next_scheduled(S, D):
    """Return the time of the next scheduled event and its kind: the switch opens (1) or acts (0), or NONE."""
    due = S[D[st.CLOCK] + st.OPENS]
    kind = 1 if due < np.inf else NONE
    if D[st.WAITING] and S[D[st.QUEUE]] < due:
        due, kind = S[D[st.QUEUE]], 0
    return due, kind


@compiled
def trigger_scheduled(P, L, S, D, kind):
    """Carry out a scheduled event."""
    if kind == 1:
        if L[pg.SWITCHED] == pg.CLOCKED:
            tick(P, L, S, D)
        else:
            open_switch(P, L, S, D)
        return
    queue, polarities, phi, count = D[st.QUEUE], D[st.POLARITY], D[st.QUEUE_PHI], D[st.SENSITIVITIES]
    polarity = D[polarities]
    for k in range(1, D[st.WAITING]):
        S[queue + k - 1], D[polarities + k - 1] = S[queue + k], D[polarities + k]
        for s in range(count):
            S[phi + (k - 1) * count + s] = S[phi + k * count + s]
    D[st.WAITING] -= 1
    operate_switch(P, L, S, D, polarity)
