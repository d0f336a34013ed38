"""The one door from Python into compiled code, so that what lies behind it is compiled and kept on disk once."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled, entry
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import set_tones
from piezoharvest.engine.memory.tables import seek
from piezoharvest.engine.memory.vector import pointer
from piezoharvest.engine.propagation.advance import DONE, EXHAUSTED, advance
from piezoharvest.engine.propagation.event_free_steps import glide, hold_ramp
from piezoharvest.engine.steady_state.many_designs import steady_states
from piezoharvest.engine.steady_state.shooting import find
from piezoharvest.engine.work_limit import AT_ONCE, goes_on

RUN, FIND, MANY = range(3)
PAUSE = 10_000  # samples after which one looks whether to go on


@compiled
def _unhurried(L, D):
    """Whether nothing is scheduled or left half done, and the mode last moved in still holds."""
    unfinished = D[st.WAITING] or D[st.CLOSED] or D[st.BETWEEN] or (L[pg.SWITCHED] and D[st.DIRECTION] == 0)
    if unfinished or L[pg.ELEMENTS] or D[st.MODE] == NONE:
        return False
    return seek(L, D, D[st.CONFIGURATION], D[st.SLIP]) == D[st.MODE]


@compiled
def through_ramps(P, L, S, D, ramps, last, piece, t_end):
    """Run through the `last` straight pieces of a signal, from the `piece` that holds now; returns the status.

    Beyond the last piece its end value is held.
    """
    times = ramps[0]
    while True:
        if _unhurried(L, D):
            before, pause = piece, min(piece + PAUSE, last)
            piece = glide(P, L, S, D, ramps, pause, piece, t_end)
            L[tb.LEFT] -= (piece - before) * L[tb.GLIDE_ROWS] * L[pg.COLUMNS] // AT_ONCE
            if L[tb.LEFT] < L[tb.LOOK] and not goes_on(L):
                return EXHAUSTED
            if before < piece == pause < last:
                continue
        if piece > last or times[piece] >= t_end:
            return DONE
        hold_ramp(P, L, S, D, ramps, last, piece)
        status = advance(P, L, S, D, min(times[piece + 1], t_end) if piece < last else t_end)
        if status != DONE:
            return status
        piece += 1


@entry
def engine(task, machine, state, ramps, piece, t_end, shooting, followed, mirrored, recorder, batch):
    """Run a state to t_end, or find the periodic steady state from there, or those of many designs.

    Returns the status.

    Parameters
    ----------
    task : int
        RUN, FIND or MANY.
    machine, state : (P, L) and (S, D)
    ramps : tuple of three arrays
        Times, starting values and slopes of the signal's pieces; empty for tones.
    piece : int
        Which of them holds now.
    t_end : float
        s.
    shooting, followed : (W, V) and (s, d)
        Memory of the search, and the state whose motion is followed; `state` serves for trials then.
    mirrored : bool
        Whether the search goes over half a period.
    recorder, batch : (S, D) and two (designs, ...) arrays
        Of many designs: the state that records, their programs, and what is kept of them.
    """
    P, L, S, D = pointer(machine[0]), pointer(machine[1]), pointer(state[0]), pointer(state[1])
    if task == FIND:
        W, V, s, d = pointer(shooting[0]), pointer(shooting[1]), pointer(followed[0]), pointer(followed[1])
        return find(P, L, S, D, W, V, s, d, mirrored)
    if task == MANY:
        W, V, s, d = pointer(shooting[0]), pointer(shooting[1]), pointer(followed[0]), pointer(followed[1])
        r, e, designs, out = pointer(recorder[0]), pointer(recorder[1]), pointer(batch[0]), pointer(batch[1])
        count, width = batch[1].shape
        steady_states(P, L, S, D, W, V, s, d, r, e, designs, count, out, width, mirrored)
        return DONE
    if L[pg.SIGNAL_KIND] == pg.TONES:
        set_tones(P, L, S, S[D[st.CLOCK]])
        return advance(P, L, S, D, t_end)
    curve = pointer(ramps[0]), pointer(ramps[1]), pointer(ramps[2])
    return through_ramps(P, L, S, D, curve, len(ramps[1]), piece, t_end)
