"""Values read off records before a fit: against closed forms, and on the bench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify.identify_runs import LINEAR, STACK, campaign_file
from scipy.integrate import solve_ivp
from selection import with_slow

from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.shunts import Resistor
from piezoharvest.identify.fitting.data import data_of
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.start_values import initial_estimates as module
from piezoharvest.identify.start_values.initial_estimates import drive_steps, estimate_initial_values, free_capacitance
from piezoharvest.identify.start_values.multistart import _nearest_model
from piezoharvest.records import load_campaign
from piezoharvest.records.record import FrequencyRecord, Record, Signal
from piezoharvest.study import build_transducer

RATE = 1000.0
TIMES = np.arange(int(8 * RATE)) / RATE


def stepped(transducer, resistance, leakage=np.inf, channels=("displacement", "voltage"), rise=0.02):
    """Record of a force that is held, released in `rise` seconds and held: V' from scipy, inertia left out."""
    force = np.interp(TIMES, [4.0, 4.0 + rise], [1000.0, 100.0])
    free = transducer.capacitance + transducer.coupling**2 / transducer.stiffness
    conductance = 1.0 / resistance + 1.0 / leakage

    def rate(t, v):
        pushed = -900.0 / rise if 4.0 <= t < 4.0 + rise else 0.0
        return -(conductance * v + transducer.coupling / transducer.stiffness * pushed) / free

    voltage = solve_ivp(rate, (0, TIMES[-1]), [0.0], t_eval=TIMES, max_step=0.01, rtol=1e-8, atol=1e-10).y[0]
    signals = {"force": force, "voltage": voltage}
    signals["displacement"] = (force + transducer.coupling * voltage) / transducer.stiffness
    kept = {name: Signal(signals[name], None, "step.csv", name, 2) for name in ("force", *channels)}
    time = Signal(TIMES, None, "step.csv", "time_s", 2)
    record = Record("step.csv", "records.0", "fit", "force", Resistor(resistance=resistance), 0.0, time, kept)
    return data_of(record, transducer)


TRUTH = build_transducer(LINEAR)
NOMINAL = replace(TRUTH, stiffness=1.3 * TRUTH.stiffness, coupling=0.75 * TRUTH.coupling,
                  capacitance=1.25 * TRUTH.capacitance)  # fmt: skip
FREE = TRUTH.capacitance + TRUTH.coupling**2 / TRUTH.stiffness


def test_the_decay_after_a_step_has_the_time_constant_of_load_and_free_capacitance():
    (step,) = drive_steps(stepped(TRUTH, 51.43e3))
    assert 1.0 / step.decay_rate == pytest.approx(51.43e3 * FREE, rel=1e-3)
    assert step.force == pytest.approx(-900.0)


def test_the_decays_of_several_loads_tell_a_leakage_from_the_capacitance():
    loads = (51.43e3, 97.78e3, 143.8e3)
    steps = [step for load in loads for step in drive_steps(stepped(TRUTH, load, leakage=3e5))]
    assert free_capacitance(steps) == pytest.approx(FREE, rel=2e-3)
    # One load alone cannot tell them apart.
    assert free_capacitance(steps[:1]) == pytest.approx(FREE / (1 + 51.43e3 / 3e5), rel=2e-3)


def test_the_peak_of_the_voltage_has_the_ratio_of_coupling_to_capacitance(monkeypatch):
    monkeypatch.setattr(module, "with_charge_loops", lambda records, found: found)
    found = estimate_initial_values([stepped(TRUTH, 97.78e3)], NOMINAL)
    for name in ("stiffness", "coupling", "capacitance"):
        assert getattr(found, name) == pytest.approx(getattr(TRUTH, name), rel=0.01)


def test_without_displacement_the_peak_is_that_over_the_nominal_stiffness(monkeypatch):
    monkeypatch.setattr(module, "with_charge_loops", lambda records, found: found)
    nominal = replace(NOMINAL, stiffness=TRUTH.stiffness)
    found = estimate_initial_values([stepped(TRUTH, 97.78e3, channels=("voltage",))], nominal)
    assert found.coupling == pytest.approx(TRUTH.coupling, rel=0.01)
    assert found.capacitance == pytest.approx(TRUTH.capacitance, rel=0.01)
    assert found.stiffness == nominal.stiffness


@pytest.mark.parametrize("mechanical", ["free", "blocked"])
def test_an_impedance_below_the_resonance_has_the_capacitance(mechanical):
    frequency = np.geomspace(1.0, 1e4, 50)
    s = 2j * np.pi * frequency
    moving = TRUTH.coupling**2 / (TRUTH.stiffness + s * TRUTH.damping + s**2 * TRUTH.mass)
    response = 1.0 / (s * (TRUTH.capacitance + moving * (mechanical == "free")))
    record = FrequencyRecord("z.csv", "records.0", "fit", "impedance", "current", "voltage", None, mechanical, 0.0,
                             frequency, response, None, {}, 2)  # fmt: skip
    found = estimate_initial_values([FrequencyData(record)], replace(TRUTH, capacitance=1.25 * TRUTH.capacitance))
    assert found.capacitance == pytest.approx(TRUTH.capacitance, rel=1e-2)
    assert found.coupling == TRUTH.coupling


@pytest.mark.parametrize("seed", with_slow([1, 2, 3, 4], slow=lambda seed: seed > 2))
def test_bench_records_tell_values_that_are_30_percent_off(tmp_path, seed):
    """The smallest threshold, which hardly shows, is left to the fit."""
    path, truth = campaign_file(tmp_path, seed)
    records = [data_of(record, build_transducer(STACK)) for record in load_campaign(path).of_role("fit")]
    found = estimate_initial_values(records, build_transducer(STACK))
    for name, within in (("stiffness", 0.01), ("capacitance", 0.03), ("coupling", 0.03)):
        assert getattr(found, name) == pytest.approx(getattr(truth, name), rel=within)
    assert found.hysteresis.thresholds[2] == pytest.approx(truth.hysteresis.thresholds[2], rel=0.1)
    assert found.hysteresis.stiffness == pytest.approx(truth.hysteresis.stiffness, rel=0.15)


def test_what_records_do_not_show_stays_nominal(tmp_path):
    path, _ = campaign_file(tmp_path, 1)
    record = load_campaign(path).of_role("fit")[0]
    alone = replace(record, signals={name: record.signals[name] for name in ("force", "displacement")})
    nominal = build_transducer(STACK)
    found = estimate_initial_values([data_of(alone, nominal)], nominal)
    assert replace(found, stiffness=nominal.stiffness) == nominal
    assert found.stiffness != nominal.stiffness
    assert estimate_initial_values([], nominal) == nominal


def test_thresholds_that_loops_tell_wrongly_are_not_started_from(tmp_path):
    """What another effect makes of a loop may look like an operator that never slips; the rest may be told well."""
    path, truth = campaign_file(tmp_path, 1)
    nominal = build_transducer(STACK)
    problem = Problem([data_of(each, nominal) for each in load_campaign(path).of_role("fit")], nominal, ())
    wrong = Hysteresis(thresholds=(7e-8, 3.2e-7, 5.7e-6), weights=(5.5e5, 1.87e6, 2.7e4))
    told = Model(replace(truth, hysteresis=wrong), (), ())
    found = _nearest_model(problem, replace(told, transducer=nominal), told)
    assert found.transducer == replace(truth, hysteresis=nominal.hysteresis)
    right = replace(told, transducer=truth)
    assert _nearest_model(problem, replace(told, transducer=nominal), right) is right
