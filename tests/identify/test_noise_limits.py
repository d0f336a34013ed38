"""The noise of a channel is what its own record shows, whatever a wrong model makes of that of the drive."""

import numpy as np
import pytest

from piezoharvest.identify.noise.noise_model import Noise, estimate, noise_upper_bound

SIGMA = 0.01


def slow(count=4000):
    return 3.0 * np.sin(2 * np.pi * 7.3 * np.arange(count) / count)


def test_the_highest_frequencies_bound_the_noise():
    noisy = slow() + SIGMA * np.random.default_rng(0).standard_normal(4000)
    assert SIGMA < noise_upper_bound(noisy) < 1.5 * SIGMA
    assert noise_upper_bound(slow()) < 1e-4 * SIGMA  # a drive that is known exactly


@pytest.mark.parametrize("drive", [0.0, 0.5])
def test_what_is_out_of_its_limits_stays_there_for_the_others(drive):
    """Residuals that are as coloured as the noise of a drive would be: it has none, so that they are the channel's."""
    rng, gain = np.random.default_rng(1), np.full((5001, 1), 2.0 + 0j)
    residual = np.sqrt(0.5 * 10.0) * (rng.standard_normal((5001, 1)) + 1j * rng.standard_normal((5001, 1)))
    limits = {"force": (0.0, max(drive, 1e-6)), "voltage": (0.0, np.inf)}
    found = estimate([(("voltage",), "force", residual, gain)], {}, Noise({"voltage": 3.0, "force": 1.0}), limits).sigma
    assert found["force"] <= max(drive, 1e-6) * (1.0 + 1e-9)
    assert found["voltage"] ** 2 + (2.0 * found["force"]) ** 2 == pytest.approx(10.0, rel=0.1)


@pytest.mark.parametrize("seed", range(6))
def test_a_drive_s_noise_that_the_residuals_do_not_show_is_that_of_its_own_record(seed):
    """Far above a resonance nothing of it is in the residuals: the most likely value would be at one of the limits."""
    rng, lines = np.random.default_rng(seed), 2001
    frequency = np.linspace(0.0, 1.0, lines)[:, None]
    gain = 1e-2 / (1e-3 - frequency**2 + 1e-4j * frequency)  # a resonance at 0.03 of the band
    residual = np.sqrt(0.5) * (rng.standard_normal((lines, 1)) + 1j * rng.standard_normal((lines, 1)))
    spectra, start = [(("voltage",), "force", residual, gain)], Noise({"voltage": 2.0, "force": 1.0})
    for highest in (1.3, 0.5):
        found = estimate(spectra, {}, start, {"force": (0.0, highest), "voltage": (0.0, np.inf)}).sigma
        assert found["force"] == pytest.approx(min(highest, 1.0))
        assert found["voltage"] == pytest.approx(1.0, rel=0.1)
