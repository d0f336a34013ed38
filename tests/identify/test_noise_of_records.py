"""What the records themselves show of their noise, without a model: its level in each, its colour, and its growth."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, resample_poly

from piezoharvest.identify.noise.noise_levels import levels_of, noise_floor, relative_levels
from piezoharvest.identify.noise.proportional_noise import relative_variance
from piezoharvest.records.record import Signal

COUNT = 8000


class Measured(SimpleNamespace):
    """A record with open electrodes that a force drives, as far as estimates of noise read it."""

    def __getitem__(self, name):
        return self.signals[name].values

    def __len__(self):
        return len(self["force"])


def record(drive, **responses):
    signals = {name: Signal(values, None, "", "", 1) for name, values in {"force": drive, **responses}.items()}
    return Measured(signals=signals, drive="force", shunt=None, name=str(id(signals)))


def chirp(amplitude=1.0, count=COUNT):
    time = np.arange(count) / count
    return amplitude * np.sin(2 * np.pi * (50.0 * time + 100.0 * time**2))


@pytest.mark.parametrize("seed", range(5))
def test_records_with_the_same_noise_have_the_same_level(seed):
    rng = np.random.default_rng(seed)
    each = [record(chirp(), voltage=chirp(a) + 0.01 * rng.standard_normal(COUNT)) for a in (1.0, 2.0, 5.0, 10.0)]
    levels = [level["voltage"] for level in levels_of(each).values()]
    assert np.ptp(levels) < 0.03  # one estimate has a standard error of 0.8 %


@pytest.mark.parametrize("seed", range(5))
def test_noise_that_goes_with_the_amplitude_has_its_own_level_in_each_record(seed):
    rng, amplitudes = np.random.default_rng(seed), np.array([1.0, 2.0, 5.0, 10.0])
    each = [record(chirp(), voltage=chirp(a) + 0.01 * a * rng.standard_normal(COUNT)) for a in amplitudes]
    levels = np.array([level["voltage"] for level in levels_of(each).values()])
    expected = amplitudes / np.exp(np.mean(np.log(amplitudes)))
    np.testing.assert_allclose(levels, expected, rtol=0.04)  # five standard errors of an estimate


def test_levels_are_drawn_to_each_other_as_far_as_the_estimates_scatter():
    """By the formula of DerSimonian and Laird, by hand: Q = 200 (ln 1.2)^2 / 2 for two records with 100 lines each."""
    shown = (1.2, 100), (1.0, 100), None
    q = 200.0 * np.log(1.2) ** 2 / 2.0
    between = (q - 1.0) / (400.0 - 2 * 200.0**2 / 400.0)
    drawn = between / (between + 1.0 / 200.0)
    off = 0.5 * drawn * np.log(1.2)
    assert relative_levels(shown) == pytest.approx([np.exp(off), np.exp(-off), 1.0])
    assert relative_levels([(1.01, 100), (1.0, 100)]) == [1.0, 1.0]
    assert relative_levels([(3.0, 100), None]) == [1.0, 1.0]


def attenuated(rng, kind):
    if kind == "decimated":
        return resample_poly(rng.standard_normal(8 * COUNT), 1, 8) * np.sqrt(8.0)
    return lfilter(*butter(4, 0.4), rng.standard_normal(COUNT))


@pytest.mark.parametrize("kind", ["decimated", "low-pass"])
@pytest.mark.parametrize("seed", range(4))
def test_noise_behind_a_filter_against_aliasing_is_that_of_its_pass_band(kind, seed):
    rng = np.random.default_rng(seed)
    noisy = record(chirp(), voltage=chirp() + 0.01 * attenuated(rng, kind))
    assert 0.0095 < noise_floor(noisy, "voltage")[0] < 0.0112  # rather too much than too little


@pytest.mark.parametrize("seed", range(4))
def test_a_response_to_a_random_drive_is_not_taken_for_filtered_noise(seed):
    """Flat to six tenths of the band, then without anything: only its coherence with the drive shows that it is one."""
    rng = np.random.default_rng(seed)
    drive = lfilter(*butter(8, 0.6), rng.standard_normal(COUNT))
    assert noise_floor(record(drive, voltage=2.0 * drive + 1e-3 * rng.standard_normal(COUNT)), "voltage") is None


@pytest.mark.parametrize("seed", range(4))
def test_noise_that_is_a_share_of_the_reading_is_seen_as_such(seed):
    rng = np.random.default_rng(seed)
    x, w = chirp(), rng.standard_normal((2, COUNT))
    found = relative_variance(record(x, voltage=x + 3e-3 * np.abs(x) * w[0] + 1e-3 * w[1]), "voltage")
    expected = 9e-6 * x**2 + 1e-6
    np.testing.assert_allclose(found, expected / expected.mean(), rtol=0.25)
    bare = relative_variance(record(x, voltage=x + 3e-3 * np.abs(x) * w[0]), "voltage")
    assert 0.05 < bare.min() < 0.11  # what is near zero counts ten times at most


@pytest.mark.parametrize("seed", range(20))
def test_constant_noise_is_not_taken_for_one_that_grows(seed):
    rng = np.random.default_rng(seed)
    assert relative_variance(record(chirp(), voltage=chirp() + 3e-3 * rng.standard_normal(COUNT)), "voltage") is None
    assert relative_variance(record(chirp(), voltage=chirp()), "voltage") is None  # none at all
