"""Noise of the channels in each record, relative to that in the whole campaign.

The noise of a sensor need not be one number: its range is set anew between records, or more runs are averaged. Which
part of the noise differs is read off the records themselves, without a model, so that no misfit counts as noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.identify.noise.differences import OF_MEDIAN, OF_VARIANCE, scatter_of, white_squares, white_variance
from piezoharvest.identify.noise.drive_denoising import MIN_NOISE, high_frequency_noise
from piezoharvest.identify.noise.pass_band import attenuated_noise
from piezoharvest.predict.circuit.setting import has_events
from piezoharvest.predict.drive import jumps_of
from piezoharvest.records.record import Record, Signal

FAST = ("voltage", "current", "acceleration")  # channels that change fast where a switch acts

MIN_SAMPLES = 1024  # of a record in which the pass band of a filter is sought: thirty lines in a tenth of the band

_FLOORS: WeakKeyDictionary[Signal, tuple[float, int] | None] = WeakKeyDictionary()


def is_smooth(record: Record, channel: str) -> bool:
    """True for a long record's channel without jumps, as what a switch does fast."""
    switched = channel in FAST and has_events(record.shunt, record.drive)
    return not switched and len(record) >= MIN_SAMPLES and not len(jumps_of(record[channel]))


def noise_floor(record: Record, channel: str) -> tuple[float, int] | None:
    """Standard deviation of a channel's noise from its highest frequencies, and the number of lines used.

    None where it does not show: a signal has energy at these frequencies, as what a switch does fast.
    """
    if channel in FAST and has_events(record.shunt, record.drive):
        return None
    signal = record.signals[channel]
    if signal not in _FLOORS:
        _FLOORS[signal] = _found_floor(record, channel)
    return _FLOORS[signal]


def _found_floor(record: Record, channel: str) -> tuple[float, int] | None:
    """Noise floor of a channel; of a response that a filter against aliasing attenuates, in the filter's pass band."""
    values = record[channel]
    if channel == record.drive or not is_smooth(record, channel):
        return high_frequency_noise(values) or _by_medians(values)
    of_responses = attenuated_noise(values, record[record.drive]) or high_frequency_noise(values)
    return of_responses or _by_differences(values) or _by_medians(values)


def _by_differences(values: np.ndarray) -> tuple[float, int] | None:
    """Noise floor where the spectrum is not flat by chance, because the noise is far larger at some times than others.

    As many lines of noise of constant variance would show it as well.
    """
    squares = white_squares(values)
    if squares is None or not squares.mean() > (MIN_NOISE * np.ptp(values)) ** 2:
        return None
    lines = 2.0 * len(values) / (OF_VARIANCE * scatter_of(values**2)) ** 2
    return float(np.sqrt(squares.mean())), max(1, int(lines))


def _by_medians(values: np.ndarray) -> tuple[float, int] | None:
    """Noise floor of a channel that jumps, or bends, in few of its samples."""
    variance = white_variance(values) if len(values) >= MIN_SAMPLES else None
    if variance is None or not variance > (MIN_NOISE * np.ptp(values)) ** 2:
        return None
    return float(np.sqrt(variance)), int(2.0 * len(values) / OF_MEDIAN**2)


def levels_of(records: Sequence[Record]) -> Mapping[str, Mapping[str, float]]:
    """Noise of the channels in each record by its name, relative to that in all of them; 1 where it does not show."""
    levels: dict[str, dict[str, float]] = {record.name: {} for record in records}
    for channel in sorted({channel for record in records for channel in record.signals}):
        those = [record for record in records if channel in record.signals]
        floors = [None if each.signals[channel].sigma is not None else noise_floor(each, channel) for each in those]
        for record, level in zip(those, relative_levels(floors), strict=True):
            levels[record.name][channel] = level
    return levels


def relative_levels(floors: Sequence[tuple[float, int] | None]) -> list[float]:
    """Standard deviations relative to their common one, 1 for those that are None.

    The logarithms scatter about their mean by the noise of each estimate, of variance 1 / (2 lines), and by what the
    records really differ by. The variance of the latter is estimated from all of them, and each drawn towards the mean
    as that demands (DerSimonian & Laird, Controlled Clinical Trials 7(3), 177-188, 1986): records with the same noise
    get the same level.

    Parameters
    ----------
    floors : sequence of (float, int) or None
        Estimated standard deviation and number of lines of each record.
    """
    shown = [floor for floor in floors if floor is not None]
    if len(shown) < 2:
        return [1.0] * len(floors)
    logs, variances = np.log([sigma for sigma, _ in shown]), 0.5 / np.array([lines for _, lines in shown])
    weights = 1.0 / variances
    mean = np.average(logs, weights=weights)
    excess = np.sum(weights * (logs - mean) ** 2) - (len(logs) - 1)
    between = max(0.0, excess / (weights.sum() - np.sum(weights**2) / weights.sum()))
    mean = np.average(logs, weights=1.0 / (variances + between))
    drawn = iter(np.exp(between / (between + variances) * (logs - mean)).tolist())
    return [1.0 if floor is None else next(drawn) for floor in floors]
