"""Records behind diodes and switches, made by the virtual bench, whose solver shares nothing with the engine."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from piezoharvest.bench import measure, write_campaign
from piezoharvest.description.effects.nameless.forms import Monomial
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import Capacitor, Coupling
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose import diagnose
from piezoharvest.identify import growing_fit, identify
from piezoharvest.identify.fitting.data import data_of
from piezoharvest.identify.fitting.levenberg_marquardt import GIVEN_UP
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.start_values import quasi_static
from piezoharvest.identify.start_values.multistart import fit_multistart
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.records import CampaignError, load_campaign
from piezoharvest.study import study_from

BENCH = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
DC = {"smoothing_capacitance": 1e-6, "load_resistance": 3e5, "diode_drop": 0.3}
RECTIFIER = {"kind": "rectifier", **DC}
SSHI = {"kind": "parallel_sshi", "inductance": 0.5, "quality": 8.0, **DC}
SENSORS = {
    "load_cell": {"sensitivity": 100.0, "noise": 2e-5},
    "laser": {"sensitivity": 5e3, "resolution": 0.0, "noise": 3e-7},
    "buffer": {"gain": 0.2, "noise": 0.02},
    "dc_meter": {"gain": 0.2, "noise": 0.02},
}
RECORDS = [
    {},
    {"excitation": {"frequency": 49.5, "amplitude": 0.04}},
    {"excitation": {"frequency": 51.7}},
    {"excitation": {"frequency": 50.1}, "role": "validate"},
]


def campaign(
    folder, shunt, seed, effects=(), fit=(), duration=0.4, channels=("displacement", "voltage"), records=RECORDS,
    more=None,
):  # fmt: skip
    """Campaign with a hidden effect, whose nominal values are three per cent off."""
    bench = {
        "sample_rate": 4000.0, "duration": duration, "seed": seed, "nominal_error": 0.03, "channels": list(channels),
        **SENSORS, **(more or {}), "records": records, "effects": dict(effects),
    }  # fmt: skip
    drive = {"kind": "sine_force", "amplitude": 0.03, "frequency": 50.6}
    tables = {"transducer": BENCH, "excitation": drive, "shunts": [shunt], "bench": bench}
    path = write_campaign(measure(study_from(tables, Path("study.toml"))), Path(folder) / "campaign")
    if fit:
        names = ", ".join(f'"{name}"' for name in fit)
        kind = f'kind = "{shunt["kind"]}"'
        path.write_text(path.read_text().replace(kind, f"{kind}\nfit = [{names}]"))
    return load_campaign(path)


def check_values(found, true):
    """Identified values within four standard errors of the true ones, and standard errors that say something."""
    for estimate in found.estimates:
        if estimate.parameter.name in true:
            value = true[estimate.parameter.name]
            assert estimate.std is not None and estimate.std < 0.1 * abs(value), estimate
            assert abs(estimate.value - value) < 4.0 * estimate.std, estimate


def test_a_rectifier(tmp_path):
    """With the voltage of its smoothing capacitor, whose capacitance is fitted."""
    channels = ("displacement", "voltage", "dc_voltage")
    found = identify(campaign(tmp_path, RECTIFIER, 1, fit=["smoothing_capacitance"], duration=0.25, channels=channels))
    assert found.converged and not found.warnings
    check_values(found, {**BENCH, "rectifier.smoothing_capacitance": 1e-6})


@pytest.mark.slow
def test_a_smoothing_capacitor_that_is_charged_at_the_first_sample(tmp_path):
    """To a fifth of its last value, as the start of each run is thrown away; no channel shows it."""
    whole = campaign(tmp_path, RECTIFIER, 41, duration=0.35, records=RECORDS[:2])
    for file in whole.path.parent.glob("*.csv"):
        head, *rows = file.read_text().splitlines(keepends=True)
        file.write_text(head + "".join(rows[400:]))
    found = identify(load_campaign(whole.path))
    assert found.converged and not found.warnings
    check_values(found, BENCH)
    assert all(record.own["start dc"] > 0.05 for record in found.records)


def test_a_velocity_in_the_place_of_the_displacement(tmp_path):
    records = RECORDS[:2]
    sensors = ("velocity", "voltage")
    found = identify(campaign(tmp_path, RECTIFIER, 2, duration=0.25, channels=sensors, records=records))
    check_values(found, BENCH)


def test_a_loop_that_is_worse_than_its_label(tmp_path):
    hidden = {"inversion_loss": {"quality": 5.5}}
    found = identify(campaign(tmp_path, SSHI, 3, hidden, fit=["quality"], duration=0.25, records=RECORDS[:2]))
    check_values(found, {**BENCH, "parallel_sshi.quality": 5.5})


def assert_jumps_of_the_misfit_are_explained(told):
    """From one iteration to the next the misfit grows only where a message between them says why."""
    last = None
    for text in told:
        found = re.fullmatch(r"iteration \d+: misfit \(-2 ln L\) (\S+)", text)
        assert not (found and last is not None and float(found[1]) > last * (1 + 1e-5) + 1e-3), text
        last = float(found[1]) if found else None


def test_a_first_fit_away_from_the_jumps_of_the_voltage(tmp_path):
    """With the samples beside them the first fit ends in another minimum here."""
    told = []
    found = identify(campaign(tmp_path, SSHI, 4, fit=["quality"], records=RECORDS[:3]), progress=told.append)
    assert "start: fit away from the jumps of voltage and current" in told
    assert "samples beside the jumps, too: the misfit is that of more samples" in told
    assert "longer parts of the records: the misfit is that of more samples" in told
    assert "another start: circuits with their nominal values" not in told
    assert_jumps_of_the_misfit_are_explained(told)
    assert not found.warnings
    check_values(found, {**BENCH, "parallel_sshi.quality": 8.0})


def test_a_current_that_jumps_as_diodes_begin_to_conduct(tmp_path):
    """With the samples beside the jumps in the first fit, the coupling ends thirteen standard errors off here."""
    told = []
    sensors, small = ("displacement", "voltage", "current", "dc_voltage"), {"gain": 100.0, "noise": 3e-8}
    measured = campaign(tmp_path, RECTIFIER, 5, channels=sensors, records=RECORDS[:3], more={"current_sense": small})
    found = identify(measured, progress=told.append)
    assert "start: fit away from the jumps of voltage and current" in told
    check_values(found, BENCH)


def test_a_jump_on_the_other_side_of_a_sample(tmp_path):
    """Without realisations with more noise one sample of 500 times the noise takes the coupling five errors off."""
    bench = {
        "sample_rate": 3000.0, "duration": 0.8, "seed": 5, "nominal_error": 0.04,
        "channels": ["displacement", "voltage", "current", "dc_voltage"],
        "load_cell": {"sensitivity": 10.0, "noise": 2e-4},
        "laser": {"sensitivity": 2e4, "noise": 2.5e-7, "resolution": 0.0},
        "buffer": {"gain": 0.3, "noise": 0.005}, "current_sense": {"gain": 100.0, "noise": 3e-8},
        "records": [{}, {"excitation": {"amplitude": 0.3}}, {"excitation": {"frequency": 50.5}}],
    }  # fmt: skip
    device = {"mass": 0.0097, "damping": 0.112, "stiffness": 891.4, "coupling": 8.24e-4, "capacitance": 37.1e-9}
    circuit = {**RECTIFIER, "load_resistance": 250e3, "diode_drop": 0.25}
    drive = {"kind": "sine_base", "amplitude": 0.6, "frequency": 47.0}
    tables = {"title": "base", "transducer": device, "excitation": drive, "shunts": [circuit], "bench": bench}
    found = identify(load_campaign(write_campaign(measure(study_from(tables, Path("study.toml"))), tmp_path / "c")))
    check_values(found, device)


@pytest.mark.slow
def test_a_second_start_with_the_circuit_as_its_label_says(tmp_path, monkeypatch):
    """Without the above."""
    monkeypatch.setattr(growing_fit, "fit_past_jumps", fit_multistart)
    told = []
    found = identify(campaign(tmp_path, SSHI, 4, fit=["quality"], records=RECORDS[:3]), progress=told.append)
    assert "another start: circuits with their nominal values" in told
    assert not found.warnings
    check_values(found, {**BENCH, "parallel_sshi.quality": 8.0})


HIDDEN = {
    "inversion_loss": {"quality": 5.5}, "switch_delay": {"time_lag": 1e-4}, "diode_drop_error": {"diode_drop": 0.6},
    "on_time_offset": {"on_time_error": 0.25}, "reverse_leakage": {"conductance": 3e-7},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", HIDDEN)
def test_a_hidden_effect_of_the_circuit_is_named(tmp_path, name):
    found = diagnose(campaign(tmp_path, SSHI, 10, {name: HIDDEN[name]}, duration=0.5))
    assert [effect.effect.name for effect in found.effects] == [name]
    ((field, true),) = HIDDEN[name].items()
    assert getattr(found.effects[0].effect, field) == pytest.approx(true, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_healthy_circuits_raise_no_alarm(tmp_path, seed):
    assert diagnose(campaign(tmp_path, SSHI, 20 + seed, duration=0.5)).verdict == "adequate"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ('fit = ["quality"]', r"records\.0\.shunt\.fit: found 'quality', allowed are the numbers of this rectifier"),
        ("fit = 3", r"records\.0\.shunt\.fit: found 3, must be a list"),
    ],
)
def test_bad_keys_of_what_is_fitted(tmp_path, change, message):
    found = campaign(tmp_path, RECTIFIER, 1, duration=0.01, records=RECORDS[:1])
    text = found.path.read_text().replace('kind = "rectifier"', f'kind = "rectifier"\n{change}')
    found.path.write_text(text)
    with pytest.raises(CampaignError, match=message):
        load_campaign(found.path)


@pytest.mark.parametrize(
    ("timing", "message"),
    [
        ("phase_lag = 0.1", r"records\.0\.shunt\.phase_lag: found 0\.1 for an excitation without a frequency"),
        ("time_lag = -1e-4", r"records\.0\.shunt\.time_lag: found -0\.0001 s, must be early"),
    ],
)
def test_timing_that_needs_a_frequency(tmp_path, timing, message):
    found = campaign(tmp_path, SSHI, 1, duration=0.05, records=RECORDS[:1])
    key = timing.split()[0]
    found.path.write_text(found.path.read_text().replace(f"{key} = 0.0", timing))
    with pytest.raises(CampaignError, match=message):
        identify(load_campaign(found.path))


def test_the_hold_off_that_a_study_takes_from_its_drive_is_written(tmp_path):
    """A quarter of the period of each record's sine; samples of a drive have none."""
    circuit = {"kind": "ssdi", "inductance": 0.5, "quality": 8.0}
    read = load_campaign(campaign(tmp_path, circuit, 1, duration=0.01, records=RECORDS[:2]).path)
    assert [record.shunt.hold_off for record in read.records] == pytest.approx([0.25 / 50.6, 0.25 / 49.5])


def test_a_record_that_begins_at_rest_begins_at_rest(tmp_path):
    """Its first samples are noise, out of which no velocity is made; later ones have a start of their own."""
    (record, *_) = campaign(tmp_path, SSHI, 1, duration=0.1, records=RECORDS[:1]).records
    device = Transducer(**BENCH)
    assert data_of(record, device).start == {}
    late = replace(record, time=cut(record.time), signals={name: cut(s) for name, s in record.signals.items()})
    assert {"start x1", "start u1", "start q"} <= set(data_of(late, device).start)


@pytest.mark.parametrize("force", [-1e-6, 1e-6])
@pytest.mark.parametrize("shunt", [SSHI, RECTIFIER])
def test_ideal_diodes_at_rest(tmp_path, shunt, force):
    """Nothing keeps the electrodes apart from an empty capacitor, and noise of the force says which way they go."""
    (record, *_) = campaign(tmp_path, {**shunt, "diode_drop": 0.0}, 1, duration=0.1, records=RECORDS[:1]).records
    first = np.append(force, record["force"][1:])
    begun = replace(record, signals={**record.signals, "force": replace(record.signals["force"], values=first)})
    data = data_of(begun, Transducer(**BENCH))
    assert data.start == {}
    predicted = CircuitPrediction(Transducer(**BENCH), data.setting)
    (block,) = predicted.blocks(derivatives=False, channels=["voltage"])
    voltage = block.values[:, 0]
    assert np.sqrt(np.mean((voltage - record["voltage"]) ** 2)) < 0.02 * np.ptp(record["voltage"])


@pytest.mark.parametrize("law", [Capacitor(), Coupling()], ids=lambda place: place.name)
def test_electrodes_beyond_ideal_diodes_are_discharged_beside_a_law_of_the_transducer(tmp_path, law):
    """Its output is a part of the voltage that the diodes hold; without it they seemed to hold none."""
    shunt = {**RECTIFIER, "diode_drop": 0.0}
    (record, *_) = campaign(tmp_path, shunt, 1, duration=0.02, records=RECORDS[:1]).records
    data = data_of(record, Transducer(**BENCH))
    size = 1e-3 * (BENCH["capacitance"] if law.name == "capacitor" else BENCH["coupling"])
    form = Monomial(factor=size, scale=1.0 if law.name == "capacitor" else 1e-3, exponent=3)
    beside = Transducer(**BENCH, effects=(Law(place=law, form=form),))
    plain = CircuitPrediction(Transducer(**BENCH), data.setting)
    charged = np.where(np.isin(plain.nuisance_names, ["start q"]), 1.0, 0.0)
    assert charged.any()
    voltages = []
    for each in (Transducer(**BENCH), beside):
        (block,) = CircuitPrediction(each, data.setting, nuisance=charged).blocks(
            derivatives=False, channels=["voltage"]
        )
        voltages.append(block.values)
    assert np.abs(voltages[1] - voltages[0]).max() < 0.01 * np.ptp(voltages[0])


def cut(signal):
    """A channel without its first 100 samples."""
    return replace(signal, values=signal.values[100:])


def test_a_gate_that_never_opens_is_read_and_not_used(tmp_path):
    found = campaign(tmp_path, RECTIFIER, 1, duration=0.05, records=RECORDS[:1])
    (file,) = found.path.parent.glob("*.csv")
    head, *rows = file.read_text().splitlines()
    file.write_text("\n".join([f"{head},gate", *(f"{row},0" for row in rows)]) + "\n")
    (finding,) = load_campaign(found.path).findings[0]
    assert (finding.severity, finding.check, finding.channel) == ("warning", "unused", "gate")


def test_a_force_beside_an_imposed_voltage_is_not_used(tmp_path):
    found = campaign(tmp_path, RECTIFIER, 1, duration=0.1, records=RECORDS[:1])
    found.path.write_text(found.path.read_text().replace('drive = "force"', 'drive = "voltage"'))
    read = load_campaign(found.path)
    assert [finding.channel for finding in read.findings[0] if finding.check == "unused"] == ["force"]
    assert set(identify(read).records[0].quality.rms) == {"displacement"}


def test_a_channel_of_a_dc_side_that_is_not_there(tmp_path):
    channels = ("displacement", "dc_voltage")
    found = campaign(tmp_path, RECTIFIER, 1, duration=0.05, channels=channels, records=RECORDS[:1])
    text = found.path.read_text()
    head, _ = text.split("[records.shunt]")
    found.path.write_text(head + '[records.shunt]\nkind = "resistor"\nresistance = 1e5\n')
    with pytest.raises(CampaignError, match="found a channel dc_voltage behind resistor"):
        identify(load_campaign(found.path))


def test_the_quasi_static_specimen_is_given_up_where_it_will_leave_more(tmp_path, monkeypatch):
    """Of a beam at its resonance it cannot be as good: its fit took most of the time of an identification."""
    ends = []

    def fitted(*arguments, **options):
        found = fit(*arguments, **options)
        ends.append(found.message)
        return found

    before = identify(campaign(tmp_path, RECTIFIER, 1, duration=0.2))
    monkeypatch.setattr(quasi_static, "fit", fitted)
    problem = Problem(prepared(before.campaign, "fit"), before.campaign.transducer, before.offsets)
    still = quasi_static.as_quasi_static(before.campaign.transducer)
    slow = Problem(prepared(replace(before.campaign, transducer=still), "fit"), still, before.offsets)
    assert quasi_static.quasi_static_fit(problem, slow, before.found) is None
    assert ends == [GIVEN_UP]
