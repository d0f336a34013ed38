"""Test for a constant offset of the voltage channel, such as that of an oscilloscope.

A mean voltage on a resistor can only last if a current into the node sustains it, in proportion to the resistance. A
mean that is larger on a smaller resistor is an error of the channel: the offset is then a free parameter, like the
origin of the displacement.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.diagnose import thresholds
from piezoharvest.identify.noise.noise_model import initial_noise
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.record import Record


def voltage_is_off(campaign: Campaign) -> bool:
    """True if mean voltages on several resistors cannot come from a current into the node."""
    capacitance = campaign.transducer.capacitance
    means = [
        (record.shunt.resistance, *_mean(record["voltage"]))
        for record in campaign.of_role("fit")
        if isinstance(record, Record)
        and isinstance(record.shunt, Resistor)
        and record.drive != "voltage"
        and "voltage" in record.signals
        and record.duration > thresholds.MIN_TIME_CONSTANTS * record.shunt.resistance * capacitance
    ]
    return any(
        small < large
        and abs(one) > max(thresholds.MIN_OFFSET_ERRORS * error, thresholds.MIN_OFFSET_NOISE_RATIO * noise)
        and abs(one) > abs(other) + thresholds.MIN_OFFSET_ERRORS * (error + off)
        for (small, one, error, noise), (large, other, off, _) in permutations(means, 2)
    )


def _mean(values: np.ndarray) -> tuple[float, float, float]:
    """Mean of a channel, its standard error, and the noise of a sample.

    Windows of two kinds weight the varying part differently: their difference is the uncertainty of the mean.
    """
    (mean, error), (other, _) = (_windowed(values, window(len(values))) for window in (np.blackman, np.hanning))
    noise = initial_noise(values)
    return mean, float(np.hypot(noise * error, mean - other)), noise


def _windowed(values: np.ndarray, window: np.ndarray) -> tuple[float, float]:
    """Weighted mean, and its standard error in units of that of a sample."""
    return float(values @ window / window.sum()), float(np.sqrt(window @ window) / window.sum())
