"""How sure it is that a channel which stands still is dead: whether noise explains it, and what the others do."""

from __future__ import annotations

import numpy as np

from piezoharvest.records.checks.level import Level, white_noise
from piezoharvest.records.finding import runs
from piezoharvest.records.record import Record

_BESIDE = (64, 1024)  # samples on either side of a run that tell the noise there, least and most
_FEWEST = 24  # on a side that says something
_WHITE = 0.6  # share of changes of sign of fourth differences, 0.8 for white noise: less is the signal's own course
_AS_USUAL = 0.3  # of the usual motion in so many samples
_ABOVE_NOISE = 3.0
_WINDOWS = 200  # that tell what is usual
_JUMP = 6.0  # times the usual step from one sample to the next
_PILED = 8  # samples at an end of the range
_STEEPER = 4.0  # times as many as any value next to it has
_NEXT = 3  # values
_NEAR = 6.0  # times the noise


def unlikely(flat: np.ndarray, values: np.ndarray, level: Level) -> np.ndarray:
    """Whether runs are longer than noise explains: each by itself, or at an end of the range all taken together.

    Within the range the noise has to be there on both sides of a run as well. A channel may be quiet before the drive
    starts, and what is taken for noise elsewhere may be its own course.
    """
    length, at, enough = flat[:, 1] - flat[:, 0] + 1, values[flat[:, 0]], level.pinned(len(values))
    unlikely = np.zeros(len(flat), bool)
    for limit in (values.max(), values.min()):
        here = at == limit
        unlikely |= here & ((length >= enough) | (np.sum(length[here] - 1) >= 2 * enough))
    inner = (length >= enough) & (at != values.max()) & (at != values.min())
    for n in np.flatnonzero(inner):
        inner[n] = _noise_stops(values, flat[n, 0], flat[n, 1], level)
    return unlikely | inner


def piled(values: np.ndarray, level: Level) -> np.ndarray:
    """Runs of any length at an end of the range that no more than noise reaches.

    Noise thins out towards its extremes: a largest value that is taken more often than those next to it is a limit.
    Pulses that are all alike come from afar, which noise does not.
    """
    found = [np.zeros((0, 2), int)]
    taken, times = np.unique(values, return_counts=True)
    for at, beside in ((-1, times[-1 - _NEXT : -1]), (0, times[1 : 1 + _NEXT])):
        if level.noisy and times[at] >= max(_PILED, _STEEPER * beside.max(initial=1)):
            pile = runs(values == taken[at])
            ends = np.abs(values[np.clip(pile + np.array([-1, 1]), 0, len(values) - 1)] - taken[at])
            if np.median(ends) < _NEAR * level.noise:
                found.append(pile)
    return np.concatenate(found)


def _noise_stops(values: np.ndarray, begin: int, end: int, level: Level) -> bool:
    """Whether a run is longer than the noise explains that is found beside it, where there is less of it."""
    width = int(np.clip(2 * (end - begin), *_BESIDE))
    sides = (values[max(begin - width, 0) : begin], values[end + 1 : end + 1 + width])
    sides = [side for side in sides if len(side) >= _FEWEST]
    if not sides:
        return False
    noise, changing = np.min([white_noise(np.diff(side, 4)) for side in sides], axis=0)
    local = level._replace(noise=float(noise))
    return bool(changing > _WHITE and local.beyond and end - begin + 1 >= local.pinned(len(values)))


def go_on(record: Record, begin: int, end: int, levels: dict[str, Level]) -> bool:
    """Whether all responses move in a run of the drive as they do elsewhere; where it is held they rest, or creep."""
    count = end - begin + 1
    starts = np.linspace(0, len(record) - count, _WINDOWS).astype(int)
    for channel in record.responses:
        values = record[channel]
        moved = np.std(values[begin : end + 1])
        usual = np.median([np.std(values[start : start + count]) for start in starts])
        if moved < max(_AS_USUAL * usual, _ABOVE_NOISE * levels[channel].noise):
            return False
    return bool(record.responses)


def jumps(values: np.ndarray, begin: int, end: int) -> bool:
    """Whether a channel comes back from a run elsewhere than where it has left."""
    beside = np.concatenate((values[max(begin - _BESIDE[0], 0) : begin], values[end + 1 : end + 1 + _BESIDE[0]]))
    usual = np.median(np.abs(np.diff(beside))) if len(beside) > 1 else np.inf
    return bool(end + 1 < len(values) and abs(values[end + 1] - values[end]) > _JUMP * usual)
