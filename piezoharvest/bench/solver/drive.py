"""The drive between the instants at which the solver has to stop."""

from __future__ import annotations

import numpy as np

from piezoharvest.description.excitation import Excitation, Tones

# Instants closer than this share of the samples' distance are one.
SAME = 1e-6


def merged(times: np.ndarray, more: np.ndarray) -> np.ndarray:
    """Instants of both, increasing, the later one where rounding alone keeps two of them apart.

    Parameters
    ----------
    times : (n,) array
        Samples in s, increasing; their smallest distance is what the others are compared with.
    more : (m,) array
    """
    both = np.union1d(times, more)
    return both[np.append(np.diff(both) > SAME * np.diff(times).min(), True)]


class Drive:
    """An excitation, smooth between its nodes.

    Parameters
    ----------
    excitation : Excitation
    times : (n,) array
        Instants (s, from 0 on, increasing) at which waveforms are wanted.

    Attributes
    ----------
    rest : float
        Value before the start, at which the specimen is in equilibrium.
    nodes : (m,) array
        The wanted instants, with those between them at which the drive has a corner or a jump.
    """

    def __init__(self, excitation: Excitation, times: np.ndarray) -> None:
        self._signal = signal = excitation.signal()
        self.rest, self.nodes = excitation.rest, times
        if isinstance(signal, Tones):
            return
        corners = signal.times
        self.nodes = merged(times, corners[(corners > times[0]) & (corners < times[-1])])
        # One straight line for each interval, found from its middle: at its ends there may be a jump.
        middle = 0.5 * (self.nodes[:-1] + self.nodes[1:])
        piece = np.clip(np.searchsorted(corners, middle, side="right") - 1, 0, len(signal.starts) - 1)
        held = middle > corners[-1]
        self._slope = np.where(held, 0.0, signal.slopes[piece])
        since = np.where(held, corners[-1], self.nodes[:-1]) - corners[piece]
        self._level = signal.starts[piece] + signal.slopes[piece] * since

    def within(self, interval: int | np.ndarray, times: float | np.ndarray) -> np.ndarray:
        """Value at times in the interval from `nodes[interval]` to the next node, ends included."""
        if isinstance(self._signal, Tones):
            return self._signal.at(np.asarray(times))
        return self._level[interval] + self._slope[interval] * (times - self.nodes[interval])

    def at(self, times: np.ndarray) -> np.ndarray:
        """Value as it is at the given times; at a jump, the one after it."""
        return self._signal.at(times)
