"""An adaptive RL shunt: the resonance that it finds, its law against an independent integration, a drift."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.ngspice import needs_ngspice
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar
from studies import BENCH

from piezoharvest import (
    AdaptiveRL,
    NoGradientError,
    ParallelRL,
    ParameterError,
    SeriesRL,
    SineForce,
    System,
    Transducer,
    gradient,
    simulate,
)
from piezoharvest.bench.solver import CIRCUITS, Model, integrate
from piezoharvest.description.effects import CouplingDrift
from piezoharvest.design import design
from piezoharvest.spice.simulators.comparison import compare
from piezoharvest.study import DesignOptions, Study

DEVICE, FREQUENCY = Transducer(**BENCH), 50.6
OMEGA, CAPACITANCE = 2 * np.pi * FREQUENCY, BENCH["capacitance"]
DRIVE = SineForce(amplitude=0.02, frequency=FREQUENCY)
TUNED = 1 / (OMEGA**2 * CAPACITANCE)  # H, at which coil and electrodes are in resonance
SQUARED = 2e-8  # A^2, about the mean square of the current
PARTS = {"resistance": 0.3 / (OMEGA * CAPACITANCE), "averaging_time": 3 / FREQUENCY}
FAST = {**PARTS, "adaptation_rate": 0.01 * OMEGA / SQUARED}


def integrated(shunt, length, drift=0.0, drive=DRIVE):
    """States of the equations in the docstring of the shunt at equidistant instants, by DOP853; no limits.

    With a `drift` the coupling changes by so much, relative, over the length.
    """
    mass, damping, stiffness, coupling = (BENCH[k] for k in ("mass", "damping", "stiffness", "coupling"))

    def rates(t, y):
        x, u, q, i, p, g = y.tolist()
        factor = coupling * (1 + drift * t / length)
        v = (q - factor * x) / CAPACITANCE
        force = drive.amplitude * np.sin(2 * np.pi * drive.frequency * t)
        across = v - shunt.resistance * i if shunt.topology == "series" else v
        out = i if shunt.topology == "series" else i + v / shunt.resistance
        return (
            u, (force + factor * v - damping * u - stiffness * x) / mass, -out, g * across / shunt.inductance,
            (i * BENCH["coupling"] * u - p) / shunt.averaging_time, shunt.adaptation_rate * p,
        )  # fmt: skip

    start, times = [0, 0, 0, 0, 0, 1.0], np.linspace(0, length, 201)
    found = solve_ivp(rates, (0, length), start, "DOP853", times, rtol=1e-11, atol=1e-20)
    return found.y


@pytest.mark.parametrize(("topology", "fixed"), [("series", SeriesRL), ("parallel", ParallelRL)])
@pytest.mark.parametrize("first", [0.8, 1.3])
def test_finds_the_electrical_resonance(topology, fixed, first):
    """Adapted slowly it is the tuned shunt with a fixed coil, whatever it began with; what is left is of the ripple."""
    slow = {**PARTS, "adaptation_rate": 1e-5 * OMEGA / SQUARED}
    found = simulate(System(DEVICE, AdaptiveRL(inductance=first * TUNED, **slow, topology=topology)), DRIVE)
    wanted = simulate(System(DEVICE, fixed(inductance=TUNED, resistance=PARTS["resistance"])), DRIVE)
    assert found.converged, found.message
    assert found.adapted_inductance == pytest.approx(TUNED, rel=1e-4)
    assert found.harvested_power == pytest.approx(wanted.harvested_power, rel=1e-4)
    assert found.attenuation_db == pytest.approx(wanted.attenuation_db, abs=1e-3)


@pytest.mark.parametrize("topology", ["series", "parallel"])
def test_law_of_adaptation_against_an_independent_integration(topology):
    shunt, length = AdaptiveRL(inductance=1.25 * TUNED, **FAST, topology=topology), 40 / FREQUENCY
    found = simulate(System(DEVICE, shunt), DRIVE, transient=length, samples=20)
    x, _, q, _, _, g = integrated(shunt, length)
    waves = found.waveforms
    at = np.rint(np.linspace(0, length, 201) * 20 * FREQUENCY).astype(int)[::5]
    for signal, wanted in ((waves.displacement, x), (waves.charge, q)):
        assert np.max(np.abs(signal[at] - wanted[::5])) < 1e-6 * np.max(np.abs(wanted))
    assert found.adapted_inductance == pytest.approx(shunt.inductance / g[-1], rel=1e-6)
    assert abs(g[-1] - 1) > 0.01  # it moved
    assert abs(found.energy["closure"]) < 1e-10


def test_follows_a_resonance_that_drifts():
    """The coupling falls by a third, and with it the frequency of the structure with open electrodes."""
    length, drift = 60 / FREQUENCY, -0.3
    moving = replace(DEVICE, effects=(CouplingDrift(relative_drift=drift),))
    shunt = AdaptiveRL(inductance=TUNED, **FAST)
    found = simulate(System(moving, shunt), DRIVE, transient=length, samples=20)
    x, _, _, _, _, g = integrated(shunt, length, drift)
    at = np.rint(np.linspace(0, length, 201)[::10] * 20 * FREQUENCY).astype(int)
    assert np.max(np.abs(found.waveforms.displacement[at] - x[::10])) < 1e-6 * np.max(np.abs(x))
    assert found.adapted_inductance == pytest.approx(shunt.inductance / g[-1], rel=1e-6)


def test_follows_the_frequency_of_the_drive():
    """At each frequency it has the resonance there, where a fixed coil is off."""
    shunt = AdaptiveRL(inductance=TUNED, **{**PARTS, "adaptation_rate": 1e-5 * OMEGA / SQUARED})
    for frequency in (46.0, 55.0):
        drive = replace(DRIVE, frequency=frequency)
        found = simulate(System(DEVICE, shunt), drive)
        wanted = 1 / ((2 * np.pi * frequency) ** 2 * CAPACITANCE)
        assert found.converged, found.message
        assert found.adapted_inductance == pytest.approx(wanted, rel=1e-4)


def test_stays_at_its_limit():
    """Then it is a fixed coil of the limit."""
    shunt = AdaptiveRL(inductance=TUNED, **FAST, min_inductance=0.9 * TUNED)
    drive = replace(DRIVE, frequency=60.0)
    found = simulate(System(DEVICE, shunt), drive, attenuation=False)
    wanted = simulate(
        System(DEVICE, SeriesRL(inductance=0.9 * TUNED, resistance=PARTS["resistance"])), drive, attenuation=False
    )
    assert found.converged, found.message
    assert found.adapted_inductance == pytest.approx(0.9 * TUNED, rel=1e-9)
    assert found.harvested_power == pytest.approx(wanted.harvested_power, rel=1e-8)


def test_bench_makes_the_same_waveforms():
    shunt, length = AdaptiveRL(inductance=1.25 * TUNED, **FAST), 10 / FREQUENCY
    model = Model(DEVICE, CIRCUITS[shunt.kind](shunt), base=False)
    found = integrate(model, DRIVE, np.linspace(0, length, 201))
    x, _, _, i, _, g = integrated(shunt, length)
    assert np.max(np.abs(found.displacement - x)) < 1e-6 * np.max(np.abs(x))
    assert np.max(np.abs(found.current - i)) < 1e-5 * np.max(np.abs(i))
    assert found.states[-1, -1] == pytest.approx(g[-1] - 1, rel=1e-5)


def test_has_no_gradient_and_says_why():
    with pytest.raises(NoGradientError, match="adaptive_rl is nonlinear between events"):
        gradient(System(DEVICE, AdaptiveRL(inductance=TUNED, **FAST)), DRIVE)


def test_first_inductance_outside_the_limits_is_refused():
    with pytest.raises(ParameterError, match=r"inductance: found 10 H, must be within min_inductance \(20 H\)"):
        AdaptiveRL(inductance=10.0, **FAST, min_inductance=20.0)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("topology", ["series", "parallel"])
def test_against_ngspice(topology):
    shunt = AdaptiveRL(inductance=1.2 * TUNED, **FAST, topology=topology)
    figures, trusted = compare(System(DEVICE, shunt), DRIVE)
    assert trusted
    for figure in figures:
        assert abs(figure.difference) < 0.01, figure


@pytest.mark.parametrize("topology", ["series", pytest.param("parallel", marks=pytest.mark.slow)])
def test_design_tunes_its_resistance(topology):
    """To the best of the circuit with the coil at 1/(omega^2 C), by the two equations of motion written down here."""
    shunt = AdaptiveRL(**{**FAST, "resistance": 10 * FAST["resistance"]}, inductance=1.1 * TUNED, topology=topology)
    study = Study(
        title="", path=Path("study.toml"), transducer=DEVICE, shunts=(shunt,), excitation=DRIVE,
        design=DesignOptions(candidates=("adaptive_rl",)),
    )  # fmt: skip

    def power(resistance):
        """Power into the resistance with a coil of 1/(omega^2 C)."""
        s, c = 1j * OMEGA, CAPACITANCE
        reactance = s * TUNED
        load = reactance + resistance if topology == "series" else 1 / (1 / reactance + 1 / resistance)
        mechanics = DEVICE.stiffness + DEVICE.damping * s + DEVICE.mass * s**2
        matrix = [[mechanics, -DEVICE.coupling], [s * DEVICE.coupling, s * c + 1 / load]]
        voltage = abs(np.linalg.solve(matrix, [0.02, 0.0])[1])
        real = resistance / abs(load) ** 2 if topology == "series" else 1 / resistance
        return 0.5 * voltage**2 * real

    best = minimize_scalar(lambda log: -power(np.exp(log)), bounds=np.log([1e2, 1e8]), method="bounded")
    result = design(study)
    found = result.best
    assert found.converged
    assert found.shunt.resistance == pytest.approx(np.exp(best.x), rel=0.02)
    assert found.harvested_power == pytest.approx(-best.fun, rel=1e-3)
    assert found.harvested_power <= result.bound.any_interface
