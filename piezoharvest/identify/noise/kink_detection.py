"""Noise in the cosine transform of a measured drive, apart from the lines due to kinks at the ends of ramps."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.fft import idct
from scipy.stats import chi2

MIN_LINES = 32  # lines that are always kept
SUM_STANDARD_DEVIATIONS = 4.0  # standard deviations of the sum of squares of many lines of noise
LARGEST_LINE_MARGIN = 20.0  # times the mean power of noise, above the expected largest of many lines
HIGHEST_OCTAVE = 0.5  # of the lines: the highest octave must be noise for an estimate of the floor
MAX_ROUNDS = 32  # of the search for kinks, each of which adds one
KINK_SIGNIFICANCE = 5.0  # standard deviations of a kink's size due to noise
MIN_KINK_SHARE = 0.1  # least share of the squares above noise that each kink explains
MAX_END_RATIO = 0.25  # of the line from which on a drive is noise: kinks must lower it to less than this
WINDOW_SAMPLES = 8  # consecutive samples whose sum of squares is tested against noise
FALSE_ALARM_PROBABILITY = 1e-2  # probability of a false alarm in a record
LINES_AT_A_TIME = 1 << 16  # lines of a block: all lines of all kinks of a long record would not fit into memory
KEPT = 32  # blocks of ends and of kinks, each of at most 1.5 MiB: a search asks for the same ones again and again


def kink_free_noise(spectrum: np.ndarray, end: int) -> np.ndarray:
    """Noise in a cosine transform, from a line on that is lower the more kinks are found.

    Kinks are also searched for half an octave below that line, where they are twice as large. They are accepted only
    if the lines left are noise throughout the record, and if they lower the line by far: a ramp that begins smoothly
    resembles some kinks.

    Parameters
    ----------
    spectrum : (n,) array
        Cosine transform of all samples, orthonormal.
    end : int
        Line from which on it is noise without kinks: its `signal_end`.

    Returns
    -------
    (n,) array
        Zero below the line found.
    """
    power, bends, tried, first, plain = spectrum**2, list[int](), list[int](), np.inf, end
    level = float(power[end:].mean())
    for _ in range(MAX_ROUNDS):
        low = int(end * np.sqrt(0.5))
        noise = _residual_lines(spectrum, tried, low)
        power[low:] = noise**2
        reached = signal_end(power)
        if reached < end:
            placed = _refined_kinks(spectrum, tried, int(reached * np.sqrt(0.5)), level) if tried != bends else bends
            if _is_stationary_noise(_residual_lines(spectrum, placed, reached), len(spectrum), level):
                bends, tried, end, plain = placed, placed, reached, plain if placed else reached
                continue
        more, above = len(tried) - len(bends), np.sum(noise[: end - low] ** 2) - level * (end - low)
        first = first if more else above
        found = _largest_kink(noise, len(spectrum), level)
        if found is None or above > (1.0 - MIN_KINK_SHARE * more) * first:
            break
        tried = [*tried, found]
    bends, end = (bends, end) if end < MAX_END_RATIO * plain else ([], plain)
    return np.concatenate([np.zeros(end), _residual_lines(spectrum, bends, end)])


def _is_stationary_noise(noise: np.ndarray, count: int, level: float) -> bool:
    """True if the highest lines are stationary noise of a mean power: no sample, and no few in a row, exceed it."""
    squares = np.asarray(idct(np.pad(noise, (count - len(noise), 0)), norm="ortho")) ** 2 / level
    some = np.convolve(squares, np.ones(WINDOW_SAMPLES), "valid")
    return bool(
        squares.max() < _largest_sum_of_noise(count, 1) and some.max() < _largest_sum_of_noise(count, WINDOW_SAMPLES)
    )


@lru_cache(KEPT)
def _largest_sum_of_noise(count: int, together: int) -> float:
    """Sum of squares of some samples in a row of unit white noise that few records of `count` samples exceed."""
    return float(chi2.isf(FALSE_ALARM_PROBABILITY / count, together))


def _refined_kinks(spectrum: np.ndarray, bends: list[int], begin: int, level: float) -> list[int]:
    """Kinks with each position refined in turn, the others fixed, by the lines from `begin` on."""
    for k in range(len(bends)):
        again = _largest_kink(_residual_lines(spectrum, bends[:k] + bends[k + 1 :], begin), len(spectrum), level)
        moved = [*bends[:k], bends[k] if again is None else again, *bends[k + 1 :]]
        if moved != bends:
            bends = min(bends, moved, key=lambda some: np.sum(_residual_lines(spectrum, some, begin) ** 2))
    return bends


def _residual_lines(spectrum: np.ndarray, bends: Sequence[int], begin: int) -> np.ndarray:
    """Lines from `begin` on minus the least-squares fit of kinks and ends to all of them."""
    count = len(spectrum)
    bounds = [begin, *range((begin // LINES_AT_A_TIME + 1) * LINES_AT_A_TIME, count, LINES_AT_A_TIME), count]
    shapes = lru_cache(1)(lambda low, high: _kink_shapes(bends, begin, low, high, count))
    products = [
        shapes(low, high) @ np.vstack([shapes(low, high), spectrum[low:high]]).T for low, high in pairwise(bounds)
    ]
    together = np.sum(products, axis=0)
    sizes = np.linalg.lstsq(together[:, :-1], together[:, -1])[0]
    return np.concatenate([spectrum[low:high] - sizes @ shapes(low, high) for low, high in pairwise(bounds)])


def _kink_shapes(bends: Sequence[int], begin: int, low: int, high: int, count: int) -> np.ndarray:
    """Lines of the slopes and the third derivatives at both ends of a record, and of kinks, (shapes, lines).

    The lines of a kink are those of its second difference over squared frequencies; a step and a single sample are
    added, by which a kink may lie between samples. All are about one at the line `begin`.
    """
    block, lowest = low // LINES_AT_A_TIME, np.pi * begin / count
    part = slice(low - block * LINES_AT_A_TIME, high - block * LINES_AT_A_TIME)
    weight = 1.0 - np.cos(lowest)
    of_ends, of_bends = [weight, weight**2], [weight, weight / np.sin(lowest), 1.0]
    found = [_lines_of_end(end, block, count)[:, part] for end in (0, count - 1)]
    found += [_lines_of_kink(place, block, count)[:, part] for place in bends]
    return np.concatenate(found) * np.array([*of_ends, *of_ends, *of_bends * len(bends)])[:, None]


@lru_cache(KEPT)
def _lines_of_end(end: int, block: int, count: int) -> np.ndarray:
    """Slope and third derivative at the first or the last sample, (2, lines of a block)."""
    angles, weights = _angles_and_weights(block, count)
    return np.cos(angles * (end + 0.5)) * np.array([weights, weights**2])


@lru_cache(KEPT)
def _lines_of_kink(place: int, block: int, count: int) -> np.ndarray:
    """Kink, step and single sample at a sample, (3, lines of a block)."""
    angles, weights = _angles_and_weights(block, count)
    wave, slope = np.cos(angles * (place + 0.5)), np.sin(angles * (place + 0.5)) * np.sin(angles)
    return np.array([weights * wave, weights * slope, wave])


@lru_cache(2)
def _angles_and_weights(block: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Angle of every line of a block for a sample, and the weight that two differences have there."""
    lines = np.arange(block * LINES_AT_A_TIME, min((block + 1) * LINES_AT_A_TIME, count))
    angles = np.pi * np.maximum(lines, 1) / count  # the mean is never asked for
    return angles, 1.0 / (1.0 - np.cos(angles))


def _largest_kink(noise: np.ndarray, count: int, level: float) -> int | None:
    """Sample of the most significant kink in the highest lines, for noise of a mean power, or None."""
    begin = count - len(noise)
    weights = 1.0 / (1.0 - np.cos(np.pi * np.arange(begin, count) / count))
    statistic = np.abs(np.asarray(idct(np.pad(weights * noise, (begin, 0)), norm="ortho")))
    place = int(np.argmax(statistic))
    return place if statistic[place] > KINK_SIGNIFICANCE * np.sqrt(level * np.sum(weights**2) / count) else None


def signal_end(power: np.ndarray) -> int:
    """Line from which on powers, (n,), are flat, as for white noise; searched in steps of half an octave."""
    end, level = len(power), power[int(HIGHEST_OCTAVE * len(power)) :].mean()
    while end > MIN_LINES:
        begin = int(end * np.sqrt(0.5))
        part, count = power[begin:end], end - begin
        largest = 2.0 * np.log(count) + LARGEST_LINE_MARGIN
        if (
            part.sum() > level * (count + SUM_STANDARD_DEVIATIONS * np.sqrt(2.0 * count))
            or part.max() > level * largest
        ):
            break
        end = begin
    return end
