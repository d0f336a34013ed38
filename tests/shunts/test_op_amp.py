"""A negative capacitance made of an amplifier: its two-port in closed form, and its limits."""

import numpy as np
import pytest
from oracles.ngspice import needs_ngspice
from studies import BENCH

from piezoharvest import (
    NegativeCapacitance,
    OpAmpNegativeCapacitance,
    SineForce,
    System,
    Transducer,
    gradient,
    simulate,
)
from piezoharvest.spice.simulators.comparison import compare

DEVICE, FREQUENCY = Transducer(**BENCH), 50.6
PARTS = {"capacitance": 20e-9, "resistance": 1e5}


def steady(shunt, amplitude):
    found = simulate(System(DEVICE, shunt), SineForce(amplitude=amplitude, frequency=FREQUENCY), attenuation=False)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    return found


@pytest.mark.parametrize("gain_bandwidth", [1e3, 1e6])
def test_admittance_with_a_finite_gain_bandwidth_product(gain_bandwidth):
    """Y = 1/R + s C_n (1 - 2/(1 + 2 s/w_t)), beside the transducer's own two equations."""
    shunt = OpAmpNegativeCapacitance(**PARTS, gain_bandwidth=gain_bandwidth, saturation=15.0)
    found, s = steady(shunt, 2e-3), 2j * np.pi * FREQUENCY
    admittance = 1e-5 + s * 20e-9 * (1 - 2 / (1 + 2 * s / (2 * np.pi * gain_bandwidth)))
    own = BENCH["mass"] * s**2 + BENCH["damping"] * s + BENCH["stiffness"]
    coupling = BENCH["coupling"]
    both = [[own, -coupling], [s * coupling, s * BENCH["capacitance"] + admittance]]
    wanted = np.abs(np.linalg.solve(both, [2e-3, 0]))
    assert (found.displacement_amplitude, found.voltage_amplitude) == pytest.approx(wanted, rel=1e-9)


def test_fast_amplifier_makes_the_ideal_one():
    """But for the negative conductance of its lag, 4 w^2 C_n/w_t, beside that of the load: 1.3e-5."""
    fast = steady(OpAmpNegativeCapacitance(**PARTS, gain_bandwidth=1e7, saturation=15.0), 2e-3)
    ideal = steady(NegativeCapacitance(**PARTS), 2e-3)
    assert fast.voltage_amplitude == pytest.approx(ideal.voltage_amplitude, rel=1.3e-5)


def test_gradient_where_it_saturates():
    system = System(DEVICE, OpAmpNegativeCapacitance(**PARTS, gain_bandwidth=1e4, saturation=8.0))
    found = gradient(system, SineForce(amplitude=0.02, frequency=FREQUENCY))
    slope = found.by["displacement_amplitude"][found.quantities.index("shunt.saturation")]
    more, less = (
        OpAmpNegativeCapacitance(**PARTS, gain_bandwidth=1e4, saturation=8.0 + step) for step in (1e-3, -1e-3)
    )
    difference = steady(more, 0.02).displacement_amplitude - steady(less, 0.02).displacement_amplitude
    assert slope == pytest.approx(difference / 2e-3, rel=1e-6)


@pytest.mark.slow
@needs_ngspice
def test_saturation_against_ngspice():
    shunt = OpAmpNegativeCapacitance(**PARTS, gain_bandwidth=1e4, saturation=8.0)
    figures, trusted = compare(System(DEVICE, shunt), SineForce(amplitude=0.02, frequency=FREQUENCY))
    assert trusted
    for figure in figures:
        assert abs(figure.difference) < 0.01, figure
