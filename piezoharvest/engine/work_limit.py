"""How much a simulation may compute, counted where it runs: nothing runs for ever, and Ctrl-C ends it.

Work is counted in units of about a nanosecond on one core of 2020, by what is done and not by the clock, so that the
limit is met at the same place on every machine.
"""

from __future__ import annotations

import signal
from dataclasses import dataclass
from typing import NoReturn

from numba import types

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory.tables import LEFT, LOOK

MOST_WORK = 8_000_000_000  # of a simulation: some 5 to 10 s, where an ordinary one takes a hundredth of a second
# Between two looks for an interrupt.
BETWEEN_LOOKS = 100_000_000
# What a step takes beside its products, looking at guards, locating and carrying out an event; what a product of a
# matrix and the state takes to begin; how many multiplications are made in the time of one unit.
STEP, PRODUCT, AT_ONCE = 500, 50, 16
INTERRUPTED = -(2**62)  # left once the user has interrupted

# Whether Ctrl-C has been pressed since the last call; Python's own handler waits until compiled code returns.
_ctrl_c = types.ExternalFunction("PyOS_InterruptOccurred", types.int32())


@dataclass
class Budget:
    """What is left of the work that one simulation may take, over all its runs."""

    left: int = MOST_WORK


@inlined
def interrupted(L):
    """Whether the user has interrupted; work done since then counts no more."""
    return L[LEFT] < INTERRUPTED // 2


@inlined
def products(L, count):
    """Take the work of some products of a matrix of the size of the state with a vector from what is left."""
    L[LEFT] -= count * (PRODUCT + L[pg.ROWS] * L[pg.COLUMNS] // AT_ONCE)


@compiled
def goes_on(L):
    """Whether work is left and the user has not interrupted."""
    if not interrupted(L) and _ctrl_c() != 0:
        L[LEFT] = INTERRUPTED
    L[LOOK] = max(L[LEFT] - BETWEEN_LOOKS, 0)
    return L[LEFT] > 0


def interrupt() -> NoReturn:
    """Raise what Ctrl-C raises in Python code, whatever its handler is.

    Raises
    ------
    KeyboardInterrupt
    """
    signal.raise_signal(signal.SIGINT)
    raise KeyboardInterrupt
