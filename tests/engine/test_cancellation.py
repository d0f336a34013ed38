"""A voltage that is a billionth of what the preload's charge would make alone: linear equations in the deviations."""

import math

import numpy as np
from scipy.integrate import solve_ivp

from piezoharvest import Hysteresis, SeriesRLC, SineBase, System, Transducer, simulate


def test_a_small_voltage_on_a_large_preload_is_right_to_its_own_size():
    """A random study in which the virtual bench is beside the engine, and wrong: in this form nothing cancels."""
    m, b, k, coupling, c = 7.647540376708391e-06, 0.1046182962102735, 0.012171909987764667, 1.0991e-08, 7.620654e-10
    stops = Hysteresis(thresholds=(2.4272e-10, 2.1942e-07), weights=(5095306458.735, 19771158433734.73))
    device = Transducer(mass=m, damping=b, stiffness=k, coupling=coupling, capacitance=c, hysteresis=stops)
    loop = SeriesRLC(inductance=4.710404, resistance=10893.298, capacitance=2.85796e-08)
    drive = SineBase(amplitude=1.2e6, frequency=6.35, offset=-3.6e6)
    waves = simulate(System(device, loop), drive, transient=2 / drive.frequency, samples=128).waveforms

    elastance = 1 / c + sum(stops.weights)  # no stop slips
    series = elastance + 1 / loop.capacitance
    matrix = np.array([
        [0, 1, 0, 0],
        [-(k + coupling**2 / c) / m, -b / m, coupling / c / m, 0],
        [0, 0, 0, -1],
        [-coupling / c / loop.inductance, 0, series / loop.inductance, -loop.resistance / loop.inductance],
    ])  # fmt: skip
    pushed, omega = np.array([0, -drive.amplitude, 0, 0]), 2 * math.pi * drive.frequency
    found = solve_ivp(
        lambda t, y: matrix @ y + pushed * math.sin(omega * t), (0, waves.time[-1]), np.zeros(4), "Radau",
        t_eval=waves.time, jac=matrix, rtol=1e-10, atol=[1e-10, 1e-8, 1e-22, 1e-20],
    )  # fmt: skip
    assert np.abs(found.y[2]).max() < stops.thresholds[0]
    voltage = elastance * found.y[2] - coupling / c * found.y[0]
    assert np.abs(voltage).max() < 1e-8 * coupling / c * np.abs(waves.displacement).max()
    np.testing.assert_allclose(waves.voltage, voltage, rtol=0, atol=1e-6 * np.abs(voltage).max())
