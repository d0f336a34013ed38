"""Stages of a switch that are passed through in one step, beside runs that look for events in short ones."""

import numpy as np
import pytest
from studies import STOPS, bench, objects

from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.run import Machine

SEEDS = range(24)


def random_study(seed):
    """Capacitors or a coil in steps, whose stages may last so long that the bridge conducts within them."""
    rng = np.random.default_rng(seed)

    def about(typical, decades=1.0):
        return float(typical * 10 ** rng.uniform(-decades, decades))

    dc = {"smoothing_capacitance": about(1e-7), "load_resistance": about(1e5), "diode_drop": float(rng.uniform(0, 0.5))}
    flips = {
        "kind": "sshc", "flip_capacitances": [about(40e-9) for _ in range(rng.integers(1, 5))],
        "switch_resistance": about(1e3), "phase_time": about(2e-4),
    }  # fmt: skip
    steps = {
        "kind": "bias_flip",
        "steps": int(rng.integers(2, 6)),
        "inductance": about(0.3),
        "quality": about(5.0, 0.5),
    }
    return bench({**(flips if rng.random() < 0.4 else steps), **dc}, **({"hysteresis": STOPS} if seed % 4 == 0 else {}))


def run(machine, excitation, **recorded):
    """State, and events with their instants, after some periods."""
    state = machine.state(log=4000, **recorded)
    assert machine.run(state, 20.3 * excitation.period) == 0
    return state


@pytest.mark.parametrize("seed", SEEDS)
def test_events_within_stages_are_not_missed(seed):
    """Extremes are recorded only where a stage is divided into steps."""
    system, excitation = objects(random_study(seed))
    machine = Machine(lower(system, excitation))
    whole, divided = run(machine, excitation), run(machine, excitation, track=True)
    np.testing.assert_array_equal(whole.D[st.LOGGED], divided.D[st.LOGGED])
    np.testing.assert_allclose(whole.z, divided.z, rtol=0, atol=1e-9 * np.abs(divided.z).max())


def test_most_stages_of_a_flip_are_one_step():
    system, excitation = objects(
        bench({"kind": "sshc", "flip_capacitances": [40e-9] * 4, "switch_resistance": 100.0,
               "smoothing_capacitance": 1e-6, "load_resistance": 1e6})
    )  # fmt: skip
    work = []
    for track in (False, True):
        lowered = lower(system, excitation)
        machine, before = Machine(lowered), lowered.budget.left
        run(machine, excitation, track=track)
        work.append(before - lowered.budget.left)
    assert work[0] < 0.6 * work[1]
