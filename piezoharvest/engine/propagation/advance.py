"""Main loop of a run: motion within a mode, event, motion in the next mode."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.events.event_actions import next_scheduled, trigger_event, trigger_scheduled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import QUEUE_LENGTH, set_tones
from piezoharvest.engine.memory.tables import slot_of
from piezoharvest.engine.propagation.event_cascade import MAX_EVENTS, process_due_events
from piezoharvest.engine.propagation.event_free_steps import make_free_stage
from piezoharvest.engine.propagation.propagate import propagate_mode
from piezoharvest.engine.propagation.saltation import enter_event, leave_event
from piezoharvest.engine.propagation.smooth_elements import process_due_events_smooth, propagate_smooth
from piezoharvest.engine.propagation.trajectory import begin_tape, end_tape

DONE, CHATTER, INVALID, EXHAUSTED, CROWDED = range(5)
EVENTS_BETWEEN_REFRESHES = 32  # events after which the tones are recomputed from their phases


@compiled
def advance(P, L, S, D, t_end):
    """Run to t_end through all events.

    Returns DONE, CHATTER, INVALID (the state is not finite), EXHAUSTED, or CROWDED (too many actions are scheduled).
    """
    clock = D[st.CLOCK]
    busy, last = 0, S[clock]
    while True:
        slot = process_due_events_smooth(P, L, S, D) if L[pg.ELEMENTS] else process_due_events(P, L, S, D)
        if slot == NONE:
            return CHATTER
        if D[st.WAITING] > QUEUE_LENGTH:
            return CROWDED
        if D[st.INCOMPLETE]:
            leave_event(P, L, S, D, slot)
            D[st.INCOMPLETE] = 0
        D[st.MODE] = slot
        due, kind = next_scheduled(S, D)
        if D[st.TAPED] < D[st.TAPE_ROOM]:
            begin_tape(L, S, D)
        if L[pg.ELEMENTS]:
            guard = propagate_smooth(P, L, S, D, slot, min(due, t_end))
        elif L[tb.STAGED] and make_free_stage(P, L, S, D, slot, min(due, t_end)):
            guard = NONE
        else:
            guard = propagate_mode(P, L, S, D, slot, min(due, t_end))
        if D[st.TAPED] < D[st.TAPE_ROOM]:
            end_tape(L, S, D, slot, guard, due, kind)
        if not np.isfinite(S[0]):
            return INVALID if L[tb.WORK_LEFT] > 0 else EXHAUSTED
        if guard == NONE and due > t_end:
            return DONE
        busy, last = busy + 1 if S[clock] == last else 0, S[clock]
        if busy > MAX_EVENTS:
            return CHATTER
        D[st.HAPPENED] += 1
        if D[st.HAPPENED] % EVENTS_BETWEEN_REFRESHES == 0 and L[pg.SIGNAL_KIND] == pg.TONES:
            set_tones(P, L, S, S[clock])
        count = D[st.SENSITIVITIES]
        if guard == NONE:
            for s in range(count):
                known = D[st.OPENS_PHI] + s if kind == 1 else D[st.QUEUE_PHI] + s
                S[D[st.EVENT_PHI] + s] = S[known]
        enter_event(P, L, S, D, slot, guard)
        D[st.INCOMPLETE] = 1
        if guard != NONE:
            trigger_event(P, L, S, D, L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * guard])
        else:
            trigger_scheduled(P, L, S, D, kind)
