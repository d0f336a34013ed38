"""The part of a measured drive that stands out of its noise."""

import numpy as np
import pytest
from scipy.fft import dct

from piezoharvest.identify.noise.drive_denoising import MIN_LEVEL, _averages, denoised

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


def noise(sigma, seed=4):
    return sigma * np.random.default_rng(seed).standard_normal(len(TIME))


@pytest.mark.parametrize("seed", [4, 10, 33, 108, 125, 126])
def test_a_value_that_is_held_is_held_up_to_the_jump_that_ends_it(seed):
    """Of all seeds but the first some average is off by more than four of its standard errors, as of one in twenty."""
    true = np.where(TIME < 3.0, 100.0, np.where(TIME < 7.0, 900.0, 300.0))
    off = denoised(true + noise(5.0, seed), 5.0) - true
    assert np.abs(off).max() < 4.0 * 5.0 / np.sqrt(1000)  # the sample before a jump and the one after it, too


def test_averages_of_a_held_value_are_known_to_their_standard_errors_even_in_the_widest_window():
    count = 40_000  # more than there are samples in it
    levels, averages = _averages(100.0 + 5.0 * np.random.default_rng(4).standard_normal(count), 5.0)
    averaged = levels >= MIN_LEVEL
    assert averaged.mean() > 0.95
    errors = 5.0 / np.sqrt(2.0 ** (levels[averaged] + 1) - 1)
    assert np.abs((averages[averaged] - 100.0) / errors).max() < 5.0  # the largest of 40,000 that are drawn is 4.3


def test_a_drive_that_goes_from_one_held_value_to_another_does_not_seem_to_go_beyond():
    """Operators would remember that; how it went between them stays what it was measured to be."""
    true = np.interp(TIME, [3.0, 3.05, 7.0, 7.05], [100.0, 900.0, 900.0, 100.0])
    found = denoised(true + noise(2.0), 2.0)
    assert found.min() == found[:2000].max()
    assert found.max() == found[4000:6000].min() == pytest.approx(900.0, abs=0.2)
    assert np.abs(found - true)[3000:3050].max() < 6.0 * 2.0


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("begin", [0.0, 1.2345])
def test_where_a_ramp_begins_and_ends_it_is_not_rounded_off(begin, seed):
    """No line of a corner's spectrum stands out of the noise, but all together are six times as large as it there.

    A reading that comes to the end of its range there is not as linear as to be told by the rest.
    """
    true = np.interp(TIME, [begin, begin + 0.05, begin + 5.0, begin + 5.05], [100.0, 1000.0, 1000.0, 100.0])
    found = denoised(true + noise(0.55, seed), 0.55)
    corners = np.add.outer(1000.0 * (begin + np.array([0.0, 0.05, 5.0, 5.05])), np.arange(-5, 6)).astype(int)
    assert np.abs(found - true)[corners.clip(min=0)].max() < 2.5 * 0.55


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("taken", [0.02, 0.045, 0.12])
def test_a_ramp_without_corners_is_followed(taken, seed):
    """Bends may make noise of the higher lines and leave what is none at some samples: then they are no corners."""
    turn = np.clip((TIME - 0.4567) / taken, 0.0, 1.0) - np.clip((TIME - 9.2) / taken, 0.0, 1.0)
    true = 1100.0 * (turn - np.sin(2 * np.pi * turn) / (2 * np.pi))
    off = denoised(true + noise(0.44, seed), 0.44) - true
    assert np.abs(off).max() < 4.0 * 0.44
    assert off.std() < 0.3 * 0.44


def test_a_drive_that_does_go_beyond_is_followed():
    true = np.interp(TIME, [3.0, 3.05, 3.2, 7.0, 7.05], [100.0, 960.0, 900.0, 900.0, 100.0])
    found = denoised(true + noise(2.0), 2.0)
    assert found.max() == pytest.approx(960.0, abs=8.0)


def sines(time, tones):
    return sum(size * np.sin(2 * np.pi * frequency * time + phase) for frequency, size, phase in tones)


@pytest.mark.slow
def test_tones_closer_than_a_record_tells_apart_are_not_taken_for_a_slow_drift():
    """Fewer sines than there are follow them but for what looks like a drift: an amplitude of a fifth of the noise."""
    close = [(0.4, 80.5), (0.55, 67.2), (0.7, 49.8), (0.75, 53.8), (0.8, 42.5), (0.85, 64.1), (2.1, 31.2), (3.9, 23.1)]
    close += [(4.85, 21.2), (5.15, 21.2), (5.85, 46.1), (17.55, 29.6)]
    phases = [5.17, 3.36, 4.47, 1.45, 3.71, 3.09, 4.77, 2.16, 3.96, 0.36, 4.49, 0.15]
    tones = [(*tone, phase) for tone, phase in zip(close, phases, strict=True)]
    grown = np.clip(TIME / 0.417, 0.0, 1.0)
    true = grown**2 * (3.0 - 2.0 * grown) * (379.0 + sines(TIME, tones))
    for seed in range(6):
        off = denoised(true + noise(0.8, seed), 0.8) - true
        assert np.abs(dct(off, norm="ortho"))[:12].max() < 4.5 * 0.8


PLAIN = [(4.0, 450.0, 0.0)]
MANY = [(1.3, 60.0, 0.4), (3.1, 80.0, 2.0), (7.7, 50.0, 1.0), (12.9, 70.0, 4.0), (23.3, 40.0, 5.0), (37.1, 30.0, 3.0)]


@pytest.mark.parametrize("tones", [PLAIN, MANY], ids=["sine", "multisine"])
def test_a_drive_of_sines_has_the_noise_of_their_sizes_alone(tones):
    """That is sigma sqrt(p / n) for p numbers from n samples, wherever their frequencies are between the lines."""
    true = 550.0 + sines(TIME, tones)
    off = denoised(true + noise(5.0), 5.0) - true
    expected = 5.0 * np.sqrt((1 + 3 * len(tones)) / len(TIME))
    assert np.sqrt(np.mean(off**2)) < 1.5 * expected
    assert np.abs(off).max() < 6.0 * expected  # as small at the ends


def test_sines_that_set_off_from_a_rest_are_that_rest_before():
    since = np.maximum(TIME - 1.2, 0.0)
    true = 550.0 + sines(since, PLAIN)
    found = denoised(true + noise(5.0), 5.0)
    assert np.ptp(found[:1150]) == 0.0
    assert np.abs(found - true)[1300:].max() < 0.7
    assert np.abs(found - true).max() < 6.0 * 5.0


def test_sines_that_grow_are_followed_while_they_do_and_are_sines_then():
    true = 550.0 + np.minimum(TIME / 0.5, 1.0) * sines(TIME, MANY)
    off = denoised(true + noise(5.0), 5.0) - true
    assert np.sqrt(np.mean(off[600:1200] ** 2)) < 0.5  # a tenth of a second after they have grown
    assert np.sqrt(np.mean(off[1200:] ** 2)) < 0.5
    assert np.abs(off).max() < 4.0 * 5.0


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_tones_of_half_a_line_apart_are_told_apart(seed):
    """Their frequencies take more of Newton's steps than those of the others; until then some line is left."""
    close = [(1.45, 102.8, 3.58), (5.7, 68.9, 5.31), (0.6, 229.8, 2.98), (10.15, 33.5, 5.71)]
    close += [(0.75, 156.4, 5.57), (3.15, 77.8, 6.28), (12.55, 40.6, 2.53)]
    close += [(6.05, 34.3, 6.07), (5.75, 42.7, 4.09), (2.9, 59.5, 5.48)]
    grown = np.clip(TIME / 0.68, 0.0, 1.0)
    true = grown**3 * (10.0 - 15.0 * grown + 6.0 * grown**2) * (597.0 + sines(TIME, close))
    off = denoised(true + noise(0.6, seed), 0.6) - true
    assert off[1000:].std() < 0.12 * 0.6


@pytest.mark.parametrize("beside", [3.0, 20.0])
def test_what_is_no_sine_is_not_taken_for_some(beside):
    """A triangle has harmonics without end; those that stand out of the noise are not all there are."""
    true = 550.0 + 450.0 * np.abs(2.0 * np.mod(4.0 * TIME, 1.0) - 1.0) + beside * np.exp(-TIME)
    off = denoised(true + noise(0.05), 0.05) - true
    assert np.sqrt(np.mean(off**2)) < 0.1
