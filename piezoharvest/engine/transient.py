"""Transient simulation: from rest through a given time."""

from __future__ import annotations

import numpy as np
from numba import njit

from piezoharvest.engine import program as pg
from piezoharvest.engine.events import DONE, advance
from piezoharvest.engine.state import NOW, set_ramp, set_tones


@njit(cache=True)
def run_tones(P, T, S, t_end):
    """Run under a sum of tones from the time now to t_end."""
    set_tones(P, S, S.clock[NOW])
    return advance(P, T, S, t_end)


@njit(cache=True)
def run_ramps(P, T, S, times, starts, slopes, t_end):
    """Run under straight pieces of signal; beyond the last one its end value is held."""
    count = len(starts)
    for k in range(count):
        if times[k] >= t_end:
            return DONE
        set_ramp(P, S, starts[k], slopes[k])
        status = advance(P, T, S, min(times[k + 1], t_end))
        if status != DONE:
            return status
    if t_end > times[count]:
        set_ramp(P, S, starts[count - 1] + slopes[count - 1] * (times[count] - times[count - 1]), 0.0)
        return advance(P, T, S, t_end)
    return DONE


def run(lowered, tables, state, t_end: float) -> int:
    """Run a lowered system from the state's time to t_end (s); returns the engine's status."""
    signal = lowered.signal
    if lowered.program.signal_kind == pg.TONES:
        return run_tones(lowered.program, tables, state, t_end)
    return run_ramps(lowered.program, tables, state, signal.times, signal.starts, signal.slopes, t_end)


