"""Removal of the noise from a measured drive.

Hysteresis operators rectify: under a constant load they rest, but measurement noise would make those of a model slip
back and forth. So a model is driven by the drive without what is certainly noise; the rest passes its linear response.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.fft import dct, idct

from piezoharvest.identify.noise.kink_detection import HIGHEST_OCTAVE, MIN_LINES, kink_free_noise, signal_end
from piezoharvest.identify.noise.tones import DriveTones, refined, tones
from piezoharvest.predict.drive import jumps_of
from piezoharvest.records.finding import runs

INTERVAL_HALF_WIDTH = 4.0  # half width of a confidence interval in standard deviations
WINDOW_LEVELS = 13  # windows of 3, 7, 15, ... samples
SPARE_LEVELS = 2  # levels: averages use a quarter of the samples that agree, so that their bias is far below the noise
MAX_CONSTANT_DEVIATION = 5.0  # standard deviations of the averages within which a drive counts as constant
MAX_NOISE_RATIO = 1.5  # times the noise: a drive with stronger highest frequencies keeps all of them
MIN_NOISE = 1e-6  # of its range: a drive with less noise is known exactly
MAX_OVERSHOOT = 5.0  # standard deviations of noise in single samples
ONSET_SAMPLES = 256  # samples after a rest, from which on a drive certainly moves; length of a beginning left as it is
BUILD_UP_PARTS = (8, 4)  # parts of a record, of which the first may be the build-up of sines
BUILD_UP_RATIO = (
    4.0  # times the usual squared difference from the denoised drive, which sines exceed while they build up
)
SLOW_LINE_MARGIN = 10.0  # times the mean power of noise, above the expected largest of the slow lines
MIN_LEVEL = 5  # level from which on an average is taken; faster parts are left unchanged


class FoundTones(NamedTuple):
    """Sines that a drive was found to be from a sample on, if any: start values for the same drive with other noise."""

    begin: int
    angles: np.ndarray


NO_TONES = FoundTones(0, np.empty(0))


def denoised(values: np.ndarray, sigma: float) -> np.ndarray:
    """Drive without the frequencies at which it is only noise, and averaged where it is constant or moves steadily.

    Between jumps, frequencies from which on the cosine transform is flat and as small as noise are removed. Around
    every sample, a window grows as long as the confidence intervals of all averages have a point in common
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
    return denoised_and_tones(values, sigma)[0]


def denoised_and_tones(
    values: np.ndarray, sigma: float, like: FoundTones | None = None
) -> tuple[np.ndarray, FoundTones]:
    """As `denoised`, with the sines that the drive was found to be; those of one `like` it are tried first.

    Finding them anew takes ten times as long as refining them. Where one like it is no sum of sines, it is none either.
    """
    levels, averages = _averages(values, sigma)
    plateaus = _plateaus(values, levels, averages, sigma)
    if like is not NO_TONES and (like is None or not like.begin):
        steady = _steady_tones(values, plateaus, sigma, like)
        if steady is not None:
            return steady.since(0), FoundTones(0, steady.angles)
    otherwise = _locally_averaged(values, levels, averages, plateaus, sigma)
    if like is NO_TONES:
        return otherwise, NO_TONES
    return _fit_tones(values, plateaus, sigma, otherwise, like)


def high_frequency_noise(values: np.ndarray) -> tuple[float, int] | None:
    """Standard deviation of white noise from the highest frequencies, and the number of lines used.

    None if a signal or a jump has energy at these frequencies.
    """
    if len(jumps_of(values)) or len(values) < 2 * MIN_LINES:
        return None
    power = np.asarray(dct(values, norm="ortho")) ** 2
    begin = signal_end(power)
    sigma = float(np.sqrt(power[begin:].mean())) if begin <= HIGHEST_OCTAVE * len(values) else 0.0
    return (sigma, len(values) - begin) if sigma > MIN_NOISE * np.ptp(values) else None


def _averages(values: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Level of the window about every sample, and the averages of those from `MIN_LEVEL` on; others are zero."""
    sums = np.concatenate([[0.0], np.cumsum(values - values[0])])
    levels = _window_levels(values, sums, sigma) - SPARE_LEVELS
    averages = np.zeros(len(values))
    for level in range(MIN_LEVEL, WINDOW_LEVELS - SPARE_LEVELS + 1):
        places = np.flatnonzero(levels == level)
        averages[places] = _average(sums, places, level) + values[0]
    return levels, averages


def _plateaus(values: np.ndarray, levels: np.ndarray, averages: np.ndarray, sigma: float) -> list[tuple[int, int]]:
    """Runs (first, last) of samples in which a drive is constant."""
    found, bounds = [], _bounds(values)
    for first, last in runs(levels >= MIN_LEVEL):
        part = slice(first, last + 1)
        mean = values[part].mean()
        off = (averages[part] - mean) * np.sqrt(2.0 ** (levels[part] + 1))
        if np.abs(off).max() < MAX_CONSTANT_DEVIATION * sigma:
            begin, end = bounds[bounds <= first].max(), bounds[bounds > last].min()
            first = begin if _is_constant(values[begin:first][::-1], mean, sigma) else first
            last = end - 1 if _is_constant(values[last + 1 : end], mean, sigma) else last
            found.append((int(first), int(last)))
    return found


def _bounds(values: np.ndarray) -> np.ndarray:
    """First samples of the parts between jumps, and the number of samples."""
    return np.array([0, *(jumps_of(values) + 1), len(values)])


def _locally_averaged(
    values: np.ndarray, levels: np.ndarray, averages: np.ndarray, plateaus: list[tuple[int, int]], sigma: float
) -> np.ndarray:
    """Drive of any kind without noise."""
    found = np.empty(len(values))
    for begin, end in pairwise(_bounds(values)):
        found[begin:end] = _without_high_frequencies(values[begin:end], sigma)
    found = np.where(levels >= MIN_LEVEL, averages, found)
    for first, last in plateaus:
        found[first : last + 1] = values[first : last + 1].mean()
    for (_, last), (first, _) in pairwise(plateaus):
        _clip_between(values, found, last, first, sigma)
    return found


def _clip_between(values: np.ndarray, found: np.ndarray, last: int, first: int, sigma: float) -> None:
    """Clip a drive between two constant values before and after, if only noise takes it beyond.

    Hysteresis operators would keep a memory of the apparent overshoot.
    """
    low, high = sorted((found[last], found[first]))
    part = slice(last + 1, first)
    if np.all((values[part] > low - MAX_OVERSHOOT * sigma) & (values[part] < high + MAX_OVERSHOOT * sigma)):
        found[part] = np.clip(found[part], low, high)


def _moves_later(values: np.ndarray, plateaus: list[tuple[int, int]]) -> tuple[int, bool]:
    """Samples of a rest at the beginning, and whether a drive may be a sum of sines after it."""
    count = len(values)
    rest = plateaus[0][1] + 1 if plateaus and plateaus[0][0] == 0 else 0
    moving = count - sum(last + 1 - first for first, last in plateaus)
    still = rest > HIGHEST_OCTAVE * count or moving < HIGHEST_OCTAVE * (count - rest)
    return rest, not (still or len(jumps_of(values)) or count < 4 * MIN_LINES)


def _steady_tones(
    values: np.ndarray, plateaus: list[tuple[int, int]], sigma: float, like: FoundTones | None
) -> DriveTones | None:
    """Drive as a sum of sines throughout, or None: the usual one, for which no other way needs to be tried."""
    rest, moves = _moves_later(values, plateaus)
    fitted = tones(values, None if like is None else like.angles) if moves and not rest else None
    return fitted if fitted is not None and _is_noise(values - fitted.since(0), sigma) else None


def _fit_tones(
    values: np.ndarray, plateaus: list[tuple[int, int]], sigma: float, otherwise: np.ndarray, like: FoundTones | None
) -> tuple[np.ndarray, FoundTones]:
    """Drive as a sum of sines, from where on these leave only noise: after a rest or after a build-up."""
    count = len(values)
    rest, moves = _moves_later(values, plateaus)
    if not moves:
        return otherwise, NO_TONES
    begins = [*([rest + ONSET_SAMPLES] if rest else []), *(max(rest, count // part) for part in BUILD_UP_PARTS)]
    for begin in begins if like is None else sorted(begins, key=lambda each: each != like.begin):
        fitted = tones(values[begin:], None if like is None else like.angles)
        if fitted is None or not _is_noise(values[begin:] - fitted.since(0), sigma):
            continue
        found = fitted.since(begin)
        if rest:
            # The motion begins where the sines fit the measured drive better than the rest value.
            better = np.cumsum((values[:begin] - otherwise[0]) ** 2 - (values[:begin] - found[:begin]) ** 2)
            found[: int(np.argmin(better)) + 1] = otherwise[0]
        if not _is_noise(values - found, sigma):
            found = _after_build_up(values, found, otherwise, begin, fitted.angles, sigma)
        return found, FoundTones(begin, fitted.angles)
    return otherwise, NO_TONES


def _after_build_up(
    values: np.ndarray, found: np.ndarray, otherwise: np.ndarray, begin: int, angles: np.ndarray, sigma: float
) -> np.ndarray:
    """Sines that fit from sample `begin` on, extended back as far as they leave only noise; `otherwise` before that."""
    squares = (found - otherwise) ** 2
    worse = np.cumsum(BUILD_UP_RATIO * squares[begin:].mean() - squares[:begin])
    grown = int(np.argmin(worse)) + 1
    while begin - grown > ONSET_SAMPLES:
        further = refined(values[grown:], angles).since(0)
        if _is_noise(values[grown:] - further, sigma):
            return np.concatenate([otherwise[:grown], further])
        grown = (grown + begin) // 2
    return np.concatenate([otherwise[:begin], found[begin:]])


def _is_noise(left: np.ndarray, sigma: float) -> bool:
    """True if a residual has a flat spectrum and no more than the noise's power, in its slow lines as well.

    Tones that are closer than the record resolves leave a residual like a slow drift.
    """
    power = np.asarray(dct(left, norm="ortho")) ** 2
    level = power.mean()
    slow = power[:MIN_LINES].max() < level * (2.0 * np.log(MIN_LINES) + SLOW_LINE_MARGIN)
    return slow and signal_end(power) <= MIN_LINES and level < (MAX_NOISE_RATIO * sigma) ** 2


def _is_constant(values: np.ndarray, level: float, sigma: float) -> bool:
    """True if all averages from the first sample on, and from the last one back, agree with a constant value."""
    each = np.sqrt(np.arange(1.0, len(values) + 1.0))
    off = [np.abs(np.cumsum(part - level)) / each for part in (values, values[::-1])]
    return bool(np.max(off, initial=0.0) < MAX_CONSTANT_DEVIATION * sigma)


def _without_high_frequencies(values: np.ndarray, sigma: float) -> np.ndarray:
    """Values without their high frequencies if these are only noise.

    The cosine transform sees a corner at either end unless the drive begins and ends at rest, and wherever a ramp
    begins or ends. Each of the resulting lines may be below noise, but their sum at the corner far above it. So shapes
    with the same corners at the ends, and a kink wherever one is significant, are fitted to the lines and kept.
    """
    spectrum = np.asarray(dct(values, norm="ortho"))
    end = signal_end(spectrum**2)
    if end == len(values) or np.sqrt(np.mean(spectrum[end:] ** 2)) > MAX_NOISE_RATIO * sigma:
        return values
    return values - np.asarray(idct(kink_free_noise(spectrum, end), norm="ortho"))


def _average(sums: np.ndarray, places: np.ndarray, level: int) -> np.ndarray:
    """Averages over windows of a level about some samples, from cumulative sums."""
    half = 2**level - 1
    return (sums[places + half + 1] - sums[places - half]) / (2 * half + 1)


def _window_levels(values: np.ndarray, sums: np.ndarray, sigma: float) -> np.ndarray:
    """Level of the largest window about every sample whose average agrees with those of the smaller ones."""
    found, centred = np.zeros(len(values), np.int8), values - values[0]
    lower, upper = centred - INTERVAL_HALF_WIDTH * sigma, centred + INTERVAL_HALF_WIDTH * sigma
    grows = np.arange(len(values))
    for level in range(1, WINDOW_LEVELS + 1):
        half = 2**level - 1
        inside = (grows >= half) & (grows < len(values) - half)
        grows, lower, upper = grows[inside], lower[inside], upper[inside]
        mean, around = _average(sums, grows, level), INTERVAL_HALF_WIDTH * sigma / np.sqrt(2 * half + 1)
        lower, upper = np.maximum(lower, mean - around), np.minimum(upper, mean + around)
        agree = lower < upper
        grows, lower, upper = grows[agree], lower[agree], upper[agree]
        found[grows] = level
    return found
