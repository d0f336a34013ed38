"""The part of a measured drive that stands out of its noise."""

import numpy as np
import pytest

from piezoharvest.identify.denoise import denoised

TIME = np.arange(10_000) / 1000.0


@pytest.mark.parametrize("phase", [0.0, 1.0, np.pi / 2])
@pytest.mark.parametrize(
    ("frequency", "size", "sigma"), [(13.73, 1250.0, 0.16), (8.0, 1250.0, 0.16), (3.0, 250.0, 0.6)]
)
def test_a_drive_that_is_in_motion_at_its_ends_is_followed_there(phase, frequency, size, sigma):
    true = size * np.sin(2 * np.pi * frequency * TIME + phase)
    off = denoised(true + sigma * np.random.default_rng(4).standard_normal(len(TIME)), sigma) - true
    assert np.abs(np.concatenate([off[:10], off[-10:]])).max() < 4.0 * sigma
    assert off.std() < sigma
