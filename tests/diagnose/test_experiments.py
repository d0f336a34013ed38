"""Planned records: what is expected of them against fits, limits that are kept, and stories from doubt to name."""

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from diagnose_runs import SIGMA, STACK, fitted

from piezoharvest import progress
from piezoharvest.bench import measure, write_campaign
from piezoharvest.cli import main
from piezoharvest.description.effects import DielectricRelaxation, Leakage
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import Resistor
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.experiments.candidates import Planned, first_look
from piezoharvest.diagnose.experiments.expectation import Bench, Known
from piezoharvest.diagnose.experiments.planning import Planner
from piezoharvest.diagnose.experiments.reach import Reach, highest_frequency, reach_of
from piezoharvest.diagnose.selection.score_tests import effect_parameters, extended
from piezoharvest.identify.fitting.data import data_of
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.records import CampaignError, load_campaign
from piezoharvest.records.bench_limits import BenchLimits
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.record import Record, Signal
from piezoharvest.study import load_study, study_from

LOAD = Resistor(resistance=97.78e3)
SPECIMEN = Transducer(**{**STACK, "damping": 100.0})


def record(frequency, duration, shunt=LOAD):
    """Record with a sine of a force that is known exactly, its responses yet unknown."""
    time = np.arange(int(1000 * duration)) / 1000.0
    columns = {"force": 550 + 450 * np.sin(2 * np.pi * frequency * time), **dict.fromkeys(SIGMA, np.zeros(len(time)))}
    signals = {name: Signal(values, {**SIGMA, "force": 1e-3}[name], "", "", 1) for name, values in columns.items()}
    return Record(f"{frequency} Hz", "records.0", "fit", "force", shunt, 0.0, Signal(time, None, "", "", 1), signals)


@pytest.fixture(scope="module")
def doubt():
    """Fits of a leakage and of a relaxation to fast records of a relaxation, which cannot tell them."""
    data = [data_of(record(frequency, 4.0), SPECIMEN) for frequency in (20.0, 30.0)]
    relaxation = DielectricRelaxation(capacitance=5e-6, time_constant=1.0)
    problem, found, _ = fitted(data, SPECIMEN, [relaxation])
    models = []
    for effect in (Leakage(resistance=1e6), relaxation):
        model = extended(found.model, [effect], effect_parameters([effect]))
        models.append(fit(problem, model, noise=Noise({**SIGMA, "force": 1e-3}), estimate_noise=False))
    return problem, *models


def bench_of(problem):
    reach = Reach("force", (100.0, 1000.0), (0.2, 30.0), 10.0, 1000.0, (LOAD,), tuple(SIGMA), dict.fromkeys(SIGMA, 1e9))
    return Bench(reach, problem.nominal, Noise({**SIGMA, "force": 1e-3}), problem.offset_channels)


@pytest.mark.slow
def test_separation_is_what_a_fit_of_all_records_shows(doubt):
    """The wrong model, fitted to the records so far and to one more of the true model without noise, costs as much."""
    problem, leak, relaxation = doubt
    bench = bench_of(problem)
    planned = Planned(SineForce(amplitude=450.0, offset=550.0, frequency=10.0), LOAD, 0.8, 1000.0)
    expected = bench._noncentrality(planned, Known.of(relaxation), Known.of(leak))
    more = bench.data(planned, relaxation.model)
    assert more is not None
    both = Problem([*problem.data, more], problem.nominal, problem.offset_channels)
    costs = []
    for found in (leak, relaxation):
        begun = (*found.nuisance, np.zeros(len(both.nuisance_names(found.model, more))))
        costs.append(fit(both, found.model, begun, found.noise, estimate_noise=False).cost - found.cost)
    assert costs[1] < 0.01 * costs[0]
    assert expected == pytest.approx(costs[0], rel=0.1)
    assert expected > 20


def test_slow_records_separate_better(doubt):
    problem, leak, relaxation = doubt
    bench, models = bench_of(problem), (Known.of(leak), Known.of(relaxation))
    sines = [
        Planned(SineForce(amplitude=450.0, offset=550.0, frequency=f), LOAD, 3.0, 1000.0) for f in (30.0, 3.0, 0.7)
    ]
    fast, middle, slow = (bench.separation(planned, *models) for planned in sines)
    assert fast < middle < slow and slow > 2 * fast


def test_a_plan_for_a_resistor_leaves_out_the_dc_side_of_other_records(doubt):
    """It ended in an internal error."""
    problem, leak, relaxation = doubt
    plain, models = bench_of(problem), (Known.of(leak), Known.of(relaxation))
    with_bridges = replace(
        plain, reach=replace(plain.reach, channels=(*plain.reach.channels, "dc_voltage", "dc_current"))
    )
    planned = Planned(SineForce(amplitude=450.0, offset=550.0, frequency=3.0), LOAD, 3.0, 1000.0)
    assert with_bridges.separation(planned, *models) == plain.separation(planned, *models)


def test_information_is_that_of_a_closed_form(doubt):
    """Standard error of a resistance from voltage and current alone: they are known to their noise over sqrt(n)."""
    problem, leak, _ = doubt
    bench, known = bench_of(problem), Known.of(leak)
    planned = Planned(SineForce(amplitude=450.0, offset=550.0, frequency=2.0), LOAD, 2.0, 1000.0)
    longer = replace(planned, duration=8.0)
    one, four = (bench.information(each, known) for each in (planned, longer))
    # Four times as many periods: four times the information, but for the first ones.
    assert np.diag(four) / np.diag(one) == pytest.approx(4.0, rel=0.35)
    assert np.all(known.errors(one) <= known.errors() * (1 + 1e-6))
    assert np.all(known.errors(four) <= known.errors(one) * (1 + 1e-6))


class TestReach:
    def data(self):
        made = [record(20.0, 1.0), record(5.0, 2.0, Resistor(resistance=5e4))]
        found = []
        for each in made:
            voltage = replace(each.signals["voltage"], values=3 * each["force"] / 1e3)
            found.append(data_of(replace(each, signals={**each.signals, "voltage": voltage}), SPECIMEN))
        return found

    def campaign(self, **limits):
        return Campaign("", Path("c.toml"), SPECIMEN, (), (), limits=BenchLimits(**limits))

    def test_records_show_it(self):
        reach = reach_of(self.campaign(), self.data())
        assert reach is not None
        assert reach.span == pytest.approx((100.0, 1000.0), rel=1e-3)
        assert reach.frequency == pytest.approx((0.1, 20.0), rel=0.1)
        assert reach.duration == pytest.approx(20.0, rel=1e-2) and reach.sample_rate == pytest.approx(1000.0)
        assert [shunt.resistance for shunt in reach.shunts] == [97.78e3, 5e4]
        assert reach.largest["voltage"] == pytest.approx(1.05 * 3.0, rel=1e-3)

    def test_the_table_says_otherwise(self):
        limits = {"drive": (0.0, 500.0), "duration": 60.0, "loads": (1e5,), "max_voltage": 2.0, "frequency": (0.5, 4.0)}
        reach = reach_of(self.campaign(**limits), self.data())
        assert reach is not None
        assert (reach.span, reach.duration, reach.frequency) == ((0.0, 500.0), 60.0, (0.5, 4.0))
        assert reach.shunts == (Resistor(resistance=1e5),) and reach.largest["voltage"] == 2.0
        for planned in first_look(reach, SPECIMEN):
            drive = planned.excitation.signal().at(planned.time)
            assert drive.min() >= -1e-9 and drive.max() <= 500.0 + 1e-9
            assert planned.duration <= 60.0 and planned.sample_rate <= 1000.0 * (1 + 1e-9)

    def test_no_excitation_is_an_imposed_displacement(self):
        assert reach_of(self.campaign(), []) is None

    def test_highest_frequency(self):
        time = np.arange(4000) / 1000.0
        tones = np.sin(2 * np.pi * 3.0 * time) + np.sin(2 * np.pi * 40.0 * time)
        assert highest_frequency(5.0 + tones, 1e-3) == pytest.approx(40.0, abs=0.6)

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("drive = [5.0, 1.0]", r"experiment.drive: found \[5.0, 1.0\]"),
            ("loads = []", "experiment.loads: found an empty list"),
            ("durations = 3.0", "experiment.durations: unknown key.*duration"),
        ],
    )
    def test_wrong_tables(self, tmp_path, text, words):
        path = tmp_path / "campaign.toml"
        table = tomli_w.dumps({"transducer": STACK, "records": [{"file": "a.csv", "load_resistance": 1e5}]})
        path.write_text(f"{table}\n[experiment]\n{text}\n")
        write_record(tmp_path / "a.csv")
        with pytest.raises(CampaignError, match=words):
            load_campaign(path)


def write_record(path):
    time = np.arange(400) / 1000.0
    force = 550 + 450 * np.sin(2 * np.pi * 10 * time)
    rows = np.column_stack([time, force, force / 3.125e8])
    np.savetxt(path, rows, delimiter=",", header="time_s,force_N,displacement_m", comments="")


def test_ranges_of_the_sensors_are_kept(doubt):
    problem, leak, relaxation = doubt
    wide = bench_of(problem)
    tight = replace(wide, reach=replace(wide.reach, largest={**wide.reach.largest, "voltage": 2.0}))
    planned = Planned(SineForce(amplitude=450.0, offset=550.0, frequency=3.0), LOAD, 2.0, 1000.0)
    assert tight.data(planned, leak.model) is None
    smaller = tight.fitting(planned, [leak.model, relaxation.model])
    data = tight.data(smaller, leak.model)
    assert data is not None
    assert 1.8 < np.abs(data.record["voltage"]).max() <= 2.0
    assert smaller.excitation.signal().at(smaller.time).min() == pytest.approx(100.0, abs=1.0)


def test_a_parameter_is_told_by_the_record_planned_for_it(doubt, monkeypatch):
    monkeypatch.setattr(progress, "EVERY", 0.0)
    problem, leak, _ = doubt
    limits = BenchLimits(max_displacement=1e-3, max_voltage=100.0, max_current=1e-2)
    campaign = Campaign("", Path("c.toml"), problem.nominal, (), (), limits=limits)
    planner = Planner(campaign, problem, leak)
    names = {p.name: p for p in leak.model.parameters}
    with progress.followed((said := []).append):
        plan = planner.for_parameter(names["effects.0.resistance"])
    assert plan is not None and plan.after < 0.5 * plan.before
    steps = [step for step in said if step.startswith("planning: ")]
    assert all(0 < step.done < step.total and step.line.endswith(" left") for step in steps)
    assert {step.split()[4] for step in steps} == {"records", "variants"}


FAST = [
    {"load_resistance": 97.78e3}, {"load_resistance": 51.43e3, "excitation": {"frequency": 20.0}},
    {"load_resistance": 143.8e3, "excitation": {"frequency": 40.0}},
    {"load_resistance": 97.78e3, "excitation": {"frequency": 25.0}, "role": "validate"},
]  # fmt: skip


def measured(folder, effects, seed):
    """Fast records of a stack, whose effects only the bench knows."""
    tables = {
        "transducer": {**STACK, "damping": 100.0}, "shunts": [{"kind": "resistor", "resistance": 97.78e3}],
        "excitation": {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 30.0},
        "bench": {"duration": 1.0, "seed": seed, "nominal_error": 0.02, "records": FAST, "effects": effects},
    }  # fmt: skip
    return write_campaign(measure(study_from(tables, Path("study.toml"))), folder / "first")


def with_planned(first, study, effects, seed):
    """Campaign with the planned record beside the others, measured on the true specimen."""
    tables = tomllib.loads(study.read_text())
    bench = {**tables["bench"], "seed": seed, "effects": effects}
    tables = {**tables, "transducer": {**STACK, "damping": 100.0}, "bench": bench}
    second = write_campaign(measure(study_from(tables, study)), study.parent / "second")
    old, new = (tomllib.loads(path.read_text()) for path in (first, second))
    for n, entry in enumerate(new["records"]):
        shutil.copy(second.parent / entry["file"], first.parent / f"planned_{n}.csv")
        old["records"].append({**entry, "file": f"planned_{n}.csv", "channels": new["channels"]})
    path = first.parent / "both.toml"
    path.write_text(tomli_w.dumps(old))
    return path


STORIES = [
    ({"dielectric_relaxation": {"capacitance": 5e-7, "time_constant": 1.0}}, 2),
    ({"leakage": {"resistance": 2e6}}, 0),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("effects", "seed"), STORIES)
def test_from_doubt_to_name(tmp_path, capsys, effects, seed):
    """Both times the fast records name the leakage, and cannot tell it from a relaxation."""
    first = measured(tmp_path, effects, seed + 1)
    study = tmp_path / "planned.toml"
    assert main(["diagnose", str(first), "--json"]) == 0
    doubt = json.loads(capsys.readouterr().out)
    assert doubt["verdict"] == "ambiguous" and doubt["effects"][0]["name"] == "leakage"
    assert doubt["alternatives"] == [["dielectric_relaxation"]]
    assert doubt["plan"]["standard_deviations"] > 10
    assert "with leakage and with dielectric relaxation would differ" in doubt["experiment"]
    assert main(["plan", str(first), "--out", str(study)]) == 0
    assert tomllib.loads(study.read_text()) == doubt["plan"]["study"]
    load_study(study)
    found = diagnose(load_campaign(with_planned(first, study, effects, seed + 7)))
    (name, table) = next(iter(effects.items()))
    assert found.verdict == "effect" and [named.effect.name for named in found.effects] == [name]
    for key, (value, std, _) in found.effects[0].values.items():
        assert abs(value - table[key]) < 5 * std
    with pytest.raises(ParameterError, match=r"--parameter: .*did you mean 'stiffness'"):
        found.plan_for("stifness")
    weaker = found.plan_for("coupling")
    assert weaker is not None and weaker.after < weaker.before
