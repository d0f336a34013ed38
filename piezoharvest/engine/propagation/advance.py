"""Running through time: motion within a mode, event, motion in the next."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.events.event_actions import clock_event, clock_happens, happen
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import set_tones
from piezoharvest.engine.memory.tables import slot_of
from piezoharvest.engine.propagation.event_cascade import AT_ONCE, settle
from piezoharvest.engine.propagation.propagate import march
from piezoharvest.engine.propagation.saltation import enter_event, leave_event
from piezoharvest.engine.propagation.smooth_elements import follow, settle_smooth
from piezoharvest.engine.propagation.trajectory import begin_tape, end_tape

DONE, CHATTER, INVALID, EXHAUSTED = range(4)
REFRESHED = 32  # events after which the tones are set from their phase again


@compiled
def advance(P, L, S, D, t_end):
    """Run to t_end through all events; returns DONE, CHATTER, INVALID (the state is not finite) or EXHAUSTED."""
    clock = D[st.CLOCK]
    busy, last = 0, S[clock]
    while True:
        slot = settle_smooth(P, L, S, D) if L[pg.ELEMENTS] else settle(P, L, S, D)
        if slot == NONE:
            return CHATTER
        if D[st.BETWEEN]:
            leave_event(P, L, S, D, slot)
            D[st.BETWEEN] = 0
        D[st.MODE] = slot
        due, kind = clock_event(S, D)
        if D[st.TAPED] < D[st.TAPE_ROOM]:
            begin_tape(L, S, D)
        if L[pg.ELEMENTS]:
            guard = follow(P, L, S, D, slot, min(due, t_end))
        else:
            guard = march(P, L, S, D, slot, min(due, t_end))
        if D[st.TAPED] < D[st.TAPE_ROOM]:
            end_tape(L, S, D, slot, guard, due, kind)
        if not np.isfinite(S[0]):
            return INVALID if L[tb.LEFT] > 0 else EXHAUSTED
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
