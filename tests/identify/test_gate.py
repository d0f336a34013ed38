"""A recorded gate that times the switch, and a fit in which the detector of the model jumps to another extremum."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from records_bench.bench_runs import waves
from selection import with_slow
from studies import BENCH, DRIVE, STOPS, bench, objects

from piezoharvest import SwitchDelay
from piezoharvest.bench import measure, write_campaign
from piezoharvest.identify import identify
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.measured_drive import straight_drive
from piezoharvest.predict.circuit.setting import circuit_setting
from piezoharvest.predict.discrete_model import Setting
from piezoharvest.predict.parameters import parameter_of, parameters_of, put, value_at
from piezoharvest.records import load_campaign
from piezoharvest.records.gate import Edges, rising_edges
from piezoharvest.study import study_from

COIL = {"inductance": 0.1, "quality": 5.0}
SMOOTH = {"smoothing_capacitance": 1e-7, "load_resistance": 3e5, "diode_drop": 0.3}
CIRCUITS = {
    "parallel_sshi": {"kind": "parallel_sshi", **COIL, **SMOOTH},
    "series_sshi": {"kind": "series_sshi", **COIL, **SMOOTH},
    "sece": {"kind": "sece"},
    "ssdv": {"kind": "ssdv", **COIL, "source_voltage": 1.0},
}
QUICK = ("parallel_sshi", "ssdv")
LATE = 4e-4  # s, of the switch on the bench, which no label tells


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_edges_of_a_sampled_logic_signal(noise):
    """In the middle of the samples between which the level changes; what is high at first has risen before."""
    rng, step = np.random.default_rng(1), 1e-3
    true = np.array([0.0123, 0.0407, 0.0998])
    time = np.arange(150) * step
    values = 3.3 * np.any([(time >= t) & (time < t + 0.004) for t in (-0.002, *true)], axis=0)
    found = rising_edges(values + noise * 3.3 * rng.normal(size=len(time)), step)
    assert found.error == 0.5 * step
    assert np.all(np.abs(found.times - true) <= found.error)


def test_edges_with_slopes_are_interpolated():
    time, true = np.arange(400) * 1e-3, np.array([0.0523, 0.2111])
    values = sum(np.clip((time - t) / 6e-3 + 0.5, 0.0, 1.0) - np.clip((time - t - 0.05) / 6e-3, 0.0, 1.0) for t in true)
    found = rising_edges(-1.0 + 5.0 * values + 0.01 * np.random.default_rng(2).normal(size=len(time)), 1e-3)
    assert found.error == 0.0
    assert np.allclose(found.times, true, atol=3 * 0.01 / 5.0 * 6e-3)


@pytest.mark.parametrize("values", [np.zeros(50), np.ones(50)])
def test_a_gate_without_edges(values):
    assert not len(rising_edges(values, 1e-3).times)


@pytest.mark.parametrize("hysteresis", [{}, {"hysteresis": STOPS}], ids=["plain", "hysteresis"])
@pytest.mark.parametrize("circuit", with_slow(CIRCUITS, slow=lambda name: name not in QUICK))
def test_the_gate_tells_what_the_label_does_not(circuit, hysteresis):
    """Radau IIA of the bench with a switch that is late, against the engine with its pulses and no delay."""
    rate, table = 10000.0, {**BENCH, **hysteresis}
    wanted = waves(DRIVE, {**CIRCUITS[circuit], "time_lag": LATE}, table, length=0.1, rate=rate)
    edges = Edges(np.array([closed for closed, _ in wanted.pulses]), 0.0)
    assert len(edges.times) >= 8
    system, _ = objects(bench(CIRCUITS[circuit], **hysteresis))
    setting = circuit_setting("force", system.shunt, 1.0 / rate, wanted.drive, system.transducer, gate=edges)
    names = ("displacement", "voltage")
    (found,) = CircuitPrediction(system.transducer, setting).blocks(derivatives=False, channels=names)
    for column, true in zip(found.values.T, (wanted.displacement, wanted.voltage), strict=True):
        off = np.abs(column - true) / np.abs(true).max()
        assert np.mean(off < 1e-6) > 0.97, (off.max(), np.mean(off < 1e-6))
    without = dataclasses.replace(setting, gate=None)
    (other,) = CircuitPrediction(system.transducer, without).blocks(derivatives=False, channels=names)
    assert np.abs(other.values[:, 1] - wanted.voltage).max() > 1e-2 * np.abs(wanted.voltage).max()


@pytest.mark.parametrize("circuit", with_slow(CIRCUITS, slow=lambda name: name not in QUICK))
def test_derivatives_with_a_timed_switch(circuit):
    """Against central differences: parameters, the delay, and the edges' places within their samples."""
    system, _ = objects(bench(CIRCUITS[circuit], hysteresis=STOPS))
    delay = SwitchDelay(time_lag=1e-4)
    device = dataclasses.replace(system.transducer, effects=(delay,))
    field = next(field for field in dataclasses.fields(delay) if "unit" in field.metadata)
    parameters = [*parameters_of(device, {"force"}), parameter_of(delay, field, ("effects", 0, field.name))]
    rng, step = np.random.default_rng(5), 2.5e-4
    drive = 0.05 * np.convolve(rng.normal(size=406), np.ones(7) / 7, "valid")
    gate = Edges(np.array([0.01, 0.02, 0.031, 0.05, 0.066]) + 1e-5, 0.5 * step)
    free = {"free": ("x1", "q"), "sizes": (1e-4, 1e-7)}
    setting = Setting("force", system.shunt, step, drive[0], straight_drive(drive), 400, gate=gate, **free)
    names = ("displacement", "voltage", "current")
    nuisance = 0.3 * rng.normal(size=2 + 2 + len(gate.times))
    prediction = CircuitPrediction(device, setting, parameters, nuisance)
    assert prediction.nuisance_names[-5:] == tuple(f"edge {k}" for k in range(5))
    (block,) = prediction.blocks(channels=names)

    def values(device=device, nuisance=nuisance):
        (found,) = CircuitPrediction(device, setting, (), nuisance).blocks(derivatives=False, channels=names)
        return found.values

    for k in range(len(parameters) + len(nuisance)):
        change = 1e-6
        if k < len(parameters):
            parameter = parameters[k]
            inner = parameter.inner(value_at(device, parameter.path))
            change *= 1.0 if parameter.scaling == "log" else abs(inner)
            upper, lower = (
                values(put(device, parameter.path, float(np.real(parameter.outer(inner + sign * change)))))
                for sign in (1.0, -1.0)
            )
        else:
            moved = change * (np.arange(len(nuisance)) == k - len(parameters))
            upper, lower = values(nuisance=nuisance + moved), values(nuisance=nuisance - moved)
        wanted, found = (upper - lower) / (2.0 * change), block.derivatives[:, :, k]
        size = np.abs(wanted).max(axis=0) + 1e-9 * np.abs(block.values).max(axis=0) * 1e-6 / change + 1e-300
        assert np.all(np.mean(np.abs(found - wanted) <= 5e-5 * size, axis=0) > 0.97), k


SENSORS = {
    "load_cell": {"sensitivity": 30.0, "noise": 2e-5},
    "laser": {"sensitivity": 5e3, "resolution": 0.0, "noise": 3e-7},
    "buffer": {"gain": 0.2, "noise": 0.02},
}
SINES = {"kind": "sine_force", "amplitude": 0.03, "frequency": 50.6}


def campaign(folder, shunt, seed, drive=SINES, gate=True, effects=(), records=({},)):
    settings = {
        "sample_rate": 4000.0, "duration": 0.2, "seed": seed, "nominal_error": 0.03,
        "channels": ["displacement", "voltage", *["gate"] * gate], **SENSORS, "records": list(records),
        "effects": dict(effects),
    }  # fmt: skip
    tables = {"transducer": BENCH, "excitation": drive, "shunts": [shunt], "bench": settings}
    path = write_campaign(measure(study_from(tables, Path("study.toml"))), Path(folder) / "campaign")
    return load_campaign(path)


def errors(found):
    """Errors of the identified values in standard errors."""
    return {e.parameter.name: (e.value - BENCH[e.parameter.name]) / e.std for e in found.estimates if e.std is not None}


def test_values_behind_a_switch_that_is_late(tmp_path):
    """The places of the edges within their samples are fitted: standard errors hold with a logic signal, too."""
    records = ({}, {"excitation": {"frequency": 49.5, "amplitude": 0.04}})
    late = {"switch_delay": {"time_lag": LATE}}
    found = identify(campaign(tmp_path, CIRCUITS["parallel_sshi"], 3, effects=late, records=records))
    off = errors(found)
    assert found.converged and set(off) == set(BENCH)
    assert max(map(abs, off.values())) < 3.0, off


# Two tones let the displacement turn twice in a period, at some times just so: the nominal model, three per cent off,
# switches at other extrema than the specimen.
TONES = {
    "kind": "multisine", "duration": 0.2,
    "amplitudes": [0.03, 0.25], "frequencies": [45.0, 140.0], "phases": [0.0, 1.0],
}  # fmt: skip
SSDI = {"kind": "ssdi", **COIL, "hold_off": 2e-3}


@pytest.mark.parametrize("gate", [True, False], ids=["gate", "detector"])
def test_a_switch_that_jumps_to_another_extremum_does_not_break_the_fit(tmp_path, gate):
    read = campaign(tmp_path, SSDI, 2, TONES, gate)
    nominal = {name: float(getattr(read.transducer, name)) for name in BENCH}
    counts = [len(waves(TONES, SSDI, table, length=0.2, rate=4000.0).pulses) for table in (BENCH, nominal)]
    assert counts[0] != counts[1]
    found = identify(read)
    off = errors(found)
    assert found.converged and set(off) == set(BENCH)
    assert max(map(abs, off.values())) < 3.0, off
    (record,) = found.records
    assert all(rms < 1.1 * record.quality.noise[name] for name, rms in record.quality.rms.items())
