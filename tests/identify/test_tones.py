"""Sines in white noise: as near as least squares come."""

import numpy as np
import pytest

from piezoharvest.identify.noise.tones import MAX_TONES, tones

COUNT, SIGMA = 10_000, 1.0
TIME = np.arange(COUNT)


def drawn(rng, count):
    """Angles at least two lines apart, sizes and phases."""
    angles = (
        2 * np.pi / COUNT * (rng.choice(np.arange(5, 500, 2), count, replace=False) + rng.uniform(-0.3, 0.3, count))
    )
    return np.sort(angles), rng.uniform(2.0, 200.0, count), rng.uniform(0.0, 2 * np.pi, count)


@pytest.mark.parametrize("count", [1, 2, 12, MAX_TONES])
def test_frequencies_are_found_to_their_bound(count):
    """Standard deviation of a frequency: sqrt(24 / n^3) sigma / size (Rife & Boorstyn, IEEE T-IT 20(5), 1974)."""
    rng = np.random.default_rng(count)
    angles, sizes, phases = drawn(rng, count)
    values = 7.0 + np.cos(TIME[:, None] * angles + phases) @ sizes + SIGMA * rng.standard_normal(COUNT)
    found = tones(values)
    assert found is not None
    assert len(found.angles) == count
    order = np.argsort(found.angles)
    # Neighbours two lines away share a little of what they tell.
    assert np.abs((found.angles[order] - angles) * sizes / np.sqrt(24.0 / COUNT**3)).max() < 6.0
    assert np.hypot(*np.split(found.sizes[1:], 2))[order] == pytest.approx(sizes, abs=6.0 * SIGMA * np.sqrt(2 / COUNT))
    left = values - found.since(0)
    assert left @ left == pytest.approx(SIGMA**2 * (COUNT - 1 - 3 * count), abs=5.0 * np.sqrt(2 * COUNT))


def test_they_are_known_before_the_samples_too():
    true = 3.0 + 50.0 * np.sin(0.0213 * TIME + 1.0)
    found = tones(true[2000:] + 1e-3 * np.random.default_rng(2).standard_normal(COUNT - 2000))
    assert found is not None
    np.testing.assert_allclose(found.since(2000), true, atol=3e-4)


def test_noise_and_more_than_so_many_are_none():
    rng = np.random.default_rng(3)
    assert tones(rng.standard_normal(COUNT)) is None
    angles, sizes, phases = drawn(rng, MAX_TONES + 5)
    assert tones(np.cos(TIME[:, None] * angles + phases) @ (sizes + 20.0)) is None
