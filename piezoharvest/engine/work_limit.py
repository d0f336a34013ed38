"""Work limit of a simulation, counted in compiled code: every run ends, and Ctrl-C interrupts it.

Work is counted in units of about a nanosecond on one core of 2020, by operations and not by the clock, so that the
limit is reached at the same place on every machine.
"""

from __future__ import annotations

import signal
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numba import types

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory.tables import NEXT_CHECK, WORK_LEFT

MAX_WORK = 8_000_000_000  # of a simulation: some 5 to 10 s, while an ordinary one takes a hundredth of a second
SAMPLE_WORK = 5_000  # more for each sample of a signal, whose number is known: a bridge with a coil takes 2,000
# More for each period of a transient: a stiff bridge that charges a supply, with all that is recorded, takes 140,000.
PERIOD_WORK = 1_000_000
# Work between two checks for an interrupt.
WORK_BETWEEN_CHECKS = 100_000_000
# Work of a step beside its products (guards, location and action of an event); overhead of a product of a matrix and
# the state; multiplications in the time of one unit.
STEP_WORK, PRODUCT_WORK, MULTIPLICATIONS_PER_UNIT = 500, 50, 16
INTERRUPTED = -(2**62)  # value of the work left after an interrupt by the user

# 1 if Ctrl-C has been pressed since the last call; Python's own handler waits until compiled code returns.
_ctrl_c = types.ExternalFunction("PyOS_InterruptOccurred", types.int32())
# It has to hold Python's lock, which compiled code has given up so that other threads run.
_lock = types.ExternalFunction("PyGILState_Ensure", types.int32())
_unlock = types.ExternalFunction("PyGILState_Release", types.void(types.int32))


@dataclass
class Budget:
    """Remaining work of one simulation, over all its runs; `counter` is that of the present one in compiled code."""

    left: int = MAX_WORK
    counter: np.ndarray | None = None

    @property
    def now(self) -> int:
        """Work left at this moment."""
        return self.left if self.counter is None else int(self.counter[WORK_LEFT])


@inlined
def interrupted(L):
    """True if the user has interrupted; work done since then is not counted."""
    return L[WORK_LEFT] < INTERRUPTED // 2


@inlined
def spend_products(L, count):
    """Subtract the work of `count` products of the state's matrix with a vector from the work left."""
    L[WORK_LEFT] -= count * (PRODUCT_WORK + L[pg.ROWS] * L[pg.COLUMNS] // MULTIPLICATIONS_PER_UNIT)


@compiled
def may_continue(L):
    """True if work is left and the user has not interrupted."""
    if not interrupted(L):
        held = _lock()
        if _ctrl_c() != 0:
            L[WORK_LEFT] = INTERRUPTED
        _unlock(held)
    L[NEXT_CHECK] = max(L[WORK_LEFT] - WORK_BETWEEN_CHECKS, 0)
    return L[WORK_LEFT] > 0


def interrupt() -> NoReturn:
    """Raise the signal of Ctrl-C in Python code, for any handler.

    Raises
    ------
    KeyboardInterrupt
    """
    signal.raise_signal(signal.SIGINT)
    raise KeyboardInterrupt
