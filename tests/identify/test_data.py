"""Records as a fit takes them: in how many steps a sample is taken."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest
from identify.identify_runs import LINEAR

from piezoharvest.description.shunts import Resistor
from piezoharvest.identify.fitting.data import data_of
from piezoharvest.predict.step_counts import CUBIC, MIN_RELATIVE_NOISE, NOISE_MARGIN, STRAIGHT, curvature_of
from piezoharvest.records.record import Record, Signal
from piezoharvest.study import build_transducer

TIME = np.arange(10_000) / 1000.0
NONE = np.zeros(0, int)


@pytest.mark.parametrize("order", [STRAIGHT, CUBIC])
@pytest.mark.parametrize(
    ("frequency", "sigma"), [(1.0, 1e-5), (48.0, 1e-5), (150.0, 1e-5), (48.0, 1e-3), (150.0, 1e-3)]
)
def test_a_sine_bends_by_a_power_of_what_it_turns_in_a_sample(frequency, sigma, order):
    turn, size = 2 * np.pi * frequency * 1e-3, np.sqrt(0.5)
    noise = sigma * np.random.default_rng(1).standard_normal(len(TIME))
    found = curvature_of(np.sin(2 * np.pi * frequency * TIME) + noise, sigma, NONE, order)
    margin = (NOISE_MARGIN - 1.0) * comb(2 * order, order) * sigma**2  # more than the noise is taken off
    above = max(((2.0 * (1.0 - np.cos(turn))) ** (order // 2) * size) ** 2 - margin, 0.0)
    assert found == pytest.approx(np.sqrt(above) / max(sigma, MIN_RELATIVE_NOISE * size), rel=0.05)


@pytest.mark.parametrize("order", [STRAIGHT, CUBIC])
def test_noise_alone_does_not_bend(order):
    assert curvature_of(1e-3 * np.random.default_rng(2).standard_normal(len(TIME)), 1e-3, NONE, order) == 0.0


def test_a_step_that_small_steps_follow_does_not_bend():
    values = np.where(TIME < 5.0, 0.0, 1.0 - 0.3 * np.exp(-np.maximum(TIME - 5.0, 0.0) / 1e-3))
    for order in (STRAIGHT, CUBIC):
        assert curvature_of(values, 0.0, NONE, order) > 1e-2 / MIN_RELATIVE_NOISE
        assert curvature_of(values, 0.0, np.array([4999]), order) < 1e-6 / MIN_RELATIVE_NOISE


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
