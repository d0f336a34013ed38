"""Parts of the fit against what they stand for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.identify_runs import campaign_file

from piezoharvest.identify.fitting import model as models
from piezoharvest.identify.fitting.bounded_step import least_within
from piezoharvest.identify.fitting.data import begins_abruptly, unclipped_noise
from piezoharvest.identify.fitting.levenberg_marquardt import (
    _Bounds,
    _Descent,
    _expected_decrease,
    _updated_correction,
)
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_gain import _delay_factors, _solved
from piezoharvest.identify.noise.noise_model import Noise, estimate, initial_noise
from piezoharvest.identify.noise.spectra import gram, whitened
from piezoharvest.identify.noise.switching.event_noise import EventNoise
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.parameters import parameters_of
from piezoharvest.records import load_campaign


def test_a_secant_has_the_curvature_along_its_step_and_stays_that_of_a_minimum():
    rng = np.random.default_rng(0)
    root, step = rng.standard_normal((5, 5)), rng.standard_normal(5)
    curvature = root @ root.T
    information = 0.6 * curvature
    bend = _updated_correction(np.zeros((5, 5)), information, step, curvature @ step)
    np.testing.assert_allclose((information + bend) @ step, curvature @ step)
    assert np.linalg.eigvalsh(bend).min() > -1e-12
    # Where the information already is too much, it is left alone.
    assert not np.any(_updated_correction(np.zeros((5, 5)), 2.0 * curvature, step, curvature @ step))


def on_parabola(x: np.ndarray, curvature=4.0, share=1.0) -> Any:
    """Point whose information is a share of the curvature."""
    cost, information = curvature * float(x @ x), np.array([[share * curvature]])
    return SimpleNamespace(cost=cost, squares=cost, values=x, slope=-curvature * x, information=information, sums=())


def descent_from_one(tried, **which):
    """Descent of one variable from the value one on a parabola, as far as `tried` gives points of it."""
    judge: Any = SimpleNamespace(
        problem=SimpleNamespace(data=(None,), needs_engine=True), precision=np.zeros(1), tried=tried
    )
    free, none = np.full(1, np.inf), np.zeros(1, bool)
    start = on_parabola(np.ones(1), **which)
    return _Descent(judge, _Bounds(-free, free, free, none, none), start, False, 1e-9, -np.inf)


@pytest.mark.parametrize("share", [0.55, 0.8, 1.0])
def test_a_parabola_is_at_its_minimum_after_a_second_step_though_it_was_thought_to_be_flatter(share):
    """The secant along the first step is the curvature; without it each step leaves 1 - 1/share of what there is."""
    slightly = 1e-4  # the damping
    descent = descent_from_one(lambda here, values: on_parabola(values, share=share), share=share)
    assert descent.advance()
    assert descent.here.values == pytest.approx([1.0 - 1.0 / share], abs=slightly)
    descent.advance()
    assert descent.here.values == pytest.approx([0.0], abs=slightly)


def test_steps_that_fail_though_much_was_expected_of_them_are_no_convergence():
    """The damping grows meanwhile, up to where nothing is expected any more."""
    descent = descent_from_one(lambda here, values: None)
    for _ in range(4):
        assert not descent.advance()
        assert not descent.ended
    # Where little is expected, two that fail are enough: corners make the cost uneven by as much.
    descent = descent_from_one(lambda here, values: None)
    descent.enough = 1.0  # of the four that are expected
    for _ in range(3):
        descent.advance()
    assert descent.converged


def test_of_a_step_that_cannot_be_predicted_a_share_is_taken_in_the_same_direction():
    """As of a law whose charge would fall with the voltage; a damped step of several variables would turn."""
    descent = descent_from_one(lambda here, values: on_parabola(values) if values[0] > 0.6 else None)
    assert descent.advance()
    assert descent.here.values == pytest.approx([0.7], abs=1e-4)


@pytest.mark.parametrize("n", [1, 3, 8])
def test_states_by_the_schur_form_are_those_of_the_inverse(n):
    rng = np.random.default_rng(n)
    kept, A = np.eye(n) + 0.1 * rng.standard_normal((n, n)), 0.5 * rng.standard_normal((n, n))
    A[0] = 0.0  # an eigenvalue of zero, as of a state that has died away within a sample
    turn = np.exp(1j * np.linspace(0.01, np.pi, 50))
    forced = rng.standard_normal((n, 50)) + 1j * rng.standard_normal((n, 50))
    states = _solved(kept, A, turn, forced)
    inverse = np.linalg.inv(turn[:, None, None] * kept - A)
    np.testing.assert_allclose(states, np.einsum("fij,jf->if", inverse, forced), rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("samples", [0.0, 0.3, 1.0, 2.75])
def test_a_delay_turns_the_phase_back(samples):
    """By exp(-j w T): exactly for whole samples, by the fourth power of the step for splines between them."""
    step = 1e-3
    effect = SimpleNamespace(late=lambda channel: samples * step if channel == "voltage" else 0.0)
    setting, transducer = SimpleNamespace(sample_time=step), SimpleNamespace(effects=[effect])
    prediction: Any = SimpleNamespace(setting=setting, transducer=transducer)
    frequencies = np.array([1.0, 20.0, 60.0])  # of 500 Hz, half the rate of the samples
    found = _delay_factors(prediction, ["voltage", "displacement"], frequencies)
    np.testing.assert_allclose(found[:, 0], np.exp(-2j * np.pi * frequencies * samples * step), atol=1e-3)
    np.testing.assert_allclose(found[:, 1], 1.0)
    if samples.is_integer():
        everywhere = np.linspace(1.0, 500.0, 20)
        found = _delay_factors(prediction, ["voltage"], everywhere)[:, 0]
        np.testing.assert_allclose(found, np.exp(-2j * np.pi * everywhere * samples * step), atol=1e-12)


@pytest.mark.parametrize("gate", [None, SimpleNamespace(error=0.0)])
def test_without_noise_of_the_drive_and_of_edges_all_is_known_of_switches_and_nothing_is_simulated(gate):
    prediction: Any = SimpleNamespace(setting=SimpleNamespace(gate=gate))  # nothing that could be simulated
    signal: Any = None
    events = EventNoise(prediction, ["voltage"], signal, np.zeros(4), {"voltage": 0.1}, 0.0)
    assert np.array_equal(events.weights, np.ones((4, 1)))
    realisations, counted = events.spread(0, np.ones((1, 4, 2)))
    assert realisations.shape == (2, 0)
    assert not np.any(counted)
    assert not EventNoise(prediction, ["voltage"], signal, np.zeros(4), {"voltage": 0.1}, 1e-3).known


def test_products_with_the_frequencies_last_are_those_of_matrices():
    rng = np.random.default_rng(1)
    white = np.tril(rng.standard_normal((7, 3, 3)) + 1j * rng.standard_normal((7, 3, 3)))
    spectra = rng.standard_normal((7, 3, 4)) + 1j * rng.standard_normal((7, 3, 4))
    found = whitened(np.ascontiguousarray(white.transpose(1, 2, 0)), np.ascontiguousarray(spectra.transpose(1, 2, 0)))
    np.testing.assert_allclose(found.transpose(2, 0, 1), white @ spectra)
    flat = (white @ spectra).reshape(-1, 4)
    np.testing.assert_allclose(gram(found), np.real(flat.conj().T @ flat))


def test_noise_is_guessed_where_a_channel_is_not_at_the_end_of_its_range():
    rng, time = np.random.default_rng(5), np.arange(10_000) / 1000.0
    values = 4.0 * (time < 5.0) + 0.02 * rng.standard_normal(len(time))
    clipped = np.minimum(values, 3.99)
    assert unclipped_noise(clipped) == pytest.approx(0.02, rel=0.03)
    assert unclipped_noise(clipped) > 1.2 * initial_noise(clipped)
    assert unclipped_noise(values) == pytest.approx(initial_noise(values), rel=1e-3)
    assert unclipped_noise(np.zeros(20)) == unclipped_noise(np.arange(3.0)) == 0.0


def test_a_record_begins_abruptly_where_its_first_sample_alone_is_of_another_state():
    rng, time = np.random.default_rng(4), np.arange(200) / 1000.0
    sine = np.sin(2 * np.pi * 20.0 * time)
    noise = 1e-2 * rng.standard_normal((100, 200))
    at_rest = np.where(time > 0, sine + 2.0, 0.0)
    assert all(begins_abruptly(at_rest + each, 1e-2) for each in noise)
    assert not any(begins_abruptly(sine + each, 1e-2) for each in noise)  # it begins fast, as it goes on
    quick = [np.where(time > 0.0, np.sin(2 * np.pi * 20.0 * time + phase), 0.0) for phase in (0.5, 2.0, 4.0)]
    assert all(begins_abruptly(each + 0.1 * noise[0], 1e-3) for each in quick)
    assert not any(begins_abruptly(np.sin(2 * np.pi * 20.0 * time + phase), 1e-2) for phase in (0.5, 2.0, 4.0))
    assert not any(begins_abruptly(each, 1e-2) for each in noise)
    assert not begins_abruptly(np.where(time < 0.002, 0.0, 1.0), 1e-2)
    assert not begins_abruptly(at_rest[:3], 1e-2)


@pytest.mark.parametrize("known", [0.495, 0.505])
def test_noise_that_channels_have_in_common_does_not_hide_their_own(known):
    """The drive's noise is larger in voltage and current than theirs, and known to one percent only."""
    rng, count = np.random.default_rng(6), 5001
    truth = {"displacement": 1.2e-8, "voltage": 1.5e-3, "current": 2e-8, "force": 0.5}
    channels = ("displacement", "voltage", "current")

    def drawn(size):
        return size * np.sqrt(0.5) * (rng.standard_normal(count) + 1j * rng.standard_normal(count))

    spectra = []
    for load in (51.43e3, 97.78e3, 143.8e3):
        gain = np.array([3.3e-9, 7.3e-3, 7.3e-3 / load])
        own = np.column_stack([drawn(truth[channel]) for channel in channels])
        residual = own - drawn(truth["force"])[:, None] * gain
        spectra.append((channels, "force", residual, np.tile(gain.astype(complex), (count, 1))))
    start = Noise({name: 2.0 * sigma for name, sigma in truth.items()})
    found = estimate(spectra, {"force": known}, start).sigma
    assert found["force"] == known
    for channel in channels:
        assert found[channel] == pytest.approx(truth[channel], rel=0.05), channel
    free = estimate(spectra, {}, start).sigma
    for name, sigma in truth.items():
        assert free[name] == pytest.approx(sigma, rel=0.03), name


def test_noise_of_sensors_is_told_beside_a_far_larger_one_of_the_drive_and_a_line():
    """It shows in how channels go together alone: a median over bands of each product by itself has lost that."""
    rng, count = np.random.default_rng(9), 5001
    truth = {"displacement": 3e-9, "voltage": 1.5e-3, "current": 2e-8, "force": 10.0}
    channels = ("displacement", "voltage", "current")

    def drawn(size):
        return size * np.sqrt(0.5) * (rng.standard_normal(count) + 1j * rng.standard_normal(count))

    spectra = []
    for load in (51.43e3, 97.78e3, 143.8e3):
        turn = np.linspace(0.1, 1.0, count)  # the response changes over frequency
        voltage = 7.3e-3 * turn / (turn + 0.05j)
        gain = np.column_stack([np.full(count, 3.3e-9), voltage, voltage / load])
        residual = np.column_stack([drawn(truth[c]) for c in channels]) - drawn(truth["force"])[:, None] * gain
        residual[4000] += 1e3 * np.array([truth[channel] for channel in channels])  # mains hum
        spectra.append((channels, "force", residual, gain))
    start = Noise({name: 3.0 * sigma for name, sigma in truth.items()})
    for known in ({}, {"force": 10.0}):
        found = estimate(spectra, known, start).sigma
        for name, sigma in truth.items():
            assert found[name] == pytest.approx(sigma, rel=0.05), name


@pytest.mark.parametrize("known", [{}, {"force": 0.5}])
def test_noise_of_one_channel_alone_cannot_be_told_from_that_of_its_drive(known):
    """Their sum is right all the same, and nothing fails."""
    rng = np.random.default_rng(8)
    gain = np.full((5001, 1), 2.0 + 0j)
    residuals = np.sqrt(0.5 * 10.0) * (rng.standard_normal((10, 5001, 1)) + 1j * rng.standard_normal((10, 5001, 1)))
    start = Noise({"voltage": 5.0, "force": 1.0})
    found = estimate([(("voltage",), "force", residual, gain) for residual in residuals], known, start).sigma
    # Medians of sixteen bands of ten records: one percent.
    assert found["voltage"] ** 2 + (2.0 * found["force"]) ** 2 == pytest.approx(10.0, rel=0.05)
    alone = [(("voltage",), "base_acceleration", residual, gain) for residual in residuals]
    assert estimate(alone, {}, start).sigma["force"] == 1.0


def test_a_descent_is_expected_to_gain_what_it_has_gained_or_what_its_steps_still_promise():
    assert _expected_decrease([100.0, 50.0], [40.0, 30.0]) == np.inf  # too early to tell
    assert (
        _expected_decrease([100.0, 50.0, 40.0, 38.0], [60.0, 10.0, 2.0, 1.0]) == 10.0
    )  # the largest of the last three
    crawling = list(np.linspace(90.0, 10.0, 11))
    assert _expected_decrease(crawling, [20.0] * 10) == pytest.approx(8.0)


def test_a_record_is_evaluated_once_for_a_model_and_anew_for_any_other(tmp_path, monkeypatch):
    campaign = load_campaign(campaign_file(tmp_path, 1)[0])
    data, nominal = prepared(campaign, "fit")[0], campaign.transducer
    model = models.Model(nominal, tuple(parameters_of(nominal, {"force"})), ("voltage",))
    nuisance = np.asarray(Problem([data], nominal, ("voltage",)).start(model)[0])
    runs, blocks = [], models.residual_blocks
    monkeypatch.setattr(models, "residual_blocks", lambda *some: runs.append(some) or blocks(*some))

    def evaluated(model, nuisance):
        """Residuals and derivatives, which are always those of a run through the record."""
        ((_, residual, slopes),) = models.evaluated(model, data, nuisance)
        ((_, _, wanted, derivatives),) = blocks(model, data, nuisance, True)
        np.testing.assert_array_equal(residual, wanted)
        np.testing.assert_array_equal(slopes, derivatives)
        return len(runs)

    stiffer = replace(model, transducer=replace(nominal, stiffness=1.01 * nominal.stiffness))
    assert [evaluated(model, nuisance) for _ in range(3)] == [1, 1, 1]
    assert evaluated(stiffer, nuisance) == 2  # as a step that is tried in vain,
    assert evaluated(model, nuisance) == 2  # before the end is judged
    assert evaluated(model, nuisance + 1e-9) == 3
    assert evaluated(replace(model, parameters=model.parameters[:-1]), nuisance) == 4
    assert evaluated(model, nuisance) == 5  # not kept any more
    monkeypatch.setattr(models, "CACHE_BYTES", 1000)
    assert evaluated(stiffer, nuisance) == 6
    assert evaluated(stiffer, nuisance) == 7  # too large


@pytest.mark.parametrize("seed", range(8))
def test_a_step_within_bounds_is_the_least(seed):
    """Against the conditions of Karush, Kuhn and Tucker, for information that is nearly singular."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 80))
    a = rng.normal(size=(n, n))
    a = a @ np.diag(10 ** rng.uniform(-5, 0, n)) @ a.T
    size = np.sqrt(np.diag(a))
    curvature, slope = a / np.outer(size, size) + 1e-6 * np.eye(n), rng.normal(size=n) * 10 ** rng.uniform(-2, 2)
    low, high = -rng.exponential(size=n), rng.exponential(size=n)
    high[rng.random(n) < 0.2] = np.inf
    low[rng.random(n) < 0.2] = 0.0
    fixed = rng.random(n) < 0.1
    low[fixed] = high[fixed] = 0.0
    x = least_within(curvature, slope, low, high)
    assert np.all((x >= low) & (x <= high))
    pull = slope - curvature @ x
    # The most that the cost can still decrease, to first order, where a bound is finite; and along the rest.
    room = np.where(pull > 0, np.minimum(high, 1e3) - x, x - low)
    assert np.abs(pull) @ room <= 1e-5 * (slope @ np.linalg.solve(curvature, slope))
