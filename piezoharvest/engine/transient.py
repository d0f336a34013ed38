"""Running a lowered system through time."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine import state as st
from piezoharvest.engine import tables as tb
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.events import DONE, MISSING, advance
from piezoharvest.engine.lower import Lowered
from piezoharvest.excitation import Tones


@compiled
def through_ramps(P, T, S, times, starts, slopes, piece, t_end):
    """Run through straight pieces of signal from the `piece` that holds now; returns the status and the piece reached.

    Beyond the last piece its end value is held.
    """
    count = len(starts)
    for k in range(piece, count + 1):
        begins, ends = times[k], times[k + 1] if k < count else np.inf
        if begins >= t_end:
            return DONE, k
        if k < count:
            st.set_ramp(P, S, starts[k] + slopes[k] * (S.clock[st.NOW] - begins), slopes[k])
        else:
            st.set_ramp(P, S, starts[k - 1] + slopes[k - 1] * (begins - times[k - 1]), 0.0)
        status = advance(P, T, S, min(ends, t_end))
        if status != DONE:
            return status, k
    return DONE, count


class Machine:
    """A lowered system with its tables: what runs.

    Parameters
    ----------
    lowered : Lowered
    ledger : bool
        Whether energies are accounted for.
    """

    def __init__(self, lowered: Lowered, ledger: bool = False):
        self.lowered = lowered
        self.program = pg.point(lowered.program)
        self.tables = tb.allocate(lowered.program, ledger)
        self.ledger = ledger

    def state(self, rest: float = 0.0, **recorded) -> st.State:
        """State at rest under a static excitation `rest`; `recorded` as in `state.rest`."""
        state = st.rest(self.lowered.program, ledger=self.ledger, **recorded)
        n = len(self.lowered.states)
        state.z[:n] = rest * self.lowered.equilibrium
        return state

    def run(self, state: st.State, t_end: float) -> int:
        """Run to t_end (s) and return the engine's status; the state's arrays are changed in place."""
        signal, S = self.lowered.signal, st.point(state)
        piece = 0
        if isinstance(signal, Tones):
            st.set_tones(self.program, S, state.clock[st.NOW])
        else:
            piece = int(np.searchsorted(signal.times, state.clock[st.NOW], side="right")) - 1
        while True:
            if isinstance(signal, Tones):
                status = advance(self.program, self.tables, S, t_end)
            else:
                status, piece = through_ramps(self.program, self.tables, S, *signal, piece, t_end)
            if status != MISSING:
                return status
            tb.build(self.program, self.tables, state.discrete[st.CONFIGURATION], state.slip)
