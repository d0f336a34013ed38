"""No simulation runs for ever: the work that one may take, and Ctrl-C while compiled code runs."""

import os
import subprocess
import time

import pytest
from studies import LOOP, bench, objects, solve

from piezoharvest.engine.budget import Budget
from piezoharvest.engine.lower import lower
from piezoharvest.engine.simulation import search
from piezoharvest.engine.steady import EngineError, check
from piezoharvest.engine.transient import Machine

RECTIFIER = {"kind": "rectifier", "smoothing_capacitance": 1e-6, "load_resistance": 1e6}
STIFFENING = {"effects": {"stiffening": {"cubic_stiffness": 1e5}}}
RANDOM = {"kind": "random_force", "psd": 1e-6, "band": [40.0, 2e3], "duration": 20.0, "seed": 1}


@pytest.mark.parametrize("shunt", [RECTIFIER, {**RECTIFIER, **LOOP, "kind": "parallel_sshi"}])
@pytest.mark.parametrize("transducer", [{}, STIFFENING], ids=["plain", "stiffening"])
def test_work_beyond_the_budget_ends_a_run_and_a_search(shunt, transducer):
    system, excitation = objects(bench(shunt, **transducer))
    lowered = lower(system, excitation)._replace(budget=Budget(2_000_000))
    machine = Machine(lowered)
    with pytest.raises(EngineError, match="multiplications"):
        check(machine.run(machine.state(), 1e5 * excitation.period))
    assert lowered.budget.left <= 0
    with pytest.raises(EngineError, match="multiplications"):
        search(lowered._replace(budget=Budget(200_000)), excitation)


def test_samples_of_a_record_count_as_work():
    system, excitation = objects(bench({"kind": "resistor", "resistance": 1e5}, RANDOM))
    lowered = lower(system, excitation, excitation.length)._replace(budget=Budget(2_000_000))
    machine = Machine(lowered)
    with pytest.raises(EngineError, match="multiplications"):
        check(machine.run(machine.state(), excitation.length))


def test_ordinary_simulation_takes_a_small_part_of_the_budget():
    system, excitation = objects(bench(RECTIFIER))
    lowered = lower(system, excitation)
    search(lowered, excitation)
    assert 0.99 * Budget().left < lowered.budget.left < Budget().left


@pytest.fixture
def ctrl_c():
    """Send SIGINT to this process half a second from now, from outside: compiled code keeps other threads waiting."""
    sender = subprocess.Popen(["sh", "-c", f"sleep 0.5; kill -INT {os.getpid()}"])
    yield
    sender.wait()


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_ends_a_long_run_at_once():
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        solve(bench(RECTIFIER), transient=1e6)
    assert time.monotonic() - begin < 3.0
