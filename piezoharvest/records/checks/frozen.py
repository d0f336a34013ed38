"""Criteria for a dead channel where its values are equal: noise as an explanation, and motion of other channels."""

from __future__ import annotations

import numpy as np

from piezoharvest.records.checks.level import Level, white_noise
from piezoharvest.records.finding import runs
from piezoharvest.records.record import Record

_NEIGHBOURHOOD = (64, 1024)  # least and most samples on either side of a run from which the noise is estimated
_MIN_SIDE_SAMPLES = 24  # samples on a side for an estimate
_MIN_SIGN_CHANGES = 0.6  # share of sign changes of fourth differences, 0.8 for white noise: less is the signal itself
_MIN_MOTION = 0.3  # of the usual motion in so many samples
_ABOVE_NOISE = 3.0
_WINDOWS = 200  # from which the usual motion is taken
_MIN_JUMP = 6.0  # times the usual step from one sample to the next
_MIN_LIMIT_SAMPLES = 8  # samples at an end of the range
_MIN_FREQUENCY_RATIO = 4.0  # times as many as any value next to it has
_NEXT_VALUES = 3  # values
_MAX_APPROACH = 6.0  # times the noise
_CONVERTERS = range(8, 25)  # bits
_OF_A_CODE = 0.01  # steps: rounding of decimal files, with the least difference as the step
_REPEATED_STEPS = 1.5  # of the converter: equal values, rounded, differ by one step at most


def longer_than_noise(flat: np.ndarray, values: np.ndarray, level: Level) -> np.ndarray:
    """Mask of the runs that are longer than noise explains: each by itself, or all at an end of the range together.

    Within the range, the noise must be present on both sides of a run as well: a channel may be at rest before the
    drive starts, and the apparent noise elsewhere may be the signal itself.
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


def runs_at_limits(values: np.ndarray, level: Level, *, held: bool) -> np.ndarray:
    """Runs of any length at an end of the range that only noise reaches; values that a circuit has `held` are none.

    The density of noise falls towards its extremes: a largest value that is more frequent than those next to it is a
    limit. Equal pulses reach it from far away, noise does not. A repeated signal without noise reaches it along the
    same values each time. Unequal pulses that all end at the last code of a converter are cut off by it.
    """
    found = [np.zeros((0, 2), int)]
    taken, times = np.unique(values, return_counts=True)
    for at, beside in ((-1, times[-1 - _NEXT_VALUES : -1]), (0, times[1 : 1 + _NEXT_VALUES])):
        if times[at] < max(_MIN_LIMIT_SAMPLES, _MIN_FREQUENCY_RATIO * beside.max(initial=1)):
            continue
        pile = runs(values == taken[at])
        if _is_last_code(taken[at], level.step):
            found.append(pile)
        elif level.noisy and not held:
            beside_pile = values[np.clip(pile + np.array([-1, 1]), 0, len(values) - 1)]
            near = np.median(np.abs(beside_pile - taken[at])) < _MAX_APPROACH * level.noise
            if near and np.ptp(beside_pile, axis=0).max() > _REPEATED_STEPS * level.step:
                found.append(pile)
    return np.concatenate(found)


def _is_last_code(value: float, step: float) -> bool:
    """True if a value is -2^(b-1) or 2^(b-1) - 1 steps, the ends of a converter of b bits in two's complement."""
    codes = abs(value) / step
    return any(min(abs(codes - 2 ** (b - 1)), abs(codes - 2 ** (b - 1) + 1)) < _OF_A_CODE for b in _CONVERTERS)


def _noise_stops(values: np.ndarray, begin: int, end: int, level: Level) -> bool:
    """True if a run is longer than explained by the noise beside it, on the side with less noise."""
    width = int(np.clip(2 * (end - begin), *_NEIGHBOURHOOD))
    sides = (values[max(begin - width, 0) : begin], values[end + 1 : end + 1 + width])
    sides = [side for side in sides if len(side) >= _MIN_SIDE_SAMPLES]
    if not sides:
        return False
    noise, changing = np.min([white_noise(np.diff(side, 4)) for side in sides], axis=0)
    local = level._replace(noise=float(noise))
    return bool(changing > _MIN_SIGN_CHANGES and local.beyond and end - begin + 1 >= local.pinned(len(values)))


def responses_move(record: Record, begin: int, end: int, levels: dict[str, Level]) -> bool:
    """True if all responses move during a run of the drive as elsewhere; if the drive is held, they rest or creep."""
    count = end - begin + 1
    starts = np.linspace(0, len(record) - count, _WINDOWS).astype(int)
    for channel in record.responses:
        values = record[channel]
        moved = np.std(values[begin : end + 1])
        usual = np.median([np.std(values[start : start + count]) for start in starts])
        if moved < max(_MIN_MOTION * usual, _ABOVE_NOISE * levels[channel].noise):
            return False
    return bool(record.responses)


def resumes_elsewhere(values: np.ndarray, begin: int, end: int) -> bool:
    """True if a channel resumes after a run at another value."""
    beside = np.concatenate(
        (values[max(begin - _NEIGHBOURHOOD[0], 0) : begin], values[end + 1 : end + 1 + _NEIGHBOURHOOD[0]])
    )
    usual = np.median(np.abs(np.diff(beside))) if len(beside) > 1 else np.inf
    return bool(end + 1 < len(values) and abs(values[end + 1] - values[end]) > _MIN_JUMP * usual)
