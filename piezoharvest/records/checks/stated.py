"""Checks of what a campaign states against its samples: the noise of a channel, and when records began."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.signal import periodogram
from scipy.signal.windows import kaiser

from piezoharvest.records.finding import Finding
from piezoharvest.records.record import FrequencyRecord, Record

_MEDIAN_OF_NORMAL = 0.6745  # of the absolute value of a normal variable, in its standard deviations
_MAX_RATIO = 30.0  # times: noise stated in a wrong unit is off by far more
# Times the standard deviation of all samples: that of 100 samples of noise alone is off by a tenth at most, slow noise
# by more.
_MAX_SHARE = 3.0
_MEANT = (
    "but sigma must be the standard deviation of the noise in the channel's unit (that of the file where the campaign "
    "states none)"
)


def stated_noise(record: Record) -> Iterator[Finding]:
    """Check for channels far noisier than stated, whose noise a fit would follow, or with less than that in all."""
    for channel, signal in record.signals.items():
        if signal.sigma is None or len(signal.values) < 100:
            continue
        times, moves = _floor(signal.values) / signal.sigma, float(np.std(signal.values))
        if times > _MAX_RATIO:
            message = f"found noise {times:.2g} times the sigma in the campaign, {_MEANT}"
            yield Finding("warning", "sigma", signal.file, channel, (), message)
        elif 0.0 < _MAX_SHARE * moves < signal.sigma:
            message = f"found a sigma {signal.sigma / moves:.2g} times the standard deviation of all samples, {_MEANT}"
            yield Finding("warning", "sigma", signal.file, channel, (), message)


def overlaps(records: Sequence[Record | FrequencyRecord]) -> list[tuple[Record, Finding]]:
    """Findings for records that begin before another one ends, where the campaign states when its records began.

    A specimen has one state at a time.
    """
    timed = [record for record in records if isinstance(record, Record) and not record.periodic]
    if not any(record.start_time for record in timed):
        return []
    found, before, end = [], "", -np.inf  # the record that lasts longest so far
    for record in sorted(timed, key=lambda record: record.start_time):
        if record.start_time < end:
            message = f"begins at {record.start_time:.6g} s by its start_time, but {before} lasts to {end:.6g} s"
            found.append((record, Finding("warning", "overlap", record.name, "start_time", (), message)))
        if record.start_time + record.duration > end:
            before, end = record.name, record.start_time + record.duration
    return found


def _floor(values: np.ndarray) -> float:
    """Lower bound of the noise's standard deviation, from third differences and from the highest frequencies."""
    scatter = np.median(np.abs(np.diff(values, 3))) / (_MEDIAN_OF_NORMAL * np.sqrt(20.0))
    # Without a window, the jump from a record's last sample to its first is at all frequencies: a drive 80 dB above
    # its noise would hide it. Kaiser's side lobes of this shape are 160 dB below.
    _, density = periodogram(values, window=kaiser(len(values), 20.0, sym=False), detrend="linear")
    fastest = density[int(0.8 * len(density)) :]
    return float(min(scatter, np.sqrt(np.median(fastest) / (2.0 * np.log(2.0)))))
