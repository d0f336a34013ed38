"""Jumps of measured channels behind diodes and switches."""

from __future__ import annotations

import numpy as np

from piezoharvest.identify.noise.noise_model import initial_noise
from piezoharvest.records.record import Record

# A change between two samples is a jump from so many times the steepest one of a sine of the same range, beyond what
# noise changes by in a million samples.
MIN_STEEPNESS, NOISE_MARGIN = 2.0, 5.0 * np.sqrt(2.0)


def jumps_of(record: Record, channel: str, period: float) -> np.ndarray:
    """Mask (samples,) of those to which a channel jumps, for a period of the motion in s."""
    values, signal = record[channel], record.signals[channel]
    noise = initial_noise(values) if signal.sigma is None else signal.sigma
    most = MIN_STEEPNESS * np.pi / (record.sample_rate * period) * np.ptp(values) + NOISE_MARGIN * noise
    return np.abs(np.diff(values, prepend=values[0])) > most
