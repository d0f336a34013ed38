"""Closed forms of switched damping (REFERENCE.md section 4) against the engine's steady states."""

import dataclasses
import math

import numpy as np
import pytest
from oracles.ngspice import needs_ngspice
from scipy.linalg import expm
from studies import BENCH, inversion

from piezoharvest.description.excitation import SineForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import SSDI, SSDS, SSDV, ParallelSSHI, Short
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine import gradient, simulate
from piezoharvest.spice.simulators.comparison import compare

FORCE = 0.02


def host(coupling_squared, mechanical_quality):
    """Transducer of given k_e^2 and Q_m, resonant at 50 Hz."""
    mass, capacitance = 0.01, 40e-9
    stiffness = mass * (2 * math.pi * 50.0) ** 2
    return Transducer(
        mass=mass,
        damping=math.sqrt(stiffness * mass) / mechanical_quality,
        stiffness=stiffness,
        coupling=math.sqrt(coupling_squared * stiffness * capacitance),
        capacitance=capacitance,
    )


def amplitude(device, shunt, frequency):
    response = simulate(System(device, shunt), SineForce(amplitude=FORCE, frequency=frequency), samples=16)
    assert response.converged, response.message
    return response.displacement_amplitude


def attenuation(device, shunt):
    """At the open-circuit resonance, in dB against the short circuit at its own resonance."""
    damped = amplitude(device, shunt, device.open_circuit_frequency)
    return 20 * math.log10(damped / (FORCE / (device.damping * 2 * math.pi * device.short_circuit_frequency)))


@pytest.mark.parametrize("loop_quality", [2.0, 6.0, 20.0])
@pytest.mark.parametrize(("coupling_squared", "mechanical_quality"), [(0.001, 200.0), (0.01, 50.0), (0.02, 60.0)])
def test_ssdi_at_resonance(coupling_squared, mechanical_quality, loop_quality):
    """x/x_0 = 1/[1 + (4/pi) k_e^2 Q_m (1+q)/(1-q)]."""
    device, q = host(coupling_squared, mechanical_quality), inversion(loop_quality)
    shunt = SSDI(quality=loop_quality, flip_time=1e-5 / device.open_circuit_frequency)
    wanted = 1 / (1 + 4 / math.pi * coupling_squared * mechanical_quality * (1 + q) / (1 - q))
    assert attenuation(device, shunt) == pytest.approx(20 * math.log10(wanted), abs=0.1)


@pytest.mark.parametrize(("coupling_squared", "mechanical_quality"), [(0.001, 200.0), (0.01, 50.0), (0.02, 100.0)])
def test_ssds_is_ssdi_without_inversion(coupling_squared, mechanical_quality):
    device = host(coupling_squared, mechanical_quality)
    wanted = 1 / (1 + 4 / math.pi * coupling_squared * mechanical_quality)
    assert attenuation(device, SSDS()) == pytest.approx(20 * math.log10(wanted), abs=0.1)


def test_ssdi_formula_is_off_at_the_short_circuit_resonance():
    """The formula holds at the open-circuit resonance; at the short-circuit one it is off by most of a decibel."""
    device, q = host(0.02, 50.0), inversion(0.8)
    shunt = SSDI(quality=0.8, flip_time=1e-5 / device.open_circuit_frequency)
    x_0 = FORCE / (device.damping * 2 * math.pi * device.short_circuit_frequency)
    formula = -20 * math.log10(1 + 4 / math.pi * 0.02 * 50.0 * (1 + q) / (1 - q))
    found = 20 * math.log10(amplitude(device, shunt, device.short_circuit_frequency) / x_0)
    assert abs(attenuation(device, shunt) - formula) < 0.1
    assert 0.4 < abs(found - formula) < 1.2


@pytest.mark.parametrize("source_voltage", [0.2, 0.5])
def test_ssdv_adds_its_source_to_the_inverted_voltage(source_voltage):
    """Balance of the fundamental: b w X + (4/pi) T V_m = F with V_m (1-q) = (1+q) (T X/C + V_s) about resonance.

    The voltage is a square wave of height (T X/C + V_s)(1+q)/(1-q) beside the open-circuit response.
    """
    device, q = host(0.005, 100.0), inversion(6.0)
    shunt = SSDV(quality=6.0, flip_time=1e-5 / device.open_circuit_frequency, source_voltage=source_voltage)
    omega, gain = 2 * math.pi * device.open_circuit_frequency, 4 / math.pi * (1 + q) / (1 - q)
    stiffness = device.damping * omega + gain * device.coupling**2 / device.capacitance
    wanted = (FORCE - gain * device.coupling * source_voltage) / stiffness
    assert amplitude(device, shunt, device.open_circuit_frequency) == pytest.approx(wanted, rel=5e-3)


@pytest.mark.parametrize(("share", "holds"), [(0.8, True), (1.1, False)])
def test_a_source_stops_the_motion_at_its_highest_voltage(share, holds):
    """V_s = (pi/4) (F/T) (1-q)/(1+q), whatever the frequency: the source's friction is then as large as the drive."""
    device, q = host(0.01, 50.0), inversion(6.0)
    highest = math.pi / 4 * FORCE / device.coupling * (1 - q) / (1 + q)
    shunt = SSDV(quality=6.0, flip_time=1e-5 / 50.0, source_voltage=share * highest)
    # Its q is exp(-pi/(2 Q)), without the frequency's shift by the damping: q is 9e-4 off, and 1 - q 3e-3.
    assert shunt.stopping_voltage(device.capacitance, FORCE / device.coupling) == pytest.approx(highest, rel=5e-3)
    for frequency in (device.open_circuit_frequency, 48.5):
        found = simulate(System(device, shunt), SineForce(amplitude=FORCE, frequency=frequency))
        assert found.converged == holds


def test_attenuation_reported_is_against_the_short_circuit_at_the_same_frequency():
    device = host(0.01, 50.0)
    f = device.open_circuit_frequency
    shunt = SSDI(quality=6.0, flip_time=1e-5 / f)
    response = simulate(System(device, shunt), SineForce(amplitude=FORCE, frequency=f))
    ratio = amplitude(device, shunt, f) / amplitude(device, Short(), f)
    assert response.attenuation_db == pytest.approx(20 * math.log10(ratio), abs=1e-8)


@pytest.mark.parametrize("phase_lag", [-0.6, -0.3, 0.3, 0.6])
def test_switching_out_of_time_damps_less(phase_lag):
    device = host(0.005, 50.0)
    f = device.open_circuit_frequency
    in_time = amplitude(device, SSDI(quality=4.0, flip_time=1e-5 / f), f)
    off = amplitude(device, SSDI(quality=4.0, flip_time=1e-5 / f, phase_lag=phase_lag), f)
    assert off > in_time * (1 + 0.2 * phase_lag**2)
    assert np.isfinite(off)


def test_the_resistance_of_a_switch_is_in_the_loop():
    """A coil of quality Q and a switch of resistance R_on: the loop is one of the quality sqrt(L/C)/(R + R_on)."""
    device, inductance = host(0.01, 50.0), 1e-2
    impedance = math.sqrt(inductance / device.capacitance)
    shunt = SSDI(inductance=inductance, quality=20.0, switch_resistance=0.1 * impedance)
    alike = SSDI(inductance=inductance, quality=1 / (1 / 20 + 0.1))
    drive = SineForce(amplitude=1e-3, frequency=device.short_circuit_frequency)
    found, wanted = (simulate(System(device, each), drive) for each in (shunt, alike))
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-10)
    assert found.energy["shunt_loss"] == pytest.approx(wanted.energy["shunt_loss"], rel=1e-9)
    with pytest.raises(ParameterError, match="switch_resistance: found"):
        simulate(System(device, dataclasses.replace(shunt, switch_resistance=3 * impedance)), drive)
    with pytest.raises(ParameterError, match="switch_resistance: found together with flip_time"):
        SSDI(flip_time=1e-4, quality=5.0, switch_resistance=1.0)


def test_core_takes_its_share_of_an_inversion():
    """The loop by itself, v and the current of the inductance, by a matrix exponential over its on-time."""
    inductance, capacitance = 1e-5, BENCH["capacitance"]
    root = np.sqrt(inductance / capacitance)
    resistance, core = root / 5.0, 6.0 * root
    both = resistance + core
    rates = np.array(
        [
            [-1 / (both * capacitance), -core / (both * capacitance)],
            [core / both / inductance, -core * resistance / both / inductance],
        ]
    )
    closed = np.pi / np.sqrt(1 / (inductance * capacitance) - (resistance / (2 * inductance)) ** 2)
    wanted = expm(rates * closed)[0, 0]
    shunt = SSDI(inductance=inductance, quality=5.0, core_resistance=core)
    drive = SineForce(amplitude=0.02, frequency=50.6)
    waves = simulate(System(Transducer(**BENCH), shunt), drive, samples=20000, attenuation=False).waveforms
    opened = next(t for t, name in zip(waves.event_times, waves.event_names, strict=True) if name == "switch opens")
    before, after = np.interp([opened - 2 * closed, opened + closed], waves.time, waves.voltage)
    assert -0.75 < wanted < -0.4
    assert after / before == pytest.approx(wanted, rel=1e-3)


def test_gradient_of_a_core():
    shunt, drive = SSDI(inductance=0.1, quality=5.0, core_resistance=1e4), SineForce(amplitude=0.02, frequency=50.6)
    found = gradient(System(Transducer(**BENCH), shunt), drive)
    slope = found.by["displacement_amplitude"][found.quantities.index("shunt.core_resistance")]
    more, less = (
        simulate(System(Transducer(**BENCH), dataclasses.replace(shunt, core_resistance=1e4 + step)), drive)
        for step in (1.0, -1.0)
    )
    assert slope == pytest.approx((more.displacement_amplitude - less.displacement_amplitude) / 2.0, rel=1e-5)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(
    "shunt",
    [
        SSDV(inductance=0.1, quality=5.0, source_voltage=1.0, core_resistance=1e4),
        ParallelSSHI(inductance=0.1, quality=5.0, core_resistance=1e4, smoothing_capacitance=1e-7, load_resistance=5e5),
    ],
    ids=["ssdv", "parallel_sshi"],
)
def test_core_against_ngspice(shunt):
    figures, trusted = compare(System(Transducer(**BENCH), shunt), SineForce(amplitude=0.02, frequency=50.6))
    assert trusted
    for figure in figures:
        assert abs(figure.difference) < 0.01, figure
