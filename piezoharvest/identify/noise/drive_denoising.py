"""The part of a measured drive that stands out of its noise.

Operators rectify: where a load is held they rest, while the noise of its measurement would let those of a model slip to
and fro. So a model is driven by the drive without what is noise for certain; the rest passes by its linear response.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.fft import dct, idct

from piezoharvest.identify.noise.kink_detection import OCTAVE, SHORT, signal_end, without_corners
from piezoharvest.identify.noise.tones import refined, tones
from piezoharvest.predict.drive import jumps_of
from piezoharvest.records.finding import runs

WIDTH = 4.0  # half width of a confidence interval in standard deviations
LEVELS = 13  # windows of 3, 7, 15, ... samples
SPARE = 2  # levels: averages are over a quarter of the samples that agree, so that their bias is far below the noise
HELD = 5.0  # standard deviations of the averages within which a drive counts as held at one value
LOUD = 1.5  # times the noise: a drive whose highest frequencies are stronger has them all
EXACT = 1e-6  # of its range: a drive with less noise is known exactly
BEYOND = 5.0  # standard deviations that noise may take single samples
AFTER = 256  # samples after a rest, from which on a drive has certainly set off; a beginning that is not looked into
GROWN = (8, 4)  # parts of a record, of which the first may be what sines take to grow
GROWING = 4.0  # times the usual squared difference from the drive without noise, that sines have until they are grown
SLOWEST = 10.0  # times the mean power of noise, beyond what the largest of the slow lines is expected to have
LEAST = 5  # level from which on an average is taken; what moves faster stays as it is


def denoised(values: np.ndarray, sigma: float) -> np.ndarray:
    """Drive without the frequencies at which it is noise alone, and averaged where it is held or moves steadily.

    Between jumps nothing is kept above the frequency from which on its cosine transform is level and as small as noise.
    Around every sample a window grows as long as the confidence intervals of all averages have a point in common
    (intersection of confidence intervals: Goldenshluger & Nemirovski, Mathematical Methods of Statistics 6(2), 135-170,
    1997; Katkovnik, IEEE Transactions on Signal Processing 47(9), 2567-2571, 1999).

    Parameters
    ----------
    values : (n,) array
    sigma : float
        Standard deviation of the noise, in the same unit.

    Returns
    -------
    (n,) array
    """
    found, held = _smooth(values, sigma)
    return _by_tones(values, held, sigma, found)


def noise_floor(values: np.ndarray) -> tuple[float, int] | None:
    """Standard deviation of the white noise that the highest frequencies show, and how many lines of it there are.

    None where a signal fills them, or a jump.
    """
    if len(jumps_of(values)) or len(values) < 2 * SHORT:
        return None
    power = np.asarray(dct(values, norm="ortho")) ** 2
    begin = signal_end(power)
    sigma = float(np.sqrt(power[begin:].mean())) if begin <= OCTAVE * len(values) else 0.0
    return (sigma, len(values) - begin) if sigma > EXACT * np.ptp(values) else None


def _smooth(values: np.ndarray, sigma: float) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Drive without noise whatever it is, and the runs (first, last) in which it is held."""
    sums = np.concatenate([[0.0], np.cumsum(values - values[0])])
    levels = _agreeing(values, sums, sigma) - SPARE
    found, held = np.empty(len(values)), []
    bounds = np.array([0, *(jumps_of(values) + 1), len(values)])
    for begin, end in pairwise(bounds):
        found[begin:end] = _slow(values[begin:end], sigma)
    for level in range(LEAST, LEVELS - SPARE + 1):
        places = np.flatnonzero(levels == level)
        found[places] = _average(sums, places, level) + values[0]
    for first, last in runs(levels >= LEAST):
        part = slice(first, last + 1)
        mean = values[part].mean()
        off = (found[part] - mean) * np.sqrt(2.0 ** (levels[part] + 1))
        if np.abs(off).max() < HELD * sigma:
            begin, end = bounds[bounds <= first].max(), bounds[bounds > last].min()
            first = begin if _holds(values[begin:first][::-1], mean, sigma) else first
            last = end - 1 if _holds(values[last + 1 : end], mean, sigma) else last
            found[first : last + 1] = values[first : last + 1].mean()
            held.append((int(first), int(last)))
    for (_, last), (first, _) in pairwise(held):
        _between(values, found, last, first, sigma)
    return found, held


def _between(values: np.ndarray, found: np.ndarray, last: int, first: int, sigma: float) -> None:
    """Bring a drive to between two values at which it is held before and after, if only noise takes it beyond.

    Operators would remember by how much it seemed to go too far.
    """
    low, high = sorted((found[last], found[first]))
    part = slice(last + 1, first)
    if np.all((values[part] > low - BEYOND * sigma) & (values[part] < high + BEYOND * sigma)):
        found[part] = np.clip(found[part], low, high)


def _by_tones(values: np.ndarray, held: list[tuple[int, int]], sigma: float, otherwise: np.ndarray) -> np.ndarray:
    """Drive as a sum of sines, from where on these leave noise alone: at once, after a rest or once grown."""
    count = len(values)
    rest = held[0][1] + 1 if held and held[0][0] == 0 else 0
    moving = count - sum(last + 1 - first for first, last in held)
    if rest > OCTAVE * count or moving < OCTAVE * (count - rest) or len(jumps_of(values)) or count < 4 * SHORT:
        return otherwise
    for begin in (rest + AFTER if rest else 0, *(max(rest, count // part) for part in GROWN)):
        fitted = tones(values[begin:])
        if fitted is None or not _is_noise(values[begin:] - fitted.since(0), sigma):
            continue
        found = fitted.since(begin)
        if rest:
            # It sets off where the sines follow what was measured better than the rest does.
            better = np.cumsum((values[:begin] - otherwise[0]) ** 2 - (values[:begin] - found[:begin]) ** 2)
            found[: int(np.argmin(better)) + 1] = otherwise[0]
        if begin and not _is_noise(values - found, sigma):
            found = _once_grown(values, found, otherwise, begin, fitted.angles, sigma)
        return found
    return otherwise


def _once_grown(
    values: np.ndarray, found: np.ndarray, otherwise: np.ndarray, begin: int, angles: np.ndarray, sigma: float
) -> np.ndarray:
    """Sines, known from some sample on, as far back as they leave noise alone; before that what it is otherwise."""
    squares = (found - otherwise) ** 2
    worse = np.cumsum(GROWING * squares[begin:].mean() - squares[:begin])
    grown = int(np.argmin(worse)) + 1
    while begin - grown > AFTER:
        further = refined(values[grown:], angles).since(0)
        if _is_noise(values[grown:] - further, sigma):
            return np.concatenate([otherwise[:grown], further])
        grown = (grown + begin) // 2
    return np.concatenate([otherwise[:begin], found[begin:]])


def _is_noise(left: np.ndarray, sigma: float) -> bool:
    """Whether a spectrum is level, as white noise is, and no more than the noise; slow lines, too, are no larger.

    Tones that lie closer than the record tells apart leave what looks like a slow drift.
    """
    power = np.asarray(dct(left, norm="ortho")) ** 2
    level = power.mean()
    slow = power[:SHORT].max() < level * (2.0 * np.log(SHORT) + SLOWEST)
    return slow and signal_end(power) <= SHORT and level < (LOUD * sigma) ** 2


def _holds(values: np.ndarray, held: float, sigma: float) -> bool:
    """Whether all averages from the first sample on, and from the last one back, are those of a drive that is held."""
    each = np.sqrt(np.arange(1.0, len(values) + 1.0))
    off = [np.abs(np.cumsum(part - held)) / each for part in (values, values[::-1])]
    return bool(np.max(off, initial=0.0) < HELD * sigma)


def _slow(values: np.ndarray, sigma: float) -> np.ndarray:
    """Values without what is noise alone at high frequencies.

    A cosine transform has a corner at either end unless the drive begins and ends at rest, and wherever a ramp begins
    or ends. Of the lines that this adds each may be less than noise, and all together many times as much at the corner:
    what has the same corners at the ends, and a bend wherever one stands out, is fitted to them and kept.
    """
    spectrum = np.asarray(dct(values, norm="ortho"))
    end = signal_end(spectrum**2)
    if end == len(values) or np.sqrt(np.mean(spectrum[end:] ** 2)) > LOUD * sigma:
        return values
    return values - np.asarray(idct(without_corners(spectrum, end), norm="ortho"))


def _average(sums: np.ndarray, places: np.ndarray, level: int) -> np.ndarray:
    """Averages over windows about some samples, from cumulative sums."""
    half = 2**level - 1
    return (sums[places + half + 1] - sums[places - half]) / (2 * half + 1)


def _agreeing(values: np.ndarray, sums: np.ndarray, sigma: float) -> np.ndarray:
    """Level of the largest window about every sample whose average agrees with those of the smaller ones."""
    found, centred = np.zeros(len(values), np.int8), values - values[0]
    lower, upper, grows = centred - WIDTH * sigma, centred + WIDTH * sigma, np.arange(len(values))
    for level in range(1, LEVELS + 1):
        half = 2**level - 1
        inside = (grows >= half) & (grows < len(values) - half)
        grows, lower, upper = grows[inside], lower[inside], upper[inside]
        mean, around = _average(sums, grows, level), WIDTH * sigma / np.sqrt(2 * half + 1)
        lower, upper = np.maximum(lower, mean - around), np.minimum(upper, mean + around)
        agree = lower < upper
        grows, lower, upper = grows[agree], lower[agree], upper[agree]
        found[grows] = level
    return found
