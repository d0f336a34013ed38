"""Python interface of the compiled engine: runs and searches of a lowered system."""

from __future__ import annotations

import copy

import numpy as np

from piezoharvest.description.excitation import Ramps
from piezoharvest.engine.entry_point import FIND, FIND_MANY, RUN, engine
from piezoharvest.engine.lowering.lower import Lowered
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.state import EngineState
from piezoharvest.engine.memory.vector import lined_up
from piezoharvest.engine.propagation.advance import EXHAUSTED
from piezoharvest.engine.work_limit import INTERRUPTED, interrupt

NONE = np.zeros(0), np.zeros(0, np.int64)
NO_BATCH = np.zeros((0, 0)), np.zeros((0, 0))
NO_RAMPS = np.zeros(0), np.zeros(0), np.zeros(0)


class Machine:
    """A lowered system with the tables of its modes.

    Parameters
    ----------
    lowered : Lowered
    ledger : bool
        Record energies.
    """

    def __init__(self, lowered: Lowered, ledger: bool = False):
        self.lowered = lowered
        self.ledger = ledger
        self.L, length = tb.contents(pg.integers(lowered.program), ledger)
        self.P = lined_up(length)
        self.P[: self.L[pg.LENGTH]] = pg.numbers(pg.part(lowered.program, 0))  # the first design of a batch
        self._blank = self.L.copy()

    def copied(self, lowered: Lowered) -> Machine:
        """Machine of the same matrices under another signal, without the tables of its modes."""
        found = copy.copy(self)
        found.lowered, found.L, found.P = lowered, self._blank.copy(), lined_up(len(self.P))
        found.P[: self.L[pg.LENGTH]] = self.P[: self.L[pg.LENGTH]]
        return found

    def state(self, **recorded) -> EngineState:
        """State at rest, under the static part of the excitation; `recorded` as in `EngineState`."""
        state = EngineState(self.L, **{"ledger": self.ledger, **recorded})
        at = self.L[pg.EQUILIBRIUM]
        state.z[: self.L[pg.N]] = self.P[at : at + self.L[pg.N]]
        if self.L[pg.SWITCHED] == pg.CLOCKED:
            state.D[st.CLOSED] = 1
            state.clock[st.OPENS] = 0.5 * self.P[self.L[pg.ON_TIME]] * self.P[self.L[pg.STAGE]]
        return state

    def run(self, state: EngineState, t_end: float) -> int:
        """Run to t_end (s) and return the engine's status; the state's arrays are changed in place."""
        signal, ramps, piece = self.lowered.signal, NO_RAMPS, 0
        if isinstance(signal, Ramps):
            ramps = tuple(signal)
            piece = max(int(np.searchsorted(signal.times, state.clock[st.NOW], side="right")) - 1, 0)
        return self._call(RUN, (state.S, state.D), ramps, piece, t_end, NONE, NONE, False, NONE, NO_BATCH)

    def search(
        self, trial: EngineState, followed: EngineState, memory: tuple[np.ndarray, np.ndarray], mirrored: bool
    ) -> int:
        """Find the periodic steady state from the state `followed`, and return the engine's status; see `shooting`."""
        moving = followed.S, followed.D
        return self._call(FIND, (trial.S, trial.D), NO_RAMPS, 0, 0.0, memory, moving, mirrored, NONE, NO_BATCH)

    def search_many(
        self,
        trial: EngineState,
        followed: EngineState,
        recorder: EngineState,
        memory: tuple,
        batch: tuple,
        mirrored: bool,
    ) -> None:
        """Find the steady states of many designs; see `many_designs`."""
        states = ((state.S, state.D) for state in (trial, followed, recorder))
        first, second, third = states
        self._call(FIND_MANY, first, NO_RAMPS, 0, 0.0, memory, second, mirrored, third, batch)

    def _call(self, task: int, *arguments) -> int:
        """Call the engine within the simulation's budget; return its status."""
        budget = self.lowered.budget
        budget.counter = self.L
        self.L[[tb.WORK_LEFT, tb.NEXT_CHECK]] = budget.left
        status = engine(task, (self.P, self.L), *arguments)
        left = int(self.L[tb.WORK_LEFT])
        if left < INTERRUPTED // 2:
            interrupt()
        budget.left, budget.counter = left, None
        return status if left > 0 else EXHAUSTED
