"""Time stamps printed with few digits: recovery of the evenly spaced times that were rounded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.records.reading.channels import LARGEST, SMALLEST

_ZERO = 1e-12  # of the sampling interval: less is a zero with rounding error
_EVEN_TOLERANCE = 1e-6  # of the sampling interval: stamps that deviate by less are even already
_ROUNDING = 4 * np.finfo(float).eps  # relative error of a stamp that is read and scaled
_MAX_DIGITS = 14  # significant digits: a stamp with more was not rounded for printing
_MAX_FINE_UNIT = 0.5  # of the sampling interval: in stamps rounded to no more than this, a lost sample shows as a gap
_MIN_COARSE_SHARE = 0.01  # of the stamps: fewer coarse ones, as at the beginning of a decade, do not make all coarse
# Least share of steps that differ from the most common one, for coarser stamps: rounding makes some steps differ
# throughout the record, while a lost or doubled sample is a single one.
_MIN_UNUSUAL_STEPS = 0.05


class Even(NamedTuple):
    """Even times, True if the stamps are too coarse to show a lost sample, and the largest unit of a last digit."""

    times: np.ndarray
    coarse: bool
    unit: float


def even_times(stamps: np.ndarray, step: float | None = None) -> Even | None:
    """Even times whose rounded values are the stamps.

    Parameters
    ----------
    stamps : (n,) array
        As read, in any unit.
    step : float, optional
        Known sampling interval in the same unit; the stamps may then have any coarseness.

    Returns
    -------
    Even or None
        None if the stamps are even already, or are not the rounded values of even times.
    """
    count = len(stamps)
    largest = np.max(np.abs(stamps), initial=0.0)
    if count < 4 or not SMALLEST < largest < LARGEST or not stamps[-1] > stamps[0]:  # NaN is neither
        return None
    mean = float(stamps[-1] - stamps[0]) / (count - 1)
    if np.max(np.abs(stamps - stamps[0] - mean * np.arange(count))) <= _EVEN_TOLERANCE * mean:
        return None
    units = _last_digits(np.where(np.abs(stamps) < _ZERO * mean, 0.0, stamps))
    if units is None:
        return None
    # Most instruments round to the last digit, some truncate.
    tried = (_fit_even_times(each, units, step) for each in (stamps, stamps + 0.5 * units * np.sign(stamps)))
    times = next((each for each in tried if each is not None), None)
    rough = units > _MAX_FINE_UNIT * mean
    coarse = bool(np.mean(rough) > _MIN_COARSE_SHARE)
    if times is None or (step is None and coarse and not _regular(stamps[rough], units[rough])):
        return None
    return Even(times, coarse, float(units.max()))


def _fit_even_times(stamps: np.ndarray, units: np.ndarray, step: float | None) -> np.ndarray | None:
    """Even times within half a digit of all stamps, with a round step or rate if possible; None if there are none."""
    index = np.arange(len(stamps))
    slack = np.empty(len(stamps))  # half a digit plus the error of a fitted line: 3.5 standard errors at its ends
    for unit in np.unique(units):
        slack[units == unit] = 0.5 * unit * (1.0 + 4.0 / np.sqrt(np.sum(units == unit)))

    def fits(trial: float) -> np.ndarray | None:
        """Times with a step; None if they disagree with a stamp."""
        times = trial * index
        times += np.average(stamps - times, weights=units**-2.0)
        return times if np.all(np.abs(stamps - times) <= slack) else None

    if step is not None:
        return fits(step)
    slope = float(np.polyfit(index, stamps - stamps[0], 1, w=1.0 / units)[0])
    times = fits(slope)
    if times is None:
        return None
    rounded = map(fits, _round_steps(slope, units.max() / len(stamps)))
    return next((each for each in rounded if each is not None), times)


def _last_digits(stamps: np.ndarray) -> np.ndarray | None:
    """Unit of the last printed digit of each stamp; None if the stamps have all digits of a float.

    Stamps are printed with fixed decimals or fixed digits, whichever are fewer. Single precision has binary digits.
    """
    sizes = np.abs(stamps)
    decades = np.floor(np.log10(sizes, out=np.full(len(stamps), np.nan), where=sizes > 0) + 1e-12)
    found: dict[int, int] = {}  # decimals by decade
    for decade in np.unique(decades[sizes > 0]).astype(int).tolist():
        here = sizes[decades == decade]
        scaled = (here * 10.0**decimals for decimals in range(-decade, _MAX_DIGITS - decade))
        even = (np.all(np.abs(each - np.rint(each)) <= _ROUNDING * each) for each in scaled)
        found[decade] = next((decimals for decimals, fine in enumerate(even, -decade) if fine), _MAX_DIGITS - decade)
    if any(decimals + decade + 1 > _MAX_DIGITS for decade, decimals in found.items()):
        single = stamps.astype(np.float32)
        return np.spacing(np.abs(single)).astype(float) if np.array_equal(single, stamps) else None
    decimals = max(found.values())
    digits = max(decimals + decade + 1 for decade, decimals in found.items())
    units = 10.0 ** np.maximum(-decimals, decades + 1 - digits)
    return np.where(sizes > 0, units, 10.0**-decimals)


def _round_steps(slope: float, within: float) -> list[float]:
    """Steps near `slope` that are round numbers or have round rates, those with the fewest digits first."""
    found = []
    for digits in range(1, 9):
        for trial in (1.0 / float(f"{1.0 / slope:.{digits}g}"), float(f"{slope:.{digits}g}")):
            if abs(trial - slope) <= within:
                found.append(trial)
    return found[:4]


def _regular(stamps: np.ndarray, units: np.ndarray) -> bool:
    """True if the steps of coarse stamps differ from the usual step throughout."""
    steps = np.rint(np.diff(stamps) / units.min())
    _, times = np.unique(steps, return_counts=True)
    return len(steps) > 0 and 1.0 - times.max() / len(steps) >= _MIN_UNUSUAL_STEPS
