"""Errors do not add up: the state after a hundred periods against the oracle at 1e-12."""

import numpy as np
import pytest
from oracles.reference import simulate as reference
from studies import BENCH, DRIVE, LOOP, bench, objects

from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.run import Machine
from piezoharvest.engine.steady_search import check

PERIODS = 100
SHUNT = {"kind": "parallel_sshi", "smoothing_capacitance": 1e-6, "load_resistance": 1e5, **LOOP}
THREE = {"thresholds": [5e-8, 1e-7, 2e-7], "weights": [5e5, 5e5, 1e6]}


def energy(x, u, q, stops, dc, weights):
    """Stored energy of a state: the square of its energy norm."""
    v = (q - BENCH["coupling"] * x) / BENCH["capacitance"]
    mechanical = BENCH["stiffness"] * x**2 + BENCH["mass"] * u**2
    electrical = BENCH["capacitance"] * v**2 + SHUNT["smoothing_capacitance"] * dc**2
    return 0.5 * (mechanical + electrical + np.dot(weights, np.square(stops)))


@pytest.mark.slow
@pytest.mark.parametrize("hysteresis", [None, THREE], ids=["plain", "three operators"])
def test_state_after_a_hundred_periods(hysteresis):
    study = bench(SHUNT, **({"hysteresis": hysteresis} if hysteresis else {}))
    system, excitation = objects(study)
    wanted = reference(study, 0, periods=PERIODS, samples_per_period=0).final
    lowered = lower(system, excitation)
    machine = Machine(lowered)
    state = machine.state()
    check(machine.run(state, PERIODS / DRIVE["frequency"]))
    n = len(lowered.states)
    found = dict(zip(lowered.states, lowered.program.scale * state.z[:n], strict=True))
    stops = [found[f"stop{j + 1}"] for j in range(len(wanted["stops"]))]
    weights = hysteresis["weights"] if hysteresis else []
    theirs = np.array([wanted["x"][0], wanted["u"][0], wanted["q"]]), np.array(wanted["stops"])
    ours = np.array([found["x1"], found["u1"], found["q"]]), np.array(stops)
    dc = wanted["shunt"]["dc_voltage"]
    error = energy(*(ours[0] - theirs[0]), ours[1] - theirs[1], found["dc"] - dc, weights)
    size = energy(*theirs[0], theirs[1], dc, weights)
    assert np.sqrt(error / size) <= 1e-9
