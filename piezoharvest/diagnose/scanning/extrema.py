"""Extrema of a measured voltage, and whether a switch acted on them: the voltage jumps where it did."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.signal import find_peaks

from piezoharvest.identify.noise.noise_model import initial_noise

# Noise makes extrema beside those of the motion: these are as far from the next ones as so many standard deviations,
# and as this share of the range, below which rounding by a converter may be all that there is.
PROMINENCE, MIN_SHARE = 8.0, 0.02
# In a tenth of half a period a sine changes by 16 % of what it changes in the whole; an inversion, or a discharge,
# leaves at least half of the change to an instant.
WINDOW, MIN_JUMP = 0.1, 0.3
# Share of the extrema that were not acted on which a threshold may leave unexplained. Of eleven random circuits with
# one it left at most a tenth; where small extrema that were acted on are like those that were not, about half.
MOST_WRONG = 0.25


def extrema_of(voltage: np.ndarray) -> list[tuple[float, bool]]:
    """Size in V of each extremum of a voltage (n,), and whether the switch acted before the next one."""
    span = float(np.ptp(voltage))
    prominence = max(PROMINENCE * initial_noise(voltage), MIN_SHARE * span)
    if not span > 0.0:
        return []
    places = np.sort(np.concatenate([find_peaks(sign * voltage, prominence=prominence)[0] for sign in (1.0, -1.0)]))
    return [(abs(float(voltage[begin])), _jumps(voltage[begin : end + 1])) for begin, end in pairwise(places)]


def _jumps(part: np.ndarray) -> bool:
    """True if a voltage changes from one extremum to the next by a jump."""
    window = max(int(WINDOW * len(part)), 1)
    return bool(np.max(np.abs(part[window:] - part[:-window])) > MIN_JUMP * np.ptp(part))


def thresholds_between(extrema: Sequence[tuple[float, bool]], most: int = 2) -> list[float]:
    """Sizes that part extrema that were acted on from smaller ones that were not, those with the fewest errors first.

    Each is the middle between two extrema that follow each other by size; none where a threshold explains few of them:
    each is scanned by fits, which behind a switch take long.
    """
    sizes, acted = np.array([size for size, _ in extrema]), np.array([did for _, did in extrema], bool)
    edges = np.unique(sizes)
    middles = 0.5 * (edges[1:] + edges[:-1])
    wrong = [int(np.sum(acted & (sizes < middle)) + np.sum(~acted & (sizes > middle))) for middle in middles]
    order = np.argsort(wrong, kind="stable")[:most]
    return [float(middles[k]) for k in order if wrong[k] < MOST_WRONG * np.sum(~acted)]
