"""The only entry point from Python into compiled code, so that everything behind it is compiled and cached once."""

from __future__ import annotations

from functools import partial

from piezoharvest.engine.compilation.compiled import compiled, entry
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import set_tones
from piezoharvest.engine.memory.tables import find_mode
from piezoharvest.engine.memory.vector import pointer
from piezoharvest.engine.propagation.advance import DONE, EXHAUSTED, advance
from piezoharvest.engine.propagation.event_free_steps import make_free_steps, set_ramp_piece
from piezoharvest.engine.steady_state.many_designs import steady_states
from piezoharvest.engine.steady_state.shooting import find
from piezoharvest.engine.work_limit import MULTIPLICATIONS_PER_UNIT, may_continue

RUN, FIND, FIND_MANY = range(3)
PIECES_BETWEEN_CHECKS = 10_000  # samples between two checks of the work limit


@compiled
def _nothing_pending(L, D):
    """True if nothing is scheduled, no event is incomplete, and the mode of the last step is still the present one."""
    unfinished = D[st.WAITING] or D[st.CLOSED] or D[st.INCOMPLETE] or (L[pg.SWITCHED] and D[st.DIRECTION] == 0)
    unfinished = unfinished or D[st.TAPE_ROOM]  # every motion is recorded
    if unfinished or L[pg.ELEMENTS] or D[st.MODE] == NONE:
        return False
    return find_mode(L, D, D[st.CONFIGURATION], D[st.SLIP]) == D[st.MODE]


@compiled
def run_ramps(P, L, S, D, ramps, last, piece, t_end):
    """Run through the `last` linear pieces of a signal, from the present `piece` on; return the status.

    After the last piece the signal keeps its end value.
    """
    times = ramps[0]
    while True:
        if _nothing_pending(L, D):
            before, pause = piece, min(piece + PIECES_BETWEEN_CHECKS, last)
            piece = make_free_steps(P, L, S, D, ramps, pause, piece, t_end)
            L[tb.WORK_LEFT] -= (piece - before) * L[tb.FREE_STEP_ROWS] * L[pg.COLUMNS] // MULTIPLICATIONS_PER_UNIT
            if L[tb.WORK_LEFT] < L[tb.NEXT_CHECK] and not may_continue(L):
                return EXHAUSTED
            if before < piece == pause < last:
                continue
        if piece > last or times[piece] >= t_end:
            return DONE
        set_ramp_piece(P, L, S, D, ramps, last, piece)
        status = advance(P, L, S, D, min(times[piece + 1], t_end) if piece < last else t_end)
        if status != DONE:
            return status
        piece += 1


@partial(entry, nogil=True)
def engine(task, machine, state, ramps, piece, t_end, shooting, followed, mirrored, recorder, batch):
    """Run a state to t_end, or find the periodic steady state from there, or the steady states of many designs.

    Returns the status.

    Parameters
    ----------
    task : int
        RUN, FIND or MANY.
    machine, state : (P, L) and (S, D)
    ramps : tuple of three arrays
        Times, initial values and slopes of the signal's pieces; empty for tones.
    piece : int
        Index of the present piece.
    t_end : float
        s.
    shooting, followed : (W, V) and (s, d)
        Memory of the search, and the state that is simulated from the start; `state` is then used for trials.
    mirrored : bool
        Search over half a period.
    recorder, batch : (S, D) and two (designs, ...) arrays
        For many designs: the state that records, the programs, and the rows of results.
    """
    P, L, S, D = pointer(machine[0]), pointer(machine[1]), pointer(state[0]), pointer(state[1])
    if task == FIND:
        W, V, s, d = pointer(shooting[0]), pointer(shooting[1]), pointer(followed[0]), pointer(followed[1])
        return find(P, L, S, D, W, V, s, d, mirrored)
    if task == FIND_MANY:
        W, V, s, d = pointer(shooting[0]), pointer(shooting[1]), pointer(followed[0]), pointer(followed[1])
        r, e, designs, out = pointer(recorder[0]), pointer(recorder[1]), pointer(batch[0]), pointer(batch[1])
        count, width = batch[1].shape
        steady_states(P, L, S, D, W, V, s, d, r, e, designs, count, out, width, mirrored)
        return DONE
    if L[pg.SIGNAL_KIND] == pg.TONES:
        set_tones(P, L, S, S[D[st.CLOCK]])
        return advance(P, L, S, D, t_end)
    curve = pointer(ramps[0]), pointer(ramps[1]), pointer(ramps[2])
    return run_ramps(P, L, S, D, curve, len(ramps[1]), piece, t_end)
