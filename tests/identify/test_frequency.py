"""Frequency responses of multisines and their modes: synthetic systems that are known, and the measured mirror."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import control
import numpy as np
import pytest

from piezoharvest.identify.frequency.modal_fit import FrequencyError, Modes, fit_modes, multisine_response, select_modes
from piezoharvest.identify.frequency.vector_fitting import vector_fit

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "fast_steering_mirror"
RATE, SAMPLES = 1000.0, 1024
LINES = np.arange(1, 400)


def system(modes=3, outputs=2, inputs=2, seed=0, delay=4e-4):
    rng = np.random.default_rng(seed)
    size = 2 * np.pi * np.linspace(60.0, 330.0, modes)
    damping = rng.uniform(0.01, 0.04, modes)
    b = rng.standard_normal((modes, inputs))
    return Modes(
        poles=size * (-damping + 1j * np.sqrt(1 - damping**2)),
        outputs=-1j * size[:, None] * rng.uniform(0.3, 1.0, (modes, outputs)),
        inputs=b / np.linalg.norm(b, axis=1, keepdims=True) + 0j, direct=0.1 * rng.standard_normal((outputs, inputs)),
        delay=delay,
    )  # fmt: skip


def multisines(realisations, seed=1, lines=LINES, inputs=2):
    """Random phases, rms 1, one period."""
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, (len(lines), inputs, realisations))
    spectra = np.zeros((SAMPLES // 2 + 1, inputs, realisations), complex)
    spectra[lines] = np.exp(1j * phases) * SAMPLES / np.sqrt(2 * len(lines))
    return np.fft.irfft(spectra, axis=0)


def measured(modes, realisations=4, periods=3, noise=0.0, cubic=0.0, seed=1, lines=LINES):
    """Records of a system with a cubic nonlinearity at its input, and with white noise on its output."""
    drive = multisines(realisations, seed, lines)
    clean = modes.periodic(drive + cubic * drive**3, RATE)
    rng = np.random.default_rng(seed + 100)
    shape = (*clean.shape, periods)
    return np.repeat(drive[..., None], periods, -1), clean[..., None] + noise * rng.standard_normal(shape)


class TestMultisine:
    def test_is_exact_without_noise(self):
        found = multisine_response(*measured(system()), RATE)
        np.testing.assert_allclose(found.frequency, LINES * RATE / SAMPLES)
        np.testing.assert_allclose(found.response, system().response(found.frequency), atol=1e-9)
        assert found.noise.max() < 1e-9 and found.total.max() < 1e-9

    def test_noise_level_and_standard_deviation(self):
        """White noise of 0.05: its level at a line, and the scatter of the response in units of its own sigma."""
        found = multisine_response(*measured(system(), noise=0.05), RATE)
        assert np.sqrt((found.noise_level**2).mean()) == pytest.approx(0.05 * np.sqrt(2 / SAMPLES), rel=0.05)
        score = np.abs(found.response - system().response(found.frequency)) / found.noise
        assert np.sqrt(np.mean(score**2)) == pytest.approx(1.0, abs=0.1)
        assert np.median(found.total / found.noise) == pytest.approx(1.0, abs=0.15)
        assert np.all(np.abs(found.transient - 1) < 0.4)

    def test_distortion_is_told_from_noise(self):
        linear = multisine_response(*measured(system(), noise=0.01, realisations=8), RATE)
        cubic = multisine_response(*measured(system(), noise=0.01, realisations=8, cubic=0.05), RATE)
        np.testing.assert_allclose(cubic.noise_level.mean(), linear.noise_level.mean(), rtol=0.05)
        assert cubic.distortion_level.mean() > 3 * linear.distortion_level.mean()
        assert np.median(cubic.total / cubic.noise) > 3
        # Three times the mean square is what a cubic adds to the gain of a Gaussian drive.
        ratio = np.abs(cubic.response).mean() / np.abs(linear.response).mean()
        assert ratio == pytest.approx(1 + 3 * 0.05, abs=0.02)

    def test_distortion_from_lines_that_are_not_excited(self):
        """As many realisations as inputs: the lines between the odd ones tell it instead, and agree."""
        odd = LINES[::2]
        system_ = system()
        by_lines = multisine_response(*measured(system_, 2, noise=0.01, cubic=0.05, lines=odd), RATE)
        assert np.all(np.isnan(by_lines.total))
        even = multisine_response(*measured(system_, 2, noise=0.01, lines=odd), RATE)
        # A cubic of odd lines falls on odd lines alone: what even lines show is noise.
        assert by_lines.distortion_level.mean() < 2 * even.distortion_level.mean() + 1e-4
        sparse = np.setdiff1d(LINES, LINES[::7])
        seen = multisine_response(*measured(system_, 2, noise=0.01, cubic=0.05, lines=sparse), RATE)
        robust = multisine_response(*measured(system_, 12, noise=0.01, cubic=0.05, lines=sparse), RATE)
        ratio = np.sqrt((seen.distortion_level**2).mean() / (robust.distortion_level**2).mean())
        assert ratio == pytest.approx(1.0, abs=0.3)

    def test_transient_is_seen(self):
        drive, output = measured(system(), noise=0.01)
        decay = np.exp(-np.arange(SAMPLES) / 100)[:, None, None]
        output[..., 0] += 0.2 * decay
        assert np.all(multisine_response(drive, output, RATE).transient > 3)
        assert np.all(multisine_response(drive, output, RATE, skip=1).transient < 1.5)

    def test_bad_input(self):
        drive, output = measured(system())
        with pytest.raises(FrequencyError, match="found 1 realisation of 3 periods for 2 inputs"):
            multisine_response(drive[:, :, :1], output[:, :, :1], RATE)
        with pytest.raises(FrequencyError, match=r"must be \(samples, channels, realisations, periods\)"):
            multisine_response(drive[:-1], output, RATE)
        output[3] = np.nan
        with pytest.raises(FrequencyError, match="outputs: found 24 NaN or infinite values"):
            multisine_response(drive, output, RATE)


class TestModes:
    def test_response_is_that_of_the_state_space(self):
        modes = system(delay=0.0)
        frequency = np.array([10.0, 60.0, 200.0])
        by_control = control.ss(*modes.statespace())(2j * np.pi * frequency)
        np.testing.assert_allclose(modes.response(frequency), np.moveaxis(by_control, -1, 0), rtol=1e-10)
        np.testing.assert_allclose(np.sort(np.abs(np.linalg.eigvals(modes.statespace()[0])))[::2], np.abs(modes.poles))

    def test_vector_fitting_is_exact(self):
        modes = system(delay=0.0)
        s = 2j * np.pi * np.linspace(10, 400, 300) / 2500
        response = modes.response(np.linspace(10, 400, 300)).reshape(300, -1)
        start = np.linspace(0.1, 1.0, 3)
        poles = vector_fit(s, response, -0.01 * start + 1j * start).poles
        np.testing.assert_allclose(np.sort_complex(2500 * poles), np.sort_complex(modes.poles), rtol=1e-7)

    def test_fit_is_exact_without_noise(self):
        """Poles, direct term and delay of the system itself."""
        modes = system()
        frequency = LINES * RATE / SAMPLES
        found = fit_modes(frequency, modes.response(frequency), 3)
        assert found.error < 1e-4
        np.testing.assert_allclose(found.modes.poles, modes.poles, rtol=1e-4)
        assert found.modes.delay == pytest.approx(modes.delay, rel=1e-2)
        np.testing.assert_allclose(found.modes.direct, modes.direct, atol=2e-3)

    @pytest.mark.parametrize("seed", [1, 2, 3])
    def test_fit_within_standard_errors(self, seed):
        modes = system(seed=seed)
        found = multisine_response(*measured(modes, noise=0.3, seed=seed), RATE)
        fit = fit_modes(found.frequency, found.response, 3)
        scores = [
            (fit.modes.frequencies - modes.frequencies) / fit.frequencies_std,
            (fit.modes.dampings - modes.dampings) / fit.dampings_std,
        ]
        assert np.all(np.abs(scores) < 3.5), scores
        assert np.all(fit.frequencies_std < 0.01 * modes.frequencies)

    def test_every_pole_is_stable(self):
        """Even where the response is that of an unstable system."""
        unstable = system()
        frequency = LINES * RATE / SAMPLES
        wrong = replace(unstable, poles=-unstable.poles.conj(), delay=0.0)
        assert np.all(fit_modes(frequency, wrong.response(frequency), 3).modes.poles.real < 0)

    def test_number_of_modes(self):
        """That of the system, told by a second, independent response."""
        first, second = (multisine_response(*measured(system(), noise=0.05, seed=seed), RATE) for seed in (1, 2))
        number, errors = select_modes(first.frequency, first.response, second.response, (1, 2, 3, 4, 5))
        assert number == 3
        assert errors[2] > 2 * errors[3]

    def test_bad_input(self):
        frequency, response = LINES[:20] * 1.0, np.ones((20, 1, 1), complex)
        with pytest.raises(FrequencyError, match="found 19 frequencies and a response of shape"):
            fit_modes(frequency[1:], response, 1)
        with pytest.raises(FrequencyError, match="found 9 modes, allowed are 1 or more"):
            fit_modes(frequency, response, 9)
        with pytest.raises(FrequencyError, match="frequencies that do not increase"):
            fit_modes(frequency[::-1], response, 1)


@lru_cache
def records(level, part):
    return tuple(np.load(DATA / f"{name}_{level}mV_{part}.npy") for name in "uy")


@pytest.fixture(scope="module")
def fits():
    """28 states each, as the published ones have; to every fifth line, which is enough for the test errors."""
    found = {}
    for level in (200, 100, 300):
        response = multisine_response(*records(level, "train"), 6400.0)
        start = found[200].modes if found else 14
        found[level] = fit_modes(response.frequency[::5], response.response[::5], start)
    return found


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA.name} beside the project")
class TestMirror:
    @pytest.mark.parametrize(
        ("level", "published"), [pytest.param(100, 8.38, marks=pytest.mark.slow), (200, 7.95), (300, 5.63)]
    )
    def test_linear_models_are_as_good_as_published(self, fits, level, published):
        drive, output = records(level, "test")
        error = output - fits[level].modes.periodic(drive, 6400.0)
        relative = 100 * np.sqrt((error**2).mean(axis=0)) / output.std(axis=0)
        assert relative.mean() < published

    def test_first_resonance_falls_with_the_level(self, fits):
        first = [fits[level].modes.frequencies[0] for level in (100, 200, 300)]
        std = max(fits[level].frequencies_std[0] for level in (100, 200, 300))
        assert np.all(np.diff(first) < -5 * std)

    def test_noise_is_that_of_the_notes(self):
        """2.5e-8 m at 300 mV, 4.4e-8 m at 100 mV, mean over the outputs."""
        for level, noted in ((300, 2.5e-8), (100, 4.4e-8)):
            found = multisine_response(*records(level, "train"), 6400.0)
            assert np.sqrt((found.noise_level**2).sum(axis=0)).mean() == pytest.approx(noted, rel=0.1)
