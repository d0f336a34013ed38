"""Sensitivities across an event, whose time depends on the state (saltation)."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import vector
from piezoharvest.engine.memory.tables import block_of, slot_of
from piezoharvest.engine.memory.vector import dot, multiply
from piezoharvest.engine.motion.exact_step import FLOW


@compiled
def enter_event(P, L, S, D, slot, guard):
    """Compute the sensitivity of an event's time, and move the sensitivities of the state to that time."""
    count = D[st.SENSITIVITIES]
    if count == 0:
        return
    rate_at = vector(L, D, FLOW)
    flow(P, L, S, D, slot, rate_at)
    if guard != NONE:
        # The guard's sign cancels in the quotient.
        rows, form = L[pg.ROWS], L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * guard + 1]
        row = block_of(L, slot) + L[tb.LINES] + 2 * form * rows
        rate = dot(P, row, S, rate_at, rows)
        for s in range(count):
            change = dot(P, row, S, D[st.PHI] + s * rows, rows)
            S[D[st.EVENT_PHI] + s] = -change / rate if rate != 0.0 else 0.0
    _move(L, S, D, rate_at, 1.0)


@compiled
def leave_event(P, L, S, D, slot):
    """Move the sensitivities back to fixed time, along the motion after the event (the saltation)."""
    if D[st.SENSITIVITIES]:
        flow(P, L, S, D, slot, vector(L, D, FLOW))
        _move(L, S, D, vector(L, D, FLOW), -1.0)


@compiled
def flow(P, L, S, D, slot, out):
    """Rate of the state."""
    multiply(P, block_of(L, slot) + L[tb.MATRIX], L[pg.ROWS], L[pg.COLUMNS], S, 0, out)


@compiled
def _move(L, S, D, rate_at, sign):
    for s in range(D[st.SENSITIVITIES]):
        shift = sign * S[D[st.EVENT_PHI] + s]
        for i in range(L[pg.N]):
            S[D[st.PHI] + s * L[pg.ROWS] + i] += S[rate_at + i] * shift
