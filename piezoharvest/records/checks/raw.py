"""Checks of raw samples: NaN, impossible magnitudes, and uneven time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.records.finding import Finding, Rows, runs, shifted
from piezoharvest.records.reading.channels import LARGEST, SMALLEST
from piezoharvest.records.record import Record

ALLOWED_MAGNITUDES = f"0, or sizes from {SMALLEST:g} to {LARGEST:g} in SI units"
_MIN_GAP = 1.5  # of the usual time between samples
_MAX_UNEVENNESS = 0.2  # of it


def not_a_number(record: Record) -> Iterator[Finding]:
    """Check for values that are NaN or infinite."""
    for channel, signal in (("time", record.time), *record.signals.items()):
        bad = ~np.isfinite(signal.values)
        if bad.any():
            rows = shifted(runs(bad), signal.first_row)
            message = f"found {counted(int(bad.sum()), 'value')} NaN, infinite or missing, allowed are finite numbers"
            yield Finding("error", "nan", signal.file, channel, rows, message)


def beyond_measure(record: Record) -> Iterator[Finding]:
    """Check for magnitudes that no measurement has, such as the 9.9e37 that instruments write for no value."""
    for channel, signal in (("time", record.time), *record.signals.items()):
        mask = impossible_magnitudes(signal.values)
        if mask.any():
            rows = shifted(runs(mask), signal.first_row)
            found = f"found {counted(int(mask.sum()), 'value')} such as {signal.values[mask][0]:g}"
            message = f"{found}, allowed are {ALLOWED_MAGNITUDES}"
            yield Finding("error", "size", signal.file, channel, rows, message)


def impossible_magnitudes(values: np.ndarray) -> np.ndarray:
    """Mask of the values with impossible magnitudes; small values count as such only if all values are small."""
    sizes = np.where(np.isfinite(values), np.abs(values), 0.0)
    return sizes > LARGEST if np.max(sizes, initial=0.0) >= SMALLEST else sizes > 0


def clock(record: Record) -> Iterator[Finding]:
    """Check for time stamps that repeat, run backward or leave a gap."""
    time = record.time
    if not np.isfinite(time.values).all():
        return
    steps = np.diff(time.values)
    usual = float(np.median(steps))
    allowed = "but time must increase in equal steps"

    def rows(mask: np.ndarray) -> Rows:
        """Rows after the steps of a mask."""
        return shifted(runs(mask) + 1, time.first_row)

    repeated, backward = steps == 0, steps < 0
    if repeated.any():
        message = f"found {counted(int(repeated.sum()), 'repeated time stamp')}, {allowed}"
        yield Finding("error", "repeated time", time.file, "time", rows(repeated), message)
    if backward.any():
        first = int(np.argmax(backward))
        found = f"found time running backward ({time.values[first]:.9g} s, then {time.values[first + 1]:.9g} s)"
        yield Finding("error", "backward time", time.file, "time", rows(backward), f"{found}, {allowed}")
    gaps = steps > _MIN_GAP * usual
    if usual > 0 and gaps.any():
        lost = float(np.max(steps[gaps]))
        found = f"found {counted(int(gaps.sum()), 'gap')}, the longest of {lost:.6g} s where {usual:.6g} s is usual"
        yield Finding("error", "gap", time.file, "time", rows(gaps), f"{found}, {allowed}")
    elif not (repeated | backward).any():
        yield from _uneven(record, steps)


def _uneven(record: Record, steps: np.ndarray) -> Iterator[Finding]:
    """Check for time stamps that deviate from even ones: a fit takes the samples as evenly spaced."""
    mean = record.duration / len(steps)
    stray = np.abs(record.time.values - record.time.values[0] - mean * np.arange(len(record))) > _MAX_UNEVENNESS * mean
    if stray.any():
        rows = shifted(runs(stray), record.time.first_row)
        message = f"found time stamps that differ from even ones by more than {_MAX_UNEVENNESS:.0%} of {mean:.6g} s"
        yield Finding(
            "warning", "uneven time", record.time.file, "time", rows, f"{message}, allowed are evenly spaced ones"
        )
