"""Time stamps that were printed with few digits: the even times that they are the rounded values of."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.records.reading.channels import LARGEST, SMALLEST

_NOTHING = 1e-12  # of the time between samples: less is a zero with errors of its own
_EXACT = 1e-6  # of it: stamps that are off by less are even as they are
_ROUNDING = 4 * np.finfo(float).eps  # of a stamp that is read and scaled
_DIGITS = 14  # significant ones: what has more was not rounded for printing
_FINE = 0.5  # of the time between samples: where stamps are rounded to no more, a lost sample shows as a gap
_MANY = 0.01  # of the stamps: coarse ones that are fewer, as where a decade begins, say nothing of the others
# Least share of steps that differ from the most common one, where they are rounded to more: rounding makes another step
# now and then all along, and a lost or doubled sample is one among many.
_REGULAR = 0.05


class Even(NamedTuple):
    """Even times, whether the stamps are too coarse to show a lost sample, and the unit of their last digit at most."""

    times: np.ndarray
    coarse: bool
    unit: float


def even_times(stamps: np.ndarray, step: float | None = None) -> Even | None:
    """Even times of which the stamps are the rounded values.

    Parameters
    ----------
    stamps : (n,) array
        As they were read, in any unit.
    step : float, optional
        Time between samples, where it is known, in the same unit; stamps may then be as coarse as they like.

    Returns
    -------
    Even or None
        None where the stamps are even as they are, or are not the rounded values of even times.
    """
    count = len(stamps)
    largest = np.max(np.abs(stamps), initial=0.0)
    if count < 4 or not SMALLEST < largest < LARGEST or not stamps[-1] > stamps[0]:  # NaN is neither
        return None
    mean = float(stamps[-1] - stamps[0]) / (count - 1)
    if np.max(np.abs(stamps - stamps[0] - mean * np.arange(count))) <= _EXACT * mean:
        return None
    units = _last_digits(np.where(np.abs(stamps) < _NOTHING * mean, 0.0, stamps))
    if units is None:
        return None
    # Most round to the last digit, some cut off what is behind it.
    tried = (_fitted(each, units, step) for each in (stamps, stamps + 0.5 * units * np.sign(stamps)))
    times = next((each for each in tried if each is not None), None)
    rough = units > _FINE * mean
    coarse = bool(np.mean(rough) > _MANY)
    if times is None or (step is None and coarse and not _regular(stamps[rough], units[rough])):
        return None
    return Even(times, coarse, float(units.max()))


def _fitted(stamps: np.ndarray, units: np.ndarray, step: float | None) -> np.ndarray | None:
    """Even times within half a digit of all stamps, where there are any: those of a round step or rate if they are."""
    index = np.arange(len(stamps))
    slack = np.empty(len(stamps))  # beside half a digit, what a fitted line may be off: 3.5 standard errors at its ends
    for unit in np.unique(units):
        slack[units == unit] = 0.5 * unit * (1.0 + 4.0 / np.sqrt(np.sum(units == unit)))

    def fits(trial: float) -> np.ndarray | None:
        """Times with a step, where they agree with all stamps."""
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
    """What one in the last printed digit of each stamp is; None where they have all the digits of a float.

    Printed are so many decimals or so many digits, whichever are fewer. Single precision has binary digits.
    """
    sizes = np.abs(stamps)
    decades = np.floor(np.log10(sizes, out=np.full(len(stamps), np.nan), where=sizes > 0) + 1e-12)
    found: dict[int, int] = {}  # decimals by decade
    for decade in np.unique(decades[sizes > 0]).astype(int).tolist():
        here = sizes[decades == decade]
        scaled = (here * 10.0**decimals for decimals in range(-decade, _DIGITS - decade))
        even = (np.all(np.abs(each - np.rint(each)) <= _ROUNDING * each) for each in scaled)
        found[decade] = next((decimals for decimals, fine in enumerate(even, -decade) if fine), _DIGITS - decade)
    if any(decimals + decade + 1 > _DIGITS for decade, decimals in found.items()):
        single = stamps.astype(np.float32)
        return np.spacing(np.abs(single)).astype(float) if np.array_equal(single, stamps) else None
    decimals = max(found.values())
    digits = max(decimals + decade + 1 for decade, decimals in found.items())
    units = 10.0 ** np.maximum(-decimals, decades + 1 - digits)
    return np.where(sizes > 0, units, 10.0**-decimals)


def _round_steps(slope: float, within: float) -> list[float]:
    """Steps near one that are round numbers, or those of round rates, the roundest first."""
    found = []
    for digits in range(1, 9):
        for trial in (1.0 / float(f"{1.0 / slope:.{digits}g}"), float(f"{slope:.{digits}g}")):
            if abs(trial - slope) <= within:
                found.append(trial)
    return found[:4]


def _regular(stamps: np.ndarray, units: np.ndarray) -> bool:
    """Whether coarse stamps, whose last digits are these, change by other than the usual step all along."""
    steps = np.rint(np.diff(stamps) / units.min())
    _, times = np.unique(steps, return_counts=True)
    return len(steps) > 0 and 1.0 - times.max() / len(steps) >= _REGULAR
