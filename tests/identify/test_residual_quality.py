"""Residuals against noise alone: what the noise of a measured drive leaves in records of a lightly damped specimen."""

import numpy as np
import pytest
from scipy.signal import StateSpace, chirp, lsim

from piezoharvest import Campaign, identify

DEVICE = {"mass": 0.01, "damping": 0.0063, "stiffness": 986.96, "coupling": 1e-3, "capacitance": 40e-9}
LOAD, FORCE, NOISE = 80e3, 0.02, 4e-4
DURATION = 2.0  # s; the noise of the drive takes as long to build up


def model():
    """The device with its load, from the force to displacement and voltage."""
    m, b, k, coupling, c = DEVICE.values()
    a = [[0, 1, 0], [-k / m, -b / m, coupling / m], [0, -coupling / c, -1 / (LOAD * c)]]
    return StateSpace(a, [[0], [1 / m], [0]], [[1, 0, 0], [0, 0, 1]], np.zeros((2, 1)))


@pytest.mark.parametrize("rate", [2000.0, 20000.0])
def test_noise_alone_is_what_the_noise_of_the_drive_makes_in_the_time_of_the_record(rate):
    """From the beginning of the record on, and in a band that is narrow beside the sample rate.

    With steps of 5 Hz, and as much noise at the beginning as later, residuals of a right model were 1.2 times the noise
    at the one rate, which was warned of, and 0.9 times at the other.
    """
    rng, time = np.random.default_rng(3), np.arange(round(rate * DURATION)) / rate
    force = FORCE * chirp(time, 45.0, DURATION, 55.0)
    responses = lsim(model(), force, time)[1]
    own = 1e-3 * responses.std(axis=0)
    records = []
    for _ in range(4):
        measured = responses + own * rng.standard_normal(responses.shape)
        columns = dict(zip(("displacement_m", "voltage_V"), measured.T, strict=True))
        columns |= {"time_s": time, "force_N": force + NOISE * rng.standard_normal(len(time))}
        records.append({"data": columns, "load_resistance": LOAD})
    found = identify(Campaign.from_arrays(DEVICE, records))
    pulse = lsim(model(), NOISE * (np.arange(len(time)) == 1), time)[1]
    expected = np.sqrt(np.mean(np.cumsum(pulse**2, axis=0), axis=0) + own**2)
    for channel, wanted in zip(("displacement", "voltage"), expected, strict=True):
        assert found.fit.noise[channel] == pytest.approx(wanted, rel=0.07)
