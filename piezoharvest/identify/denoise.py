"""The part of a measured drive that stands out of its noise.

Operators rectify: where a load is held they rest, while the noise of its measurement would let those of a model slip to
and fro. So a model is driven by the drive without what is noise for certain; the rest passes by its linear response.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.fft import dct, idct
from scipy.stats import chi2

from piezoharvest.identify.tones import tones
from piezoharvest.predict.drive import jumps_of
from piezoharvest.records.finding import runs

WIDTH = 4.0  # half width of a confidence interval in standard deviations
LEVELS = 13  # windows of 3, 7, 15, ... samples
SPARE = 2  # levels: averages are over a quarter of the samples that agree, so that their bias is far below the noise
HELD = 5.0  # standard deviations of the averages within which a drive counts as held at one value, or as straight
LOUD = 1.5  # times the noise: a drive whose highest frequencies are stronger has them all
PART = 1 << 16  # lines at a time: those of all corners of a long record would not fit into memory
ROUNDS = 32  # of looking for bends of a drive, each of which adds one: where a ramp begins or ends
FEW = 8  # samples, of which noise has no more squares anywhere than
CHANCE = 1e-2  # by this chance in a record
PLAINER = 0.25  # of the line from which on a drive is noise, where it is with bends
SHARE = 0.1  # of the squares above noise, that each bend explains
SHORT = 32  # lines that are always kept
LARGEST = 20.0  # times the mean power of noise, beyond what the largest of many lines is expected to have
EXACT = 1e-6  # of its range: a drive with less noise is known exactly
OCTAVE = 0.5  # of the lines: the highest octave has to be noise for a floor to be seen
BEYOND = 5.0  # standard deviations that noise may take single samples
AFTER = 256  # samples after a rest, from which on a drive has certainly set off
GROWN = (8, 4)  # parts of a record, of which the first may be what sines take to grow
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
    begin = _signal_end(power)
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
    if rest > OCTAVE * count or len(jumps_of(values)) or count < 4 * SHORT:
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
            found[:begin] = otherwise[:begin]
        return found
    return otherwise


def _is_noise(left: np.ndarray, sigma: float) -> bool:
    """Whether a spectrum is level, as white noise is, and no more than the noise; slow lines, too, are no larger.

    Tones that lie closer than the record tells apart leave what looks like a slow drift.
    """
    power = np.asarray(dct(left, norm="ortho")) ** 2
    level = power.mean()
    slow = power[:SHORT].max() < level * (2.0 * np.log(SHORT) + LARGEST)
    return slow and _signal_end(power) <= SHORT and level < (LOUD * sigma) ** 2


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
    end = _signal_end(spectrum**2)
    if end == len(values) or np.sqrt(np.mean(spectrum[end:] ** 2)) > LOUD * sigma:
        return values
    return values - np.asarray(idct(_without_corners(spectrum, end), norm="ortho"))


def _without_corners(spectrum: np.ndarray, end: int) -> np.ndarray:
    """What of a cosine transform is noise, from a line on that is the lower the more corners are found.

    They are looked for half an octave below that line, too, where they are twice as large. What has not made noise of
    these lines in the end, all over the record, was no corner; nor are what only made noise of a few more: a ramp that
    sets off smoothly is like some bends there.
    """
    power, bends, tried, first, plain = spectrum**2, list[int](), list[int](), np.inf, end
    level = float(power[end:].mean())
    for _ in range(ROUNDS):
        low = int(end * np.sqrt(0.5))
        noise = _left(spectrum, tried, low)
        power[low:] = noise**2
        reached = _signal_end(power)
        if reached < end:
            placed = _placed(spectrum, tried, int(reached * np.sqrt(0.5)), level) if tried != bends else bends
            if _level_all_over(_left(spectrum, placed, reached), len(spectrum), level):
                bends, tried, end, plain = placed, placed, reached, plain if placed else reached
                continue
        more, above = len(tried) - len(bends), np.sum(noise[: end - low] ** 2) - level * (end - low)
        first = first if more else above
        found = _bend(noise, len(spectrum), level)
        if found is None or above > (1.0 - SHARE * more) * first:
            break
        tried = [*tried, found]
    bends, end = (bends, end) if end < PLAINER * plain else ([], plain)
    return np.concatenate([np.zeros(end), _left(spectrum, bends, end)])


def _level_all_over(noise: np.ndarray, count: int, level: float) -> bool:
    """Whether the highest lines are noise of some mean power at every time: no sample, and no few, stand out of it."""
    squares = np.asarray(idct(np.pad(noise, (count - len(noise), 0)), norm="ortho")) ** 2 / level
    some = np.convolve(squares, np.ones(FEW), "valid")
    return bool(squares.max() < chi2.isf(CHANCE / count, 1) and some.max() < chi2.isf(CHANCE / count, FEW))


def _placed(spectrum: np.ndarray, bends: list[int], begin: int, level: float) -> list[int]:
    """Bends where the lines from one on want each of them beside the others."""
    for k in range(len(bends)):
        again = _bend(_left(spectrum, bends[:k] + bends[k + 1 :], begin), len(spectrum), level)
        moved = [*bends[:k], bends[k] if again is None else again, *bends[k + 1 :]]
        if moved != bends:
            bends = min(bends, moved, key=lambda some: np.sum(_left(spectrum, some, begin) ** 2))
    return bends


def _left(spectrum: np.ndarray, bends: Sequence[int], begin: int) -> np.ndarray:
    """Lines from one on without those that corners have, as all of them tell these."""
    count = len(spectrum)
    ends = [*range(begin, count, PART), count]
    shapes = lru_cache(1)(lambda low, high: _corners(bends, begin, np.arange(low, high), count))
    products = [
        shapes(low, high).T @ np.column_stack([shapes(low, high), spectrum[low:high]]) for low, high in pairwise(ends)
    ]
    together = np.sum(products, axis=0)
    sizes = np.linalg.lstsq(together[:, :-1], together[:, -1])[0]
    return np.concatenate([spectrum[low:high] - shapes(low, high) @ sizes for low, high in pairwise(ends)])


def _corners(bends: Sequence[int], begin: int, lines: np.ndarray, count: int) -> np.ndarray:
    """Some lines of the slopes and the third derivatives at both ends of a record, and of bends, (lines, shapes).

    Those of a bend are those of its second difference over squares of frequencies; beside it are a step and a sample
    that move it to between samples.
    """
    angles, lowest = np.pi * lines / count, np.pi * begin / count
    weights = (1.0 - np.cos(lowest)) / (1.0 - np.cos(angles))
    found = [power * np.cos(angles * (end + 0.5)) for end in (0, count - 1) for power in (weights, weights**2)]
    for place in bends:
        wave, slope = np.cos(angles * (place + 0.5)), np.sin(angles * (place + 0.5)) * np.sin(angles)
        found += [weights * wave, weights * slope / np.sin(lowest), wave]
    return np.column_stack(found)


def _bend(noise: np.ndarray, count: int, level: float) -> int | None:
    """Sample at which a bend stands out most of the highest lines of noise of some mean power; None where none does."""
    begin = count - len(noise)
    weights = 1.0 / (1.0 - np.cos(np.pi * np.arange(begin, count) / count))
    told = np.abs(np.asarray(idct(np.pad(weights * noise, (begin, 0)), norm="ortho")))
    place = int(np.argmax(told))
    return place if told[place] > HELD * np.sqrt(level * np.sum(weights**2) / count) else None


def _signal_end(power: np.ndarray) -> int:
    """Line from which on a spectrum is level, as white noise is; looked for half an octave at a time."""
    end, level = len(power), power[int(OCTAVE * len(power)) :].mean()
    while end > SHORT:
        begin = int(end * np.sqrt(0.5))
        part, count = power[begin:end], end - begin
        largest = 2.0 * np.log(count) + LARGEST
        if part.sum() > level * (count + WIDTH * np.sqrt(2.0 * count)) or part.max() > level * largest:
            break
        end = begin
    return end


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
