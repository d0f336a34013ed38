"""Drives that are fast beside the samples: of limited bandwidth rather than splines, and without false jumps."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import chirp
from sweeps import linear_sweep

from piezoharvest import Campaign, identify
from piezoharvest.predict.band_limited import REACH, cubic_of_sine
from piezoharvest.predict.drive import drive_of, jumps_of

RATE, MASS, COUPLING, QUALITY, SQUARE = 5000.0, 0.01, 1e-3, 50.0, 0.025  # Hz, kg, N/V, and coupling factor squared


@pytest.mark.parametrize("frequency", [0.07, 0.125, 0.25, 0.4])
@pytest.mark.parametrize("rate", [-0.01 + 0.25j * np.pi, -0.001 + 0.1j])
def test_a_step_acts_on_a_slow_oscillator_as_the_sine_does(frequency, rate):
    """Integral of exp(rate (1 - t)) times the drive, by a quadrature of high order and in closed form."""
    angle = 2 * np.pi * frequency
    exact = (np.exp(1j * angle) - np.exp(rate)) / (1j * angle - rate)
    node, weight = np.polynomial.legendre.leggauss(30)
    node = 0.5 * (node + 1.0)
    cubic = sum(c[0] * node**power for power, c in enumerate(cubic_of_sine(np.array([angle]))))
    assert 0.5 * weight @ (np.exp(rate * (1.0 - node)) * cubic) == pytest.approx(exact, rel=2e-5)


def test_coefficients_are_those_of_a_sine_away_from_the_ends():
    angle = 2 * np.pi * 0.2
    found = drive_of(np.cos(angle * np.arange(400)))
    assert found.fast
    turns = np.exp(1j * angle * np.arange(399))
    expected = np.real(np.outer(turns, [c[0] for c in cubic_of_sine(np.array([angle]))]))
    np.testing.assert_allclose(found.coefficients[REACH:-REACH], expected[REACH:-REACH], atol=1e-12)


def test_slow_drives_remain_splines():
    time = np.arange(4000) / RATE
    noisy = np.sin(2 * np.pi * 50.0 * time) + 0.01 * np.random.default_rng(1).normal(size=4000)
    assert not drive_of(noisy).fast


def driven(rates, push, drive, time):
    """States of y' = rates y + push drive(t) from rest: what acts within a sample by quadrature, exact to rounding."""
    step, (node, weight) = time[1], np.polynomial.legendre.leggauss(30)
    node, weight = 0.5 * (node + 1.0), 0.5 * weight
    acts = np.stack([step * w * expm(rates * step * (1.0 - s)) @ push for s, w in zip(node, weight, strict=True)])
    within, over = drive(time[:-1, None] + step * node) @ acts, expm(rates * step)
    states = np.zeros((len(time), len(push)))
    for n, added in enumerate(within):
        states[n + 1] = over @ states[n] + added
    return states.T


@pytest.mark.parametrize("highest", [625.0, pytest.param(1250.0, marks=pytest.mark.slow), 2000.0])
def test_a_chirp_through_a_fast_resonance_gives_its_mass(highest):
    """The chirp itself as the drive, not its samples; resonance at an eighth of the rate."""
    omega = 2 * np.pi * RATE / 8
    stiffness = MASS * omega**2
    damping, capacitance = np.sqrt(stiffness * MASS) / QUALITY, COUPLING**2 / stiffness / SQUARE
    load, records, rng = 1.0 / (capacitance * omega), [], np.random.default_rng(7)
    moves = [-stiffness / MASS, -damping / MASS, COUPLING / MASS]
    rates = np.array([[0, 1, 0], moves, [0, -COUPLING / capacitance, -1.0 / (load * capacitance)]])
    for duration, role in ((2.0, "fit"), (0.5, "validate")):
        sweep, time = linear_sweep(5.0, duration, highest), np.arange(round(duration * RATE)) / RATE
        x, _, e = driven(rates, np.array([0, 0.02 / MASS, 0]), sweep, time)
        data = {"force_N": 0.02 * sweep(time), "displacement_m": x, "voltage_V": e}
        data = {name: values + 1e-3 * values.std() * rng.normal(size=len(time)) for name, values in data.items()}
        records.append({"data": {"time_s": time, **data}, "load_resistance": load, "role": role})
    true = {"mass": MASS, "damping": damping, "stiffness": stiffness, "coupling": COUPLING, "capacitance": capacitance}
    nominal = {name: value * (1.05 if n % 2 else 0.95) for n, (name, value) in enumerate(true.items())}
    for estimate in identify(Campaign.from_arrays(nominal, records)).estimates:
        off = estimate.value - true[estimate.parameter.name]
        assert abs(off) < 3.5 * estimate.std, estimate.parameter.name
        assert estimate.std < 5e-3 * estimate.value


def test_noise_and_fast_chirps_have_no_jumps():
    rng = np.random.default_rng(2)
    assert not len(jumps_of(rng.normal(size=20000)))
    assert not len(jumps_of(rng.uniform(-1.0, 1.0, 20000)))
    time = np.arange(10000) / RATE
    assert not len(jumps_of(chirp(time, 5.0, 2.0, 2400.0)))
    square = np.sign(np.cos(2 * np.pi * 3.0 * time)) + 0.01 * rng.normal(size=10000)
    assert len(jumps_of(square)) == 12
