"""Whether the voltage channel is off by a constant, as the zero of an oscilloscope is.

Nothing in a specimen holds a mean voltage on a resistor for long but a current into the node, which holds the more the
larger the resistance is. A mean that is larger on a smaller resistor belongs to the channel; it says nothing about the
specimen, and is free then, as the origin of the displacement is.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.identify.noise.noise_model import first_guess
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.record import Record

SURE = 5.0  # standard errors
PLAIN = 1.0  # times the noise of a sample: what is less may be a slow effect of the specimen
SETTLED = 10.0  # time constants of load and capacitance that a record lasts, so that its mean is that of a steady state


def voltage_is_off(campaign: Campaign) -> bool:
    """Whether mean voltages on several resistors are what no current into the node makes them."""
    capacitance = campaign.transducer.capacitance
    means = [
        (record.shunt.resistance, *_mean(record["voltage"]))
        for record in campaign.of_role("fit")
        if isinstance(record, Record)
        and isinstance(record.shunt, Resistor)
        and record.drive != "voltage"
        and "voltage" in record.signals
        and record.duration > SETTLED * record.shunt.resistance * capacitance
    ]
    return any(
        small < large and abs(one) > max(SURE * error, PLAIN * noise) and abs(one) > abs(other) + SURE * (error + off)
        for (small, one, error, noise), (large, other, off, _) in permutations(means, 2)
    )


def _mean(values: np.ndarray) -> tuple[float, float, float]:
    """Mean of a channel, its standard error, and the noise of a sample.

    Windows of two kinds let through different parts of what is not constant: by so much the mean is uncertain.
    """
    (mean, error), (other, _) = (_windowed(values, window(len(values))) for window in (np.blackman, np.hanning))
    noise = first_guess(values)
    return mean, float(np.hypot(noise * error, mean - other)), noise


def _windowed(values: np.ndarray, window: np.ndarray) -> tuple[float, float]:
    """Weighted mean, and its standard error in units of that of a sample."""
    return float(values @ window / window.sum()), float(np.sqrt(window @ window) / window.sum())
