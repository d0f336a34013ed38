"""No simulation runs for ever: the work that one may take, and Ctrl-C while compiled code runs."""

import os
import signal
import subprocess
import time
import tracemalloc

import numpy as np
import pytest
from studies import DRIVE, LOOP, SECOND, STOPS, bench, objects, solve

from piezoharvest.description.excitation import Record
from piezoharvest.description.limits import check_size
from piezoharvest.description.parameters import ParameterError
from piezoharvest.engine import simulate
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.memory.tables import MAX_NUMBERS
from piezoharvest.engine.run import Machine
from piezoharvest.engine.simulation import search
from piezoharvest.engine.steady_search import EngineError, check
from piezoharvest.engine.work_limit import PERIOD_WORK, SAMPLE_WORK, Budget

RECTIFIER = {"kind": "rectifier", "smoothing_capacitance": 1e-6, "load_resistance": 1e6}
STIFFENING = {"effects": {"stiffening": {"cubic_stiffness": 1e5}}}
RANDOM = {"kind": "random_force", "psd": 1e-6, "band": [40.0, 2e3], "duration": 20.0, "seed": 1}
TONES = {"amplitudes": [1e-3] * 3000, "frequencies": [float(k) for k in range(1, 3001)], "phases": [0.0] * 3000}


@pytest.mark.parametrize("shunt", [RECTIFIER, {**RECTIFIER, **LOOP, "kind": "parallel_sshi"}])
@pytest.mark.parametrize("transducer", [{}, STIFFENING], ids=["plain", "stiffening"])
def test_work_beyond_the_budget_ends_a_run_and_a_search(shunt, transducer):
    system, excitation = objects(bench(shunt, **transducer))
    lowered = lower(system, excitation)._replace(budget=Budget(2_000_000))
    machine = Machine(lowered)
    with pytest.raises(EngineError, match="units of work"):
        check(machine.run(machine.state(), 1e5 * excitation.period))
    assert lowered.budget.left <= 0
    with pytest.raises(EngineError, match="units of work"):
        search(lowered._replace(budget=Budget(200_000)), excitation)


def test_samples_of_a_record_count_as_work():
    system, excitation = objects(bench({"kind": "resistor", "resistance": 1e5}, RANDOM))
    lowered = lower(system, excitation, excitation.length)._replace(budget=Budget(2_000_000))
    machine = Machine(lowered)
    with pytest.raises(EngineError, match="units of work"):
        check(machine.run(machine.state(), excitation.length))


def test_a_signal_of_many_samples_may_take_more_work():
    """A record of a day is long, but ends; so does a transient, not the search for a steady state."""
    for table, length, more in (
        (RANDOM, 1.0, 640_000 * SAMPLE_WORK), (DRIVE, None, 0), (DRIVE, 10.0, 506 * PERIOD_WORK),
    ):  # fmt: skip
        system, excitation = objects(bench({"kind": "resistor", "resistance": 1e5}, table))
        assert lower(system, excitation, length).budget.left - Budget().left == more


def test_a_supply_is_charged_for_as_long_as_is_asked_for():
    """It ended after some six minutes, whose work was that of a whole simulation."""
    shunt = {"kind": "rectifier", "smoothing_capacitance": 1e-4, "diode_drop": 0.5, "diode_resistance": 10.0}
    shunt["storage"] = {"turn_on": 5.0, "turn_off": 3.6, "power": 1e-6, "efficiency": 0.85}
    shunt["storage"]["phases"] = [{"power": 2e-3, "duration": 0.05, "sends": True}, {"power": 1e-5, "duration": 5.0}]
    response = solve(bench(shunt), transient=1000.0, samples=1, attenuation=False)
    assert response.converged, response.message
    assert abs(response.energy["closure"]) < 1e-10
    wakes = response.wakes_per_hour
    assert wakes is not None
    assert wakes >= 1


def test_a_recorded_day_is_not_too_long(monkeypatch):
    values = np.zeros(2)
    monkeypatch.setattr(Record, "_read", lambda self: values)
    transducer = objects(bench({"kind": "open"}))[0].transducer
    record = Record(file="day.npz", column="force", sample_rate=500.0)
    for hours, allowed in ((24, True), (60, False)):
        object.__setattr__(record, "values", np.broadcast_to(0.0, hours * 3600 * 500))
        if allowed:
            check_size(transducer, record)
        else:
            with pytest.raises(ParameterError, match=r"1\.08e\+08 samples, allowed are up to 100000000"):
                check_size(transducer, record)


def test_ordinary_simulation_takes_a_small_part_of_the_budget():
    system, excitation = objects(bench(RECTIFIER))
    lowered = lower(system, excitation)
    search(lowered, excitation)
    assert 0.99 * Budget().left < lowered.budget.left < Budget().left


@pytest.fixture
def ctrl_c():
    """Send SIGINT to this process soon, from outside: compiled code keeps other threads waiting."""
    # A shell ignores SIGINT for what it starts in the background, and Python leaves it so.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    sender = subprocess.Popen(["sh", "-c", f"sleep 0.3; kill -INT {os.getpid()}"])
    yield
    sender.wait()
    signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_ends_a_long_run_at_once():
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        solve(bench({**RECTIFIER, **LOOP, "kind": "parallel_sshi"}, hysteresis=STOPS), transient=7e3)
    assert time.monotonic() - begin < 3.0


@pytest.mark.parametrize(
    ("excitation", "transducer", "words"),
    [
        ({**RANDOM, "duration": 1e8}, {}, "3.2e\\+12 samples.*10000000"),
        ({"kind": "multisine", **TONES, "duration": 1.0}, {}, "3000 tones.*100"),
        (DRIVE, {"hysteresis": {"thresholds": list(range(1, 2001)), "weights": [1.0] * 2000}}, "2000 thresholds.*50"),
        (DRIVE, {"modes": [SECOND] * 60}, "60 modes.*50"),
    ],
    ids=["samples", "tones", "stops", "modes"],
)
def test_too_much_of_something_is_refused_before_memory_is_taken(excitation, transducer, words):
    system, drive = objects(bench({"kind": "resistor", "resistance": 1e5}, excitation, **transducer))
    tracemalloc.start()
    try:
        with pytest.raises(ParameterError, match=words):
            simulate(system, drive)
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def test_transient_of_too_many_periods_is_refused():
    with pytest.raises(ParameterError, match=r"5.06e\+13 periods in 1e\+12 s"):
        solve(bench(RECTIFIER), transient=1e12)


@pytest.mark.parametrize(
    ("excitation", "transducer"),
    [
        ({"kind": "multisine", **{key: values[:100] for key, values in TONES.items()}, "duration": 1.0}, {}),
        (DRIVE, {"hysteresis": {"thresholds": [1e-7 * k for k in range(1, 51)], "weights": [2e4] * 50}}),
        (DRIVE, {"modes": [{**SECOND, "stiffness": 4e4 * k} for k in range(1, 51)]}),
    ],
    ids=["tones", "stops", "modes"],
)
def test_as_much_as_is_allowed_is_simulated_in_bounded_memory(excitation, transducer):
    system, drive = objects(bench({"kind": "resistor", "resistance": 1e5}, excitation, **transducer))
    response = simulate(system, drive)
    assert response.converged, response.message
    machine = Machine(lower(system, drive), ledger=True)
    assert machine.P.nbytes < 1.1 * 8 * MAX_NUMBERS


def test_tables_of_one_mode_at_a_time_give_the_same(monkeypatch):
    study = bench({**RECTIFIER, **LOOP, "kind": "parallel_sshi"}, hysteresis=STOPS)
    wanted = solve(study)
    monkeypatch.setattr("piezoharvest.engine.memory.tables.MAX_NUMBERS", 1)
    found = solve(study)
    assert found.events_per_period == wanted.events_per_period
    assert found.harvested_power == pytest.approx(wanted.harvested_power, rel=1e-9)


def test_attenuation_that_is_missing_is_explained(monkeypatch):
    nothing = solve(bench(RECTIFIER, {**DRIVE, "amplitude": 0.0}))
    assert np.isnan(nothing.attenuation_db)
    assert "no attenuation: nothing moves" in nothing.message
    wrong = {"energy does not close": True}
    monkeypatch.setattr("piezoharvest.engine.simulation.faults", lambda *_, **__: wrong)
    doubtful = solve(bench(RECTIFIER, {**DRIVE, "amplitude": 0.0312}))
    assert np.isnan(doubtful.attenuation_db)
    assert "with shorted electrodes it is not to be trusted (energy does not close" in doubtful.message


def test_response_says_that_it_was_given_up(monkeypatch):
    monkeypatch.setattr(Budget.__init__, "__defaults__", (100_000, None))
    response = solve(bench({**RECTIFIER, **LOOP, "kind": "parallel_sshi"}, {**DRIVE, "amplitude": 0.0313}))
    assert response.exhausted
    assert not response.converged
    assert "units of work" in response.message
