"""Score tests, cosines and what is left, on records whose noise is white and whose effects are known."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from diagnose_runs import SIGMA, campaign, fitted, reading, synthetic
from scipy.stats import kstest

from piezoharvest.description.effects import (
    BiasCurrent,
    Clipping,
    DielectricRelaxation,
    DiodeDropError,
    InversionLoss,
    Leakage,
    LoadError,
    Stiffening,
    registered,
)
from piezoharvest.description.parameters import AS_LABELLED
from piezoharvest.description.shunts import ParallelSSHI
from piezoharvest.diagnose.residual_structure.residual_tests import (
    ResidualBlock,
    _burst_tests,
    blocks_of,
    failed_tests,
    run_tests,
)
from piezoharvest.diagnose.selection.score_tests import (
    _one_step_scores,
    cosine,
    effect_parameters,
    extended,
    scores,
    starts_of,
)
from piezoharvest.diagnose.validation import spoils
from piezoharvest.identify.fitting.likelihood import spectra_of
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.prediction import Prediction


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    found = campaign(tmp_path_factory.mktemp("scores"))
    return prepared(found, "fit"), found.transducer


def likelihood_ratio(problem, found, start):
    """By how much -2 ln L falls in a full fit with an effect."""
    model = extended(found.model, [start], effect_parameters([start]))
    nuisance = nuisance_for_model(problem, found.model, found.nuisance, model)
    return found.cost - fit(problem, model, nuisance, found.noise, estimate_noise=False).cost


@pytest.mark.parametrize(
    "effect",
    [BiasCurrent(current=2e-9), Leakage(resistance=3e7), Stiffening(cubic_stiffness=2e17)],
    ids=lambda e: e.name,
)
def test_score_is_the_likelihood_ratio_of_a_small_effect(records, effect):
    problem, found, scales = fitted(*records, [effect], seed=1)
    best = scores(problem, found, scales, [type(effect)])[0]
    assert best.score > 20.0
    assert best.score == pytest.approx(likelihood_ratio(problem, found, best.effect), rel=0.05)
    strength = type(effect).strength().name
    assert getattr(best.effect, strength) == pytest.approx(getattr(effect, strength), rel=0.3)


def test_score_grows_with_the_square_of_the_effect(records):
    sizes = []
    for current in (4e-9, 8e-9):
        problem, found, scales = fitted(*records, [BiasCurrent(current=current)], seed=2, scale=1e-3)
        sizes.append(scores(problem, found, scales, [BiasCurrent])[0].score)
    assert sizes[1] / sizes[0] == pytest.approx(4.0, rel=0.01)


@pytest.mark.slow
def test_scores_of_a_healthy_specimen_are_chi_squared(records):
    """One start, no bound: the p-values are uniform."""
    p_values = []
    for seed in range(30):
        problem, found, scales = fitted(*records, seed=100 + seed)
        p_values.append(scores(problem, found, scales, [BiasCurrent])[0].p_value)
    assert kstest(p_values, "uniform").pvalue > 1e-3


def test_a_start_of_the_wrong_sign_is_no_candidate(records):
    """The response of a leakage with the opposite sign: a load that is larger than its label."""
    problem, found, scales = fitted(*records, [LoadError(relative_error=5e-3)], seed=3)
    names = {candidate.name: candidate for candidate in scores(problem, found, scales, [Leakage, LoadError])}
    assert names["load_error"].effect.relative_error > 0
    for candidate in names.values():
        value = getattr(candidate.effect, type(candidate.effect).strength().name)
        assert value > 0 or candidate.name == "load_error"


def test_cosine(records):
    problem, found, scales = fitted(*records, [DielectricRelaxation(capacitance=5e-8, time_constant=0.2)], seed=4)
    candidates = scores(problem, found, scales, [DielectricRelaxation, BiasCurrent])
    for one in candidates:
        assert cosine(one, one) == pytest.approx(1.0)
        for other in candidates:
            assert abs(cosine(one, other)) <= 1.0 + 1e-9
            assert cosine(one, other) == pytest.approx(cosine(other, one), abs=1e-9)
    slow = sorted((c for c in candidates if c.name == "dielectric_relaxation"), key=lambda c: c.effect.time_constant)
    assert abs(cosine(slow[0], slow[1])) > abs(cosine(slow[0], slow[-1]))


def test_leftovers_of_white_noise_are_uniform(records):
    p_values = []
    for seed in range(6):
        problem, found, _ = fitted(*records, seed=200 + seed)
        places = run_tests(problem, found)
        # Bands of many lines: few lose a share that counts to the fitted parameters.
        p_values += [place.p_value for place in places if place.count > 40 and place.record != "all"]
        assert not failed_tests(problem, found)
    assert len(p_values) > 100
    assert kstest(p_values, "uniform").pvalue > 1e-3


def test_leftovers_find_what_is_not_in_the_model(records):
    problem, found, _ = fitted(*records, [Stiffening(cubic_stiffness=3e18)], seed=5)
    left = failed_tests(problem, found)
    assert left
    assert left[0].p_value < 1e-12


def disturbed(records, seed, wave):
    """Fit of records whose voltage has something added, in units of its noise, that no effect of the library is."""
    problem, found, _ = fitted(*records, seed=seed)

    def heard(data):
        time = np.arange(len(data)) * data.setting.sample_time
        return reading(data, "voltage", lambda values: values + SIGMA["voltage"] * wave(time))

    problem = Problem([heard(data) for data in problem.data], problem.nominal, problem.offset_channels)
    return problem, fit(problem, found.model, found.nuisance, found.noise, estimate_noise=False)


def test_leftovers_find_a_line_at_any_frequency(records):
    left = failed_tests(*disturbed(records, 7, lambda time: 0.4 * np.sin(2 * np.pi * 181.3 * time)))
    assert left[0].where in ("181 Hz", "181.5 Hz")
    assert left[0].record == "all"
    assert np.isfinite(left[0].squares)


def test_leftovers_find_a_few_samples_but_not_a_spike(records):
    few = failed_tests(*disturbed(records, 8, lambda time: 9.0 * ((time > 0.7) & (time < 0.7045))))
    assert few[0].where.startswith("for 8 samples at 0.69") or few[0].where.startswith("for 8 samples at 0.7")
    assert not failed_tests(*disturbed(records, 8, lambda time: 9.0 * (np.arange(len(time)) == 700)))


def test_a_burst_is_told_at_its_time_in_a_record_of_several_blocks():
    data = SimpleNamespace(name="long", channels=("voltage",), setting=SimpleNamespace(sample_time=1e-3))
    rng = np.random.default_rng(4)
    parts = [rng.standard_normal((1000, 1)) for _ in range(2)] + [rng.standard_normal((9, 1))]
    parts[1][300:306] += 9.0
    blocks = [ResidualBlock(data, None, 1000 * n, part, spectra_of(part)) for n, part in enumerate(parts)]
    places = sorted(_burst_tests(blocks), key=lambda place: place.p_value)
    assert len(places) == 2  # nine samples are too few to tell
    assert places[0].p_value < 1e-20 < places[1].p_value
    assert 1.297 <= float(places[0].where.split()[-2]) <= 1.301


@pytest.mark.slow
def test_rounded_sensors_scatter_the_harmonics_of_a_drive_that_comes_back_to_the_same_values(tmp_path):
    """Squares of lines over many offsets of a laser that rounds to 30 nm, before a converter that rounds to 3 nm."""
    small = {"load_resistance": 97.78e3, "excitation": {"amplitude": 60.0, "frequency": 4.0}}
    found = campaign(tmp_path, records=[small], duration=8.0)
    (data,) = prepared(found, "fit")
    rng, at = np.random.default_rng(3), data.channels.index("displacement")
    squares, expected = [], []
    for _ in range(60):
        made, offset = synthetic(data, found.transducer, rng, scale=0.8), rng.uniform(0.0, 3e-6)
        made = reading(made, "displacement", lambda x, by=offset: 3e-8 * np.round((x + by) / 3e-8))
        made = reading(made, "displacement", lambda x: 3.05e-9 * np.round(x / 3.05e-9))
        problem = Problem([made], found.transducer, ("displacement",))
        model = Model(found.transducer, (), ("displacement",))
        (block,) = blocks_of(problem, fit(problem, model, noise=Noise(SIGMA), estimate_noise=False))
        for k in range(2, 9):
            squares.append(0.5 * np.abs(block.normalised[32 * k, at]) ** 2)
            expected.append(1.0 + block.rounding_variance(32 * k)[at])
    assert np.mean(squares) == pytest.approx(np.mean(expected), rel=0.12)
    assert np.mean(expected) > 1.3


def test_a_range_that_no_value_comes_to_leaves_the_other_scores_as_they_are(records):
    """It is a parameter without any information."""
    problem, found, scales = fitted(*records, [BiasCurrent(current=2e-9)], seed=1)
    clip = Clipping(limit=1e3, channel="voltage")
    model = extended(found.model, [clip], effect_parameters([clip]))
    nuisance = nuisance_for_model(problem, found.model, found.nuisance, model)
    idle = fit(problem, model, nuisance, found.noise, estimate_noise=False)
    scored = [scores(problem, each, scales, [BiasCurrent, Leakage])[0] for each in (found, idle)]
    assert scored[1].name == scored[0].name
    assert scored[1].score == pytest.approx(scored[0].score, rel=1e-3)


def test_parameters_that_stand_in_for_clipping_do_not_hide_it(records):
    """The largest voltages are cut off: the score is near what a full fit gains, not what one at rest would."""
    problem, found, _ = fitted(*records, seed=9)
    voltages = [data.values[:, data.channels.index("voltage")] for data in problem.data]
    clip = Clipping(limit=0.998 * max(np.abs(values).max() for values in voltages), channel="voltage")
    cut = [reading(data, "voltage", lambda x: np.clip(x, -clip.limit, clip.limit)) for data in problem.data]
    problem = Problem(cut, problem.nominal, problem.offset_channels)
    found = fit(problem, found.model, found.nuisance, found.noise, estimate_noise=False)
    score = _one_step_scores(problem, found, [clip])[0].score
    assert score > 20.0
    assert score == pytest.approx(likelihood_ratio(problem, found, clip), rel=0.3)


def test_what_an_effect_costs_unseen_records_is_weighed_against_its_gain():
    assert not spoils(1000.0, 1019.0, 50.0)
    assert spoils(1000.0, 1021.0, 50.0)
    assert not spoils(1000.0, 1021.0, 400.0)
    assert spoils(1000.0, 1041.0, 400.0)


SWITCHED = ParallelSSHI(smoothing_capacitance=1e-6, load_resistance=1e6, diode_drop=0.3, inductance=0.1, quality=5.0)
OF_CIRCUITS = {
    "switch_delay", "inversion_loss", "voltage_reversion", "diode_drop_error", "on_time_offset", "missed_switching",
    "reverse_leakage", "probe_loading",
}  # fmt: skip


def test_effects_of_circuits_are_sought_behind_such_only(records):
    """Not even a start of them is scored behind resistors, and the rest are as before."""
    problem, found, scales = fitted(*records, [BiasCurrent(current=2e-9)], seed=1)
    assert {name for name, cls in registered().items() if not any(map(cls.acts_on, scales.shunts))} == OF_CIRCUITS
    names = {candidate.name for candidate in scores(problem, found, scales)}
    assert "bias_current" in names
    assert names.isdisjoint(OF_CIRCUITS)


def test_two_names_of_one_law_are_not_candidates_together(records):
    """Voltage reversion is a dielectric relaxation: it stands for that where every record is behind a switch."""
    _, found, scales = fitted(*records, seed=1)
    for shunts, name in (((SWITCHED, SWITCHED), "voltage_reversion"), ((SWITCHED, None), "dielectric_relaxation")):
        names = {start.name for start in starts_of(dataclasses.replace(scales, shunts=shunts), found, None)}
        assert names & {"voltage_reversion", "dielectric_relaxation"} == {name}


def test_effects_that_stand_in_for_a_label_start_at_it(records):
    _, _, scales = fitted(*records, seed=6)
    scales = dataclasses.replace(scales, shunts=(*scales.shunts, SWITCHED, SWITCHED))
    assert list(InversionLoss.starts(scales)) == [InversionLoss(quality=5.0)]
    assert list(DiodeDropError.starts(scales)) == [DiodeDropError(diode_drop=0.3)]


@pytest.mark.parametrize("name", registered())
def test_every_effect_says_how_it_looks_and_where_to_start(name, records):
    cls = registered()[name]
    _, _, scales = fitted(*records, seed=6)
    scales = dataclasses.replace(scales, shunts=(*scales.shunts, SWITCHED))
    assert len(cls.looks) > 20
    assert len(cls.told_by) > 10
    assert len(cls.source) > 5
    assert cls.strength().metadata["null"] is not None
    assert any(map(cls.acts_on, scales.shunts))
    shown = dataclasses.replace(scales, peaks={c: (1.0,) for c in scales.channels}, switching=(2.0,))
    starts = list(cls.starts(shown))
    assert starts
    assert all(isinstance(start, cls) for start in starts)


@pytest.mark.parametrize("name", registered())
def test_an_effect_at_its_null_changes_nothing(name, records):
    data, transducer = records
    cls = registered()[name]
    _, _, scales = fitted(*records, seed=6)
    shunts = (*scales.shunts, SWITCHED)
    scales = dataclasses.replace(scales, peaks={c: (1e9,) for c in scales.channels}, shunts=shunts)
    bare = values(transducer, data[0], ())
    for start in cls.starts(scales):
        strength = cls.strength()
        null = strength.metadata["null"]
        if null == AS_LABELLED:
            assert any(getattr(shunt, strength.name, None) == getattr(start, strength.name) for shunt in scales.shunts)
            continue
        near = getattr(start, strength.name) * 1e-6 if null == 0 else max(getattr(start, strength.name), 1e15)
        effect = dataclasses.replace(start, **{strength.name: near})
        assert np.abs(values(transducer, data[0], (effect,)) / bare - 1.0).max() < 1e-5


def values(transducer, data, effects):
    """Sizes of the channels as they are predicted, sensors included."""
    from piezoharvest.predict.sensors import Course, sensed

    prediction = Prediction(dataclasses.replace(transducer, effects=tuple(effects)), data.setting)
    found = np.concatenate([block.values for block in prediction.blocks(False)])
    noise = dict.fromkeys(prediction.channels, 0.0)
    found, _ = sensed(effects, (), noise, Course(data.setting.sample_time), found.copy(), None)
    return np.abs(found).max(axis=0)
