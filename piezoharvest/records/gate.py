"""Instants at which a recorded logic signal closes the switch of a circuit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Shares of the way from the lower to the upper level: an edge crosses one half, between these the signal is on a slope.
# Noise of a quarter of the way, far more than logic has, makes no edge.
LOWER, HALF, UPPER = 0.25, 0.5, 0.75
FLAT = 0.1  # of the way: samples nearer to a level are on it


class Edges(NamedTuple):
    """Rising edges of a gate.

    Attributes
    ----------
    times : (k,) array
        s from the first sample.
    error : float
        By which they may be off either way, s: half a sample where the signal changes its level within one.
    """

    times: np.ndarray
    error: float


def rising_edges(values: np.ndarray, step: float) -> Edges:
    """Rising edges of a signal (n,) with two levels, sampled every `step` seconds.

    An edge is where it crosses half way between its levels. Where samples lie on its slopes the crossing is
    interpolated, else it is in the middle between the last sample before and the first one after. A signal that is high
    from the first sample on has risen before.
    """
    middle = 0.5 * (values.min() + values.max())
    if not values.min() < middle:
        return Edges(np.zeros(0), 0.0)
    low, high = np.median(values[values < middle]), np.median(values[values >= middle])
    share = (values - low) / (high - low)
    decided = np.flatnonzero((share < LOWER) | (share > UPPER))
    above = share[decided] > UPPER
    risen = np.flatnonzero(~above[:-1] & above[1:])
    # The last sample below one half from the last low one to the first high one.
    before = np.array([_last_below(share, *decided[k : k + 2]) for k in risen], int)
    here, there = share[before], share[before + 1]
    sloping = (np.abs(here - 0.5) < 0.5 - FLAT) | (np.abs(there - 0.5) < 0.5 - FLAT)
    if len(before) and np.mean(sloping) > 0.5:
        return Edges((before + (HALF - here) / (there - here)) * step, 0.0)
    return Edges((before + 0.5) * step, 0.5 * step)


def _last_below(share: np.ndarray, begin: int, end: int) -> int:
    """Last sample from `begin` to before `end` that is below one half."""
    return int(begin + np.flatnonzero(share[begin:end] < HALF)[-1])
