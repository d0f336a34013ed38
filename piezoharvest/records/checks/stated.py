"""Noise that a campaign states for a channel, against what its samples show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezoharvest.records.finding import Finding
from piezoharvest.records.record import Record

_MEDIAN = 0.6745  # of the size of a normal variable, in its standard deviations
_MORE = 30.0  # times: noise that is stated in another unit is off by far more


def stated_noise(record: Record) -> Iterator[Finding]:
    """Channels that are far noisier than is stated: a fit would have to follow their noise."""
    for channel, signal in record.signals.items():
        if signal.sigma is None or len(signal.values) < 100:
            continue
        times = _floor(signal.values) / signal.sigma
        if times > _MORE:
            message = (
                f"found noise {times:.2g} times the sigma that the campaign states, allowed is its standard deviation "
                "in the channel's unit"
            )
            yield Finding("warning", "sigma", signal.file, channel, (), message)


def _floor(values: np.ndarray) -> float:
    """At most the standard deviation of the noise: jumps stand out of differences, fast signals out of a spectrum."""
    scatter = np.median(np.abs(np.diff(values, 3))) / (_MEDIAN * np.sqrt(20.0))
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2 / len(values)
    fastest = power[int(0.8 * len(power)) :]
    return float(min(scatter, np.sqrt(np.median(fastest) / np.log(2.0))))
