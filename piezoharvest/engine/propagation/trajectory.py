"""Record of a run as a sequence of motions between events."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.tables import slot_of

# Reasons for the end of a motion, beside guards.
NOTHING, OPENS, ACTS = -1, -2, -3


@compiled
def begin_tape(L, S, D):
    """Record the beginning of a motion between two events: time, state, configuration and slips.

    Also record if an action of the switch, or its opening, is scheduled.
    """
    at, kind = D[st.TAPE] + D[st.TAPED] * (2 + L[pg.A]), D[st.TAPE_KIND] + D[st.TAPED] * (3 + L[pg.H])
    S[at] = S[D[st.CLOCK]]
    set_beginning(L, S, D, 0)
    D[kind], D[kind + 2] = D[st.CONFIGURATION], 1 if D[st.WAITING] or D[st.CLOSED] else 0
    for j in range(L[pg.H]):
        D[kind + 3 + j] = D[D[st.SLIP] + j]


@compiled
def set_beginning(L, S, D, z):
    """Record a state as that at the beginning of the present motion."""
    at = D[st.TAPE] + D[st.TAPED] * (2 + L[pg.A])
    for i in range(L[pg.A]):
        S[at + 2 + i] = S[z + i]


@compiled
def end_tape(L, S, D, slot, guard, due, kind):
    """Record the end of a motion and its reason: a guard, the switch that opens or acts, or nothing."""
    at = D[st.TAPED]
    S[D[st.TAPE] + at * (2 + L[pg.A]) + 1] = S[D[st.CLOCK]]
    what = L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * guard] if guard != NONE else NOTHING
    if guard == NONE and S[D[st.CLOCK]] >= due:
        what = OPENS if kind == 1 else ACTS
    D[D[st.TAPE_KIND] + at * (3 + L[pg.H]) + 1] = what
    D[st.TAPED] += 1
