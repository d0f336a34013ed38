"""Operators from loops: recovery from synthetic records, exact inverses, and the measured stack."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.signal import lfilter

from piezoharvest.description.hysteresis import play, stop
from piezoharvest.identify.hysteresis.loop_fit import Loop, LoopError
from piezoharvest.identify.hysteresis.loop_model import convex_fit
from piezoharvest.identify.hysteresis.loops import identify_loop
from piezoharvest.identify.hysteresis.play_operators import initial_states, plays, turning_points
from piezoharvest.identify.noise.coloured_noise import covariance, effective_samples
from piezoharvest.identify.noise.differences import median_variance

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "picma_stack_hysteresis"
R, W = np.array([0.1, 0.35, 0.8]), np.array([1.0, 0.6, 0.9])
TIME = np.arange(1500) / 100.0
SIGNAL = 0.3 + np.linspace(0.5, 1.5, len(TIME)) * np.sin(2 * np.pi * 0.5 * TIME)
KINDS = ["play", "stop"]


def loop(kind, slope=2.0):
    return Loop(kind=kind, offset=0.4, slope=slope, thresholds=R, weights=W)


def coloured(rng, count, rho=0.8, sigma=0.02):
    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], sigma * rng.standard_normal(count + 200))[200:]


floats = st.floats(-3, 3, allow_nan=False)
signals = st.lists(floats, min_size=2, max_size=40).map(np.array)


class TestOperators:
    @given(signals, st.floats(0.01, 4), floats)
    def test_as_the_recursion_has_it(self, signal, threshold, state):
        found = plays(signal, np.array([threshold]), state).outputs[:, 0]
        np.testing.assert_allclose(found, play(signal, threshold, state), atol=1e-12)

    @given(signals, st.floats(0.05, 3), floats)
    def test_derivatives(self, signal, threshold, state):
        """By differences, where no corner is between."""
        found, step = plays(signal, np.array([threshold]), state), 1e-7
        above, below = (plays(signal, np.array([threshold + d]), state).slopes for d in (step, -step))
        outputs = [plays(signal, np.array([threshold + d]), state).outputs for d in (step, -step)]
        same = (above == found.slopes) & (below == found.slopes)
        difference = (outputs[0] - outputs[1]) / (2 * step)
        np.testing.assert_allclose(difference[same], found.slopes[same], atol=1e-6)

    def test_turning_points(self):
        assert turning_points(np.array([0.0, 1, 1, 2, 2, 0, 0, 0, 1])).tolist() == [0, 4, 7, 8]

    def test_initial_states(self):
        """Neighbours differ by no more than their thresholds, and the derivatives are those of the states."""
        turns = np.array([0.5, -1.0, 0.25])
        states, by_turns, by_thresholds = initial_states(0.7, R, turns)
        assert np.all(np.abs(np.diff(states)) <= np.diff(R) + 1e-15)
        for matrix, base, of in ((by_turns, turns, lambda x: (R, x)), (by_thresholds, R, lambda x: (x, turns))):
            for n, step in enumerate(1e-6 * np.eye(3)):
                moved = [initial_states(0.7, *of(base + sign * step))[0] for sign in (1, -1)]
                np.testing.assert_allclose((moved[0] - moved[1]) / 2e-6, matrix[:, n], atol=1e-8)


class TestInverse:
    @pytest.mark.parametrize("kind", KINDS)
    def test_is_exact_from_any_state(self, kind):
        for states in (0.0, np.array([0.25, 0.0, -0.3]), np.array([0.2, 0.4, 0.8])):
            output = loop(kind).predict(SIGNAL, states)
            np.testing.assert_allclose(loop(kind).undo(output, states), SIGNAL, atol=1e-12)

    @pytest.mark.parametrize("kind", KINDS)
    def test_of_the_inverse_is_the_operator(self, kind):
        there, back = loop(kind).inverse, loop(kind).inverse.inverse
        assert there.kind != kind and back.kind == kind
        assert np.all(there.weights > 0)
        np.testing.assert_allclose([back.slope, *back.thresholds, *back.weights], [2.0, *R, *W])

    def test_is_that_of_the_transducer(self):
        """Stop operators of charge: the play operators that `Hysteresis` has."""
        hysteresis, capacitance = loop("stop").hysteresis()
        assert capacitance == 0.5
        thresholds, slopes = hysteresis.inverse(capacitance)
        found = loop("stop").inverse
        np.testing.assert_allclose([found.slope, *found.weights], slopes)
        np.testing.assert_allclose([0.0, *found.thresholds], thresholds)
        by_hand = 2.0 * SIGNAL + sum(w * stop(SIGNAL, r, 0.3 if r > 0.3 else r) for r, w in zip(R, W, strict=True))
        np.testing.assert_allclose(loop("stop").predict(SIGNAL) - 0.4, by_hand)

    def test_needs_a_slope(self):
        with pytest.raises(LoopError, match="slope: found 0, but an inverse needs a value greater than 0"):
            _ = loop("play", slope=0.0).inverse
        with pytest.raises(LoopError, match="kind: found 'play' with slope 2"):
            loop("play").hysteresis()


class TestConvexFit:
    @settings(max_examples=15, deadline=None)
    @given(st.integers(0, 2**32 - 1))
    def test_against_nnls(self, seed):
        rng = np.random.default_rng(seed)
        design = rng.standard_normal((60, 8)) * 10.0 ** rng.integers(-6, 6, 8)
        output = rng.standard_normal(60) * 10.0 ** rng.integers(-6, 6)
        # The free unknown as the difference of two that are not negative.
        scaled = design / np.linalg.norm(design, axis=0)
        oracle, _ = nnls(np.column_stack((scaled, -scaled[:, 0])), output / np.linalg.norm(output))
        oracle[0] -= oracle[-1]
        expected = oracle[:-1] / np.linalg.norm(design, axis=0) * np.linalg.norm(output)
        found = convex_fit(design, output)
        np.testing.assert_allclose(design @ found, design @ expected, atol=1e-9 * np.linalg.norm(output))
        assert np.all(found[1:] >= 0)


class TestRecovery:
    @pytest.mark.parametrize("kind", KINDS)
    @pytest.mark.parametrize("seed", [1])
    def test_within_three_standard_errors(self, kind, seed):
        """Thresholds and their number, weights and initial states from a record with coloured noise."""
        rng = np.random.default_rng(seed)
        states = np.array([0.25, 0.0, -0.3])
        fit = identify_loop(SIGNAL, loop(kind).predict(SIGNAL, states) + coloured(rng, len(SIGNAL)), kind=kind)
        assert len(fit.thresholds) == 3
        found = np.concatenate(([fit.offset, fit.slope], fit.weights, fit.thresholds))
        std = np.concatenate(([fit.offset_std, fit.slope_std], fit.weights_std, fit.thresholds_std))
        score = (found - [0.4, 2.0, *W, *R]) / std
        assert np.all(np.abs(score) < 3), score
        assert fit.rms == pytest.approx(0.02, rel=0.2)
        np.testing.assert_allclose(fit.states[1:], states[1:], atol=0.15)

    def test_standard_errors_hold(self):
        """The scores of 40 records, thresholds given, have the spread that they claim to have."""
        rng = np.random.default_rng(5)
        signal = SIGNAL[::2]
        clean = loop("play").predict(signal)
        scores = []
        for _ in range(40):
            noisy = clean + coloured(rng, len(signal), rho=0.9)
            fit = identify_loop(signal, noisy, kind="play", thresholds=R, virgin=True)
            scores.append((fit.weights - W) / fit.weights_std)
        spread = np.sqrt(np.mean(np.square(scores), axis=0))
        assert np.all((spread > 0.65) & (spread < 1.45)), spread

    def test_virgin_and_noiseless(self):
        fit = identify_loop(SIGNAL, loop("stop").predict(SIGNAL), kind="stop", thresholds=R, virgin=True)
        np.testing.assert_allclose([fit.slope, *fit.weights], [2.0, *W], rtol=1e-8)

    def test_beyond_the_range(self):
        """A stop operator that never slips is part of the slope, and the fit says so."""
        wide = Loop(kind="stop", offset=0.0, slope=2.0, thresholds=np.array([0.2, 5.0]), weights=np.array([1.0, 3.0]))
        rng = np.random.default_rng(3)
        output = wide.predict(SIGNAL) + 0.01 * rng.standard_normal(len(SIGNAL))
        fit = identify_loop(SIGNAL, output, kind="stop", thresholds=[0.2, 5.0], virgin=True)
        assert fit.thresholds.tolist() == [0.2] and fit.unseen.tolist() == [5.0]
        assert fit.slope == pytest.approx(5.0, abs=4 * fit.slope_std)
        assert any("thresholds 5: beyond half the input range; only slope" in text for text in fit.not_identifiable)

    @pytest.mark.parametrize(
        ("signal", "output", "options", "message"),
        [
            (SIGNAL, SIGNAL[1:], {}, r"found arrays of shapes \(1500,\) and \(1499,\)"),
            (SIGNAL[:20], SIGNAL[:20], {}, "found 20 samples, allowed are 30 or more"),
            (SIGNAL, np.where(TIME == 1.0, np.nan, SIGNAL), {}, "output, sample 100: found nan"),
            (TIME, TIME, {}, "signal: found no reversal"),
            (SIGNAL, SIGNAL, {"thresholds": [0.2, 0.1]}, "thresholds: found .*, allowed are increasing"),
        ],
    )
    def test_bad_input(self, signal, output, options, message):
        with pytest.raises(LoopError, match=message):
            identify_loop(signal, output, kind="play", **options)


class TestColoured:
    def test_noise_on_a_smooth_signal(self):
        noisy = 10 * SIGNAL + 0.01 * np.random.default_rng(1).standard_normal(len(SIGNAL))
        assert median_variance(noisy, 6) ** 0.5 == pytest.approx(0.01, rel=0.1)

    @pytest.mark.parametrize("rho", [0.0, 0.3, 0.8])
    def test_effective_samples_of_an_autoregression(self, rho):
        """(1 - rho)/(1 + rho) of the samples."""
        noise = coloured(np.random.default_rng(2), 50000, rho=rho)
        assert effective_samples(noise) == pytest.approx(50000 * (1 - rho) / (1 + rho), rel=0.2)

    def test_covariance_of_a_mean(self):
        noise = coloured(np.random.default_rng(4), 50000, rho=0.8, sigma=1.0)
        assert covariance(np.ones((50000, 1)), noise)[0, 0] == pytest.approx(9.0 / 50000, rel=0.25)


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA.name} beside the project")
class TestStack:
    @pytest.mark.slow
    def test_predicts_the_minor_loops_and_beats_the_papers_inverse(self):
        """From the settled sine alone; displacements of the next row and windows as the data's notes have them."""
        sine, test = (np.loadtxt(DATA / name) for name in ("Model_Vi_Do.dat", "Test_Vi_Do_Di.dat"))
        fit = identify_loop(sine[800:-1, 0], sine[801:, 4], kind="play")
        error = test[1:, 4] - fit.predict(test[:-1, 0])
        tracked = test[1:, 4] - test[:-1, 8]
        without, with_inverse = slice(5051, 6051), slice(11151, 12151)
        assert np.std(tracked[without]) == pytest.approx(1.68, abs=0.01)
        assert np.std(tracked[with_inverse]) == pytest.approx(0.58, abs=0.01)
        assert np.std(error[without]) < 0.45
        assert np.std(error[with_inverse]) < 0.5
        assert np.std(error[2000:]) < 0.1 * np.std(test[2000:, 4])
        wanted = fit.predict(test[:-1, 0])
        np.testing.assert_allclose(fit.undo(wanted), test[:-1, 0], atol=1e-9)
