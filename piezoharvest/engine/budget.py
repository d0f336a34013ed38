"""How much a simulation may compute, counted where it runs: nothing runs for ever, and Ctrl-C ends it.

Work is counted in multiplications, roughly, so that the limit is met at the same place on every machine.
"""

from __future__ import annotations

import signal
from dataclasses import dataclass
from typing import NoReturn

from numba import types

from piezoharvest.engine.compiled import compiled, inlined
from piezoharvest.engine.tables import LEFT, LOOK

# Multiplications that a simulation may take: some 6 s on one core of 2020, 14 s where most goes into anything else.
MOST_WORK = 6_000_000_000
# Work between two looks for an interrupt: some 0.1 s.
BETWEEN_LOOKS = 100_000_000
# What one step costs beside its multiplications: looking at guards, locating and carrying out an event.
OVERHEAD = 500
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
