"""A load cell whose noise is larger than that of all other sensors: what it says of the drive is not what drove it."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from piezoharvest import Campaign, Resistor, Transducer
from piezoharvest.bench import measure, write_campaign
from piezoharvest.description.effects import ChannelSkew
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.residual_structure import drive_noise
from piezoharvest.diagnose.residual_structure.residual_regression import hints
from piezoharvest.diagnose.selection.score_tests import effect_parameters, extended
from piezoharvest.diagnose.selection.start_values import campaign_scales
from piezoharvest.identify.fitting.data import data_of
from piezoharvest.identify.fitting.evaluation import whiteners
from piezoharvest.identify.fitting.likelihood import Whitener, spectra_of
from piezoharvest.identify.fitting.model import Model, residual_blocks, unexplained_blocks
from piezoharvest.identify.fitting.output_error import covariance, fit, inflation
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.parameters import parameters_of
from piezoharvest.records import load_campaign
from piezoharvest.study import build_transducer, study_from

STACK = {
    "mass": 0.0158, "damping": 1250.0, "stiffness": 3.125e8, "coupling": 7.822, "capacitance": 3.2e-6,
    "hysteresis": {"thresholds": [0.1e-6, 0.3e-6, 0.7e-6], "weights": [0.5e6, 1.5e6, 0.5e6]},
}  # fmt: skip
STEP = {"kind": "step_force", "amplitude": 900.0, "offset": 100.0, "duration": 1.0, "rise_time": 0.001}
SLOW = {**STEP, "rise_time": 0.05}
RECORDS = [
    {"load_resistance": 10e3, "excitation": STEP},
    {"load_resistance": 97.78e3, "excitation": SLOW},
    {"load_resistance": 51.43e3, "excitation": {"frequency": 3.0}},
    {"load_resistance": 143.8e3, "excitation": {"amplitude": 200.0, "offset": 300.0}},
    {"load_resistance": 97.78e3, "role": "validate"},
]
# Noise of the load cell moves the stack by 16 nm, five times what the sensor of displacement has.
NOISY = {"load_cell": {"noise": 5.0}, "laser": {"noise": 3e-9, "resolution": 0.0, "sensitivity": 1e6}}


def noisy(folder, seed, effects=None):
    tables = {
        "transducer": STACK, "shunts": [{"kind": "resistor", "resistance": 97.78e3}],
        "excitation": {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 4.0},
        "bench": {
            "duration": 4.0, "seed": seed, "nominal_error": 0.1, "records": RECORDS, "effects": effects or {}, **NOISY,
        },
    }  # fmt: skip
    return load_campaign(write_campaign(measure(study_from(tables, Path("study.toml"))), Path(folder) / "campaign"))


@pytest.mark.slow
@pytest.mark.parametrize("effects", [{}, {"leakage": {"resistance": 1e6}}], ids=["healthy", "leakage"])
def test_noise_of_the_drive_is_no_effect_and_hides_none(tmp_path, effects):
    found = diagnose(noisy(tmp_path, 3, effects))
    assert [named.effect.name for named in found.effects] == list(effects)
    assert found.verdict == ("effect" if effects else "adequate")


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """Records that the specimen follows without a jump, with the transducer that stood on the bench."""
    found = noisy(tmp_path_factory.mktemp("slow"), 5)
    kept = tuple(record for record in found.records if not record.name.startswith("01"))
    return Problem(prepared(replace(found, records=kept), "fit"), build_transducer(STACK), ("displacement",))


def sigma(problem):
    """Of the sensors, rounded by the converter: of the bench's own channels those of the voltage and the current."""
    rounded = {"displacement": 3e-9, "voltage": np.hypot(1.5e-3, 3.05e-4 / 12**0.5), "current": 3.48e-8, "force": 5.0}
    assert set(rounded) == {*problem.data[0].channels, "force"}
    return Noise(rounded)


def test_residuals_of_the_truth_are_white_as_every_operator_passes_the_noise_on_average(slow):
    """Those that slip pass none on: a third of the voltage's slow noise."""
    model = Model(slow.nominal, (), ("displacement",))
    nuisance = slow.start(model)
    for data, mine, white in zip(slow.data, nuisance, whiteners(slow, model, nuisance, sigma(slow)), strict=True):
        ((_, _, residual),) = unexplained_blocks(model, data, mine)
        spectrum = (white.of(len(residual)) @ spectra_of(residual)[:, :, None])[:, :, 0]
        if "step" in data.name:
            continue  # where it began is not fitted here
        for lines in (slice(24, 120), slice(120, -1)):  # from 6 and from 30 Hz on, above the drive itself
            squares = 0.5 * np.abs(spectrum[lines]) ** 2
            assert squares.mean(axis=0) == pytest.approx(1.0, abs=5.0 / np.sqrt(len(squares))), data.name


def test_what_operators_make_of_noise_that_a_drive_keeps_is_as_large_as_it_is_told(slow, monkeypatch):
    """Against other noise than that it is told by: at slow frequencies up to several times what sensors have.

    The specimen follows a multisine of slow tones, along which the noise of the load cell cannot be taken off.
    """
    monkeypatch.setattr(drive_noise, "REALISATIONS", 12)
    model, noise = Model(slow.nominal, (), ()), sigma(slow)
    record = next(data.record for data in slow.data if "step" not in data.name)
    time = record["time"]
    true = 550.0 + sum(a * np.sin(2 * np.pi * f * time + f) for f, a in ((0.55, 160.0), (1.3, 130.0), (5.1, 110.0)))
    clean = with_values(slow, record, {"force": true})
    ((_, _, residual, _),) = residual_blocks(model, clean, np.zeros(len(model.prediction(clean).nuisance_names)), False)
    follows = dict(zip(clean.channels, (clean.values - residual).T, strict=True))
    edges, squares, told = np.array([0.0, 0.0015, 0.004, 0.02, 0.1]), [], None
    for seed in range(12):
        rng = np.random.default_rng(seed)
        read = {name: values + noise.sigma[name] * rng.standard_normal(len(time)) for name, values in follows.items()}
        read["force"] = true + noise.sigma["force"] * rng.standard_normal(len(time))
        data = with_values(slow, record, read)
        nuisance = np.zeros(len(model.prediction(data).nuisance_names))
        white = Whitener(model.prediction(data, nuisance), noise, data)
        if told is None:
            told = drive_noise.drive_noise_variance(data, white, model, nuisance, noise.sigma["force"], edges)
        _, _, spectrum = next(white.left(model, nuisance))
        lines = np.searchsorted(np.fft.rfftfreq(len(time)), edges)
        squares.append([0.5 * np.mean(np.abs(spectrum[a:b]) ** 2, axis=0) for a, b in pairwise(lines)])
    found = np.mean(squares, axis=0)
    voltage = data.channels.index("voltage")
    assert found[0, voltage] > 1.5  # more than noise
    assert found == pytest.approx(1.0 + told, rel=0.3)  # six lines of twelve draws, twice


def with_values(problem, record, values):
    """Data of a record with other values."""
    signals = {name: replace(signal, values=values.get(name, signal.values)) for name, signal in record.signals.items()}
    return data_of(replace(record, signals=signals), problem.nominal)


@pytest.fixture(scope="module")
def healthy(slow):
    kept = tuple(p for p in parameters_of(slow.nominal, {"force"}) if p.path[0] not in ("mass", "damping"))
    model = Model(slow.nominal, kept, ("displacement",))
    return fit(slow, model, noise=sigma(slow), estimate_noise=False)


def test_no_channel_seems_to_end_where_the_noise_of_the_drive_would_have_taken_it(slow, healthy):
    peaks = campaign_scales(slow.data, healthy).peaks
    assert peaks["voltage"] == peaks["current"] == ()


def test_the_noise_of_the_drive_is_no_hint(slow, healthy):
    assert hints(slow, healthy) == []


def test_an_effect_that_is_not_there_gains_no_more_than_chance_whatever_it_does_to_the_noise(slow, healthy):
    """A delay takes the damping's place, but passes fast noise on in another way: that says nothing about either."""
    free = tuple(p for p in parameters_of(slow.nominal, {"force"}) if p.path[0] != "mass")
    model = replace(healthy.model, parameters=free)
    before = fit(slow, model, healthy.nuisance, healthy.noise, white=healthy.white, estimate_noise=False)
    skew = ChannelSkew(delay=3e-4)
    model = extended(before.model, [skew], effect_parameters([skew]))
    nuisance = nuisance_for_model(slow, before.model, before.nuisance, model)
    found = fit(slow, model, nuisance, before.noise, white=before.white, estimate_noise=False)
    assert before.converged
    assert found.converged
    assert -0.1 < before.cost - found.cost < 12.0
    delay = len(model.parameters) - 1
    assert inflation(found, delay) < 1.1
    (effect,) = found.model.transducer.effects
    assert abs(effect.delay) < 4.0 * np.sqrt(covariance(found)[delay, delay])


@pytest.mark.parametrize("seed", [4, 5])
def test_a_sine_sweep_through_a_resonance_with_a_noisy_load_cell_is_healthy(seed):
    """Noise of 0.2 % of the force is amplified by the resonance, in whose band the residuals show it alone."""
    rng = np.random.default_rng(seed)
    m, b, k, coupling, capacitance, ohm = 0.25, 3.85, 9.48e4, 0.0213, 120e-9, 33e3
    time = np.arange(4000) / 2000.0

    def force(t):
        return 0.5 * np.sin(2 * np.pi * (85.0 * t + 6.25 * t**2))  # 85 to 110 Hz in 2 s

    def rates(t, y):
        x, v, u = y.tolist()
        return [v, (force(t) - b * v - k * x + coupling * u) / m, (-coupling * v - u / ohm) / capacitance]

    x, _, u = solve_ivp(rates, (0, time[-1]), [0, 0, 0], t_eval=time, rtol=1e-9, atol=1e-14, max_step=5e-4).y
    exact = {"force_N": (force(time), 1e-3), "displacement_m": (x, 2e-8), "voltage_V": (u, 3e-3)}
    data = {name: values + sigma * rng.standard_normal(4000) for name, (values, sigma) in exact.items()}
    nominal = Transducer(mass=0.25, damping=4.0, stiffness=9.4e4, coupling=0.022, capacitance=118e-9)
    record = {"data": data | {"time_s": time}, "shunt": Resistor(resistance=ohm)}
    found = diagnose(Campaign.from_arrays(nominal, [record]))
    assert found.verdict == "adequate"
    true = {"mass": m, "damping": b, "stiffness": k, "coupling": coupling, "capacitance": capacitance}
    for estimate in found.estimates:
        assert abs(estimate.value - true[estimate.parameter.name]) < 4.0 * (estimate.std or 0.0)
