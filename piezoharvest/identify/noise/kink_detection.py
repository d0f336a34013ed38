"""What of the cosine transform of a measured drive is noise: not the lines that ramps have where they begin and end."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.fft import idct
from scipy.stats import chi2

SHORT = 32  # lines that are always kept
WIDE = 4.0  # standard deviations, by which the squares of many lines may be off what noise has
LARGEST = 20.0  # times the mean power of noise, beyond what the largest of many lines is expected to have
OCTAVE = 0.5  # of the lines: the highest octave has to be noise for a floor to be seen
ROUNDS = 32  # of looking for bends, each of which adds one
STANDS_OUT = 5.0  # standard deviations of what noise makes of a bend
SHARE = 0.1  # of the squares above noise, that each bend explains
PLAINER = 0.25  # of the line from which on a drive is noise, where it is with bends
FEW = 8  # samples, of which noise has no more squares anywhere than
CHANCE = 1e-2  # by this chance in a record
PART = 1 << 16  # lines at a time: those of all corners of a long record would not fit into memory


def without_corners(spectrum: np.ndarray, end: int) -> np.ndarray:
    """What of a cosine transform is noise, from a line on that is the lower the more corners are found.

    They are looked for half an octave below that line, too, where they are twice as large. What has not made noise of
    these lines in the end, all over the record, was no corner; nor was what only made noise of a few more: a ramp that
    sets off smoothly is like some bends there.

    Parameters
    ----------
    spectrum : (n,) array
        Cosine transform of all samples, orthonormal.
    end : int
        Line from which on it is noise as it stands: its `signal_end`.

    Returns
    -------
    (n,) array
        Zero below that line.
    """
    power, bends, tried, first, plain = spectrum**2, list[int](), list[int](), np.inf, end
    level = float(power[end:].mean())
    for _ in range(ROUNDS):
        low = int(end * np.sqrt(0.5))
        noise = _left(spectrum, tried, low)
        power[low:] = noise**2
        reached = signal_end(power)
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
    return place if told[place] > STANDS_OUT * np.sqrt(level * np.sum(weights**2) / count) else None


def signal_end(power: np.ndarray) -> int:
    """Line from which on powers, (n,), are level, as those of white noise are; looked for half an octave at a time."""
    end, level = len(power), power[int(OCTAVE * len(power)) :].mean()
    while end > SHORT:
        begin = int(end * np.sqrt(0.5))
        part, count = power[begin:end], end - begin
        largest = 2.0 * np.log(count) + LARGEST
        if part.sum() > level * (count + WIDE * np.sqrt(2.0 * count)) or part.max() > level * largest:
            break
        end = begin
    return end
