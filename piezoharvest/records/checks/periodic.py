"""Checks of a few periods of a sine in steady state: that the drive is periodic, and the responses have settled."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.records.checks.level import white_noise
from piezoharvest.records.finding import Finding, Rows, shifted
from piezoharvest.records.harmonics import Harmonics
from piezoharvest.records.reading.channels import UNITS
from piezoharvest.records.record import Record

_MIN_PERIODS = 2.0  # two show that it repeats
_MAX_NOISE_RATIO = 2.0  # rms of what is not periodic over the noise, which fifty samples tell to a quarter
_MIN_REST = 1e-4  # of the drive's range: less has no influence that sensors resolve
_MIN_CHANGE = 0.02  # of an amplitude: periods that are no whole number of samples differ by up to one of them
_MIN_STANDARD_ERRORS = 6.0  # by which an amplitude changes
_DC = ("dc_voltage", "dc_current")  # whose mean is the signal
_OTHERWISE = 'omit kind = "periodic" where that is not so'


def periodic(record: Record) -> Iterator[Finding]:
    """Check a record of kind "periodic"; others have nothing to be checked here."""
    if not record.periodic:
        return
    found, signal = record.harmonics, record.signals[record.drive]
    rows = shifted([(0, len(record) - 1)], signal.first_row)
    wrong = "found no sine in the drive, but it must be one" if found is None else _not_periodic(record, found)
    if wrong:
        yield Finding("error", "periodic", signal.file, record.drive, rows, f"{wrong}; {_OTHERWISE}")
    elif found is not None:
        yield from _not_settled(record, found, rows)


def _not_periodic(record: Record, found: Harmonics) -> str:
    """Why a drive is not the fitted one within its noise, or ""."""
    step, values, signal = 1.0 / record.sample_rate, record[record.drive], record.signals[record.drive]
    periods = found.frequency * step * len(record)
    named = f"{found.frequency:.6g} Hz" + (" (as stated)" if found.stated else "")
    if periods < _MIN_PERIODS - 0.5 * found.frequency * step:
        many = counted(f"{periods:.3g}", "period")
        return f"found {many} of {named}, but a drive must repeat, so two or more are needed"
    left = values - found.at(step * np.arange(len(record)))
    noise = white_noise(np.diff(left, 4))[0] if signal.sigma is None else signal.sigma
    rest = float(np.sqrt(np.mean(left**2)))
    if rest <= max(_MAX_NOISE_RATIO * noise, _MIN_REST * float(np.ptp(values))):
        return ""
    unit = UNITS[record.drive]
    return (
        f"found {rest:.2g} {unit} in addition to a sine of {named} and its harmonics, where the noise is {noise:.2g} "
        f"{unit}, "
        "but the drive must repeat within its noise"
    )


def _not_settled(record: Record, found: Harmonics, rows: Rows) -> Iterator[Finding]:
    """Findings for responses whose last period is not like the first one."""
    count = max(round(record.sample_rate / found.frequency), 1)
    turns = np.exp(-2j * np.pi * found.frequency * np.arange(len(record)) / record.sample_rate)
    for channel in (channel for channel in record.responses if channel != "gate"):
        signal = record.signals[channel]
        values = signal.values - signal.values.mean() * (channel not in _DC)
        weights = np.ones(len(record)) if channel in _DC else 2.0 * turns
        first, last = np.mean((weights * values)[:count]), np.mean((weights * values)[-count:])
        error = white_noise(np.diff(values, 4))[0] * np.sqrt(4.0 / count)
        change, size = abs(last - first), max(abs(first), abs(last))
        if change > max(_MIN_CHANGE * size, _MIN_STANDARD_ERRORS * error):
            found_change = f"found a change by {change / size:.1%} from the first to the last period"
            message = f"{found_change}, but in steady state all transients have decayed; {_OTHERWISE}"
            yield Finding("warning", "periodic", signal.file, channel, rows, message)
