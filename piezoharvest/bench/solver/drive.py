"""Drive of the solver, smooth between the instants at which steps have to end."""

from __future__ import annotations

import numpy as np

from piezoharvest.description.excitation import Excitation, Tones

# Instants closer than this fraction of the sample interval are merged.
MERGE_SHARE = 1e-6


def merged(times: np.ndarray, more: np.ndarray) -> np.ndarray:
    """Union of instants, increasing; of two that differ by rounding only, the later one.

    Parameters
    ----------
    times : (n,) array
        Samples in s, increasing; their smallest distance is the scale of rounding.
    more : (m,) array
    """
    both = np.union1d(times, more)
    return both[np.append(np.diff(both) > MERGE_SHARE * np.diff(times).min(), True)]


class Drive:
    """An excitation, smooth between its nodes.

    Parameters
    ----------
    excitation : Excitation
    times : (n,) array
        Instants (s, from 0 on, increasing) of the waveforms.

    Attributes
    ----------
    rest : float
        Value before the start, at which the specimen is in equilibrium.
    nodes : (m,) array
        The instants of the waveforms, and those between them at which the drive has a corner or a jump.
    """

    def __init__(self, excitation: Excitation, times: np.ndarray) -> None:
        self._signal = signal = excitation.signal()
        self.rest, self.nodes = excitation.rest, times
        if isinstance(signal, Tones):
            return
        corners = signal.times
        self.nodes = merged(times, corners[(corners > times[0]) & (corners < times[-1])])
        # One linear piece for each interval, evaluated at its middle: at its ends there may be a jump.
        middle = 0.5 * (self.nodes[:-1] + self.nodes[1:])
        piece = np.clip(np.searchsorted(corners, middle, side="right") - 1, 0, len(signal.starts) - 1)
        after_end = middle > corners[-1]
        self._slope = np.where(after_end, 0.0, signal.slopes[piece])
        since = np.where(after_end, corners[-1], self.nodes[:-1]) - corners[piece]
        self._level = signal.starts[piece] + signal.slopes[piece] * since

    def within(self, interval: int | np.ndarray, times: float | np.ndarray) -> np.ndarray:
        """Value at times in the interval from `nodes[interval]` to the next node, ends included."""
        if isinstance(self._signal, Tones):
            return self._signal.at(np.asarray(times))
        return self._level[interval] + self._slope[interval] * (times - self.nodes[interval])

    def at(self, times: np.ndarray) -> np.ndarray:
        """Value at the given times; at a jump, the one after it."""
        return self._signal.at(times)
