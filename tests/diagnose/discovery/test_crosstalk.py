"""Filters of sensors: of what they show of another channel, and an amplifier that blocks a constant."""

import numpy as np
import pytest
from diagnose.swept import DURATION, RATE, TRUE, campaign
from scipy.interpolate import CubicSpline
from scipy.signal import lsim

from piezoharvest.description.effects.nameless.memory import LateBy, Relaxation, Resonance
from piezoharvest.diagnose import diagnose

SIZE = 2e-6  # m/V
TIME_CONSTANT, FREQUENCY, DAMPING = 2e-3, 120.0, 0.05  # s, Hz
OMEGA = 2.0 * np.pi * FREQUENCY


def found_in(numerator, denominator, seed):
    """Law in the displacement's reading, which has the voltage filtered by a transfer function in it."""

    def crosstalk(time, voltage):
        return SIZE * lsim((numerator, denominator), voltage, time)[1]

    found = diagnose(campaign("white", seed, crosstalk=crosstalk, duration=1.5))
    assert found.verdict == "new_effect", (found.verdict, found.effects)
    (discovery,) = found.discovery
    assert (discovery.law.place.name, discovery.law.place.input) == ("reading.displacement", "voltage")
    assert discovery.gain > 0.95
    return discovery.law


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_low_frequencies_of_the_voltage(seed):
    law = found_in([1.0], [TIME_CONSTANT, 1.0], seed)
    assert isinstance(law.memory, Relaxation) and not law.memory.behind
    assert law.memory.time_constant == pytest.approx(TIME_CONSTANT, rel=0.02)
    assert law.form.factor == pytest.approx(SIZE, rel=0.02)


@pytest.mark.slow
def test_high_frequencies_of_the_voltage():
    law = found_in([TIME_CONSTANT, 0.0], [TIME_CONSTANT, 1.0], 3)
    assert isinstance(law.memory, Relaxation) and law.memory.behind  # its lag minus the voltage
    assert law.memory.time_constant == pytest.approx(TIME_CONSTANT, rel=0.02)
    assert law.form.factor == pytest.approx(-SIZE, rel=0.02)


def test_a_resonance_that_the_voltage_excites():
    law = found_in([OMEGA**2], [1.0, 2.0 * DAMPING * OMEGA, OMEGA**2], 4)
    assert isinstance(law.memory, Resonance)
    assert law.memory.frequency == pytest.approx(FREQUENCY, rel=2e-3)
    assert law.memory.damping_ratio == pytest.approx(DAMPING, rel=0.03)
    assert law.form.factor == pytest.approx(SIZE, rel=0.02)


DELAY, BEND = 1.3e-3, 3.0  # s, V


def late(time, voltage):
    return CubicSpline(time, voltage)(np.maximum(time - DELAY, time[0]))


@pytest.mark.parametrize("curve", ["line", pytest.param("tanh", marks=pytest.mark.slow)])
def test_a_voltage_that_shows_late(curve):
    """A delay of a radian at the resonance: no lag of first order turns by as much and stays as large."""

    def crosstalk(time, voltage):
        v = late(time, voltage)
        return SIZE * (v if curve == "line" else BEND * np.tanh(v / BEND))

    found = diagnose(campaign("white", 5, crosstalk=crosstalk))
    assert found.verdict == "new_effect", (found.verdict, found.effects)
    (discovery,) = found.discovery
    law = discovery.law
    assert (law.place.name, law.place.input) == ("reading.displacement", "voltage")
    assert isinstance(law.memory, LateBy) and law.memory.whole
    assert law.memory.delay == pytest.approx(DELAY, rel=0.02)
    assert discovery.gain > 0.95
    if curve == "line":
        assert law.form.factor == pytest.approx(SIZE, rel=0.02)


FINER = 8
BLOCKED = 4e-3  # s, time constant of an amplifier of alternating voltages: 40 Hz, where the sweeps begin


def amplified(voltage):
    time = np.arange(len(voltage)) / RATE
    fine = np.linspace(0.0, time[-1], FINER * (len(time) - 1) + 1)  # between which lsim takes a straight line
    return lsim(([BLOCKED, 0.0], [BLOCKED, 1.0]), CubicSpline(time, voltage)(fine), fine)[1][::FINER]


@pytest.mark.parametrize(
    ("seed", "duration"),
    [
        pytest.param(5, 0.5, marks=pytest.mark.recovery_long),
        *(pytest.param(seed, DURATION, marks=pytest.mark.slow) for seed in (5, 6)),
    ],
)
def test_an_amplifier_of_alternating_voltages(seed, duration):
    """It shows the voltage minus its lag: as a share of what the lag is behind it would need an infinite gain."""
    found = diagnose(campaign("white", seed, read=amplified, duration=duration))
    assert found.verdict == "new_effect", (found.verdict, found.effects)
    (discovery,) = found.discovery
    law = discovery.law
    assert (law.place.name, law.place.input) == ("reading.voltage", "voltage")
    assert isinstance(law.memory, Relaxation) and not law.memory.behind
    assert law.memory.time_constant == pytest.approx(BLOCKED, rel=0.03)
    assert law.form.factor == pytest.approx(-1.0, abs=0.03)
    assert discovery.gain > 0.95
    for estimate in found.estimates:  # one that was held at its nominal value without the law is free with it
        assert abs(estimate.value - TRUE[estimate.parameter.name]) < 4.5 * estimate.std, estimate.parameter.name
