"""Sine sweeps as drives of independent integrations, which ask for a million single instants."""

import math

import numpy as np


def linear_sweep(begin, duration, end):
    """Function of time, a number or an array in s: a cosine whose frequency goes from `begin` to `end` (Hz).

    `scipy.signal.chirp` takes ten times as long for a number.
    """
    rate = (end - begin) / duration

    def at(t):
        turns = t * (begin + 0.5 * rate * t)
        return np.cos(2 * np.pi * turns) if isinstance(t, np.ndarray) else math.cos(2 * math.pi * turns)

    return at
