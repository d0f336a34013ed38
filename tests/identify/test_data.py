"""Records as a fit takes them: in how many steps a sample is taken."""

from __future__ import annotations

import numpy as np
import pytest
from identify.identify_runs import LINEAR

from piezoharvest.description.shunts import Resistor
from piezoharvest.identify.fitting.data import MIN_RELATIVE_NOISE, curvature_of, data_of
from piezoharvest.records.record import Record, Signal
from piezoharvest.study import build_transducer

TIME = np.arange(10_000) / 1000.0
NONE = np.zeros(0, int)


@pytest.mark.parametrize(
    ("frequency", "sigma"), [(1.0, 1e-5), (48.0, 1e-5), (150.0, 1e-5), (48.0, 1e-3), (150.0, 1e-3)]
)
def test_a_sine_bends_by_the_square_of_what_it_turns_in_a_sample(frequency, sigma):
    turn, size = 2 * np.pi * frequency * 1e-3, np.sqrt(0.5)
    noise = sigma * np.random.default_rng(1).standard_normal(len(TIME))
    found = curvature_of(np.sin(2 * np.pi * frequency * TIME) + noise, sigma, NONE)
    bend = 2.0 * (1.0 - np.cos(turn)) * size / max(sigma, MIN_RELATIVE_NOISE * size)
    assert found == pytest.approx(bend, rel=0.2 if frequency == 1.0 else 0.01)


def test_noise_alone_does_not_bend():
    assert curvature_of(1e-3 * np.random.default_rng(2).standard_normal(len(TIME)), 1e-3, NONE) == 0.0


def test_a_step_that_small_steps_follow_does_not_bend():
    values = np.where(TIME < 5.0, 0.0, 1.0 - 0.3 * np.exp(-np.maximum(TIME - 5.0, 0.0) / 1e-3))
    assert curvature_of(values, 0.0, NONE) > 1e-2 / MIN_RELATIVE_NOISE
    assert curvature_of(values, 0.0, np.array([4999])) < 1e-6 / MIN_RELATIVE_NOISE


@pytest.mark.parametrize(("force", "voltage", "displacement"), [(400.0, 1.0, 0.0), (1.0, 50.0, 0.0), (1.0, 1.0, 1e-4)])
def test_a_record_reaches_as_far_as_the_largest_energy_of_its_whole_ranges(force, voltage, displacement):
    """Root of k x^2, C v^2 and F^2/k, of what was measured: one that was not is none of them."""
    wave = np.sin(2 * np.pi * 5.0 * TIME[:1000])
    sizes = {"force": force, "voltage": voltage, "displacement": displacement}
    signals = {name: Signal(size * wave, 1e-3 * size, "", "", 1) for name, size in sizes.items() if size}
    load = Resistor(resistance=1e5)
    record = Record("a", "records.0", "fit", "force", load, 0.0, Signal(TIME[:1000], None, "", "", 1), signals)
    transducer = build_transducer(LINEAR)
    k, capacitance = transducer.stiffness, transducer.capacitance
    energies = [(2 * force) ** 2 / k, capacitance * (2 * voltage) ** 2, k * (2 * displacement) ** 2]
    assert data_of(record, transducer).setting.reach == pytest.approx(np.sqrt(max(energies)), rel=1e-3)
