"""What real parts of switching and rectifying circuits take: a capacitor's series resistance, gates, control."""

import dataclasses

import numpy as np
import pytest
from messages import is_sentence
from oracles.ngspice import needs_ngspice
from studies import BENCH

from piezoharvest import (
    SECE,
    SSDI,
    SSHC,
    Battery,
    Doubler,
    HalfWave,
    ParallelSSHI,
    Rectifier,
    SelfPoweredSeriesSSHI,
    SineForce,
    System,
    Transducer,
    gradient,
    simulate,
)
from piezoharvest.description.parameters import ParameterError
from piezoharvest.spice.simulators.comparison import compare

DEVICE = Transducer(**BENCH)
STILL, DRIVE = (SineForce(amplitude=force, frequency=50.6) for force in (0.0, 0.02))
DC = {"smoothing_capacitance": 1e-7, "load_resistance": 5e5}
LOOP = {"inductance": 0.1, "quality": 5.0}


def steady(shunt):
    found = simulate(System(DEVICE, shunt), DRIVE, attenuation=False)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    return found


def test_capacitor_discharges_through_its_own_resistance():
    """The time constant is C (R + r); of the energy the load has R/(R + r)."""
    shunt = Rectifier(smoothing_capacitance=1e-6, load_resistance=1e3, initial_dc_voltage=4.0, smoothing_resistance=250)
    found = simulate(System(DEVICE, shunt), STILL, transient=2e-3, attenuation=False)
    wanted = 4.0 * np.exp(-found.waveforms.time / 1.25e-3)
    np.testing.assert_allclose(found.waveforms.dc_voltage, wanted, rtol=1e-9)
    released = 0.5e-6 * 16.0 * (1.0 - np.exp(-2 * 2e-3 / 1.25e-3))
    assert found.energy["harvested"] == pytest.approx(0.8 * released, rel=1e-9)
    assert found.energy["shunt_loss"] == pytest.approx(0.2 * released, rel=1e-9)


def test_large_capacitor_with_a_resistance_is_a_battery_with_one():
    """Thevenin: the capacitor at V behind r, with the load R across both, is V R/(R + r) behind R r/(R + r)."""
    resistance, load = 3e4, 2e5
    found = steady(Rectifier(smoothing_capacitance=1e-2, load_resistance=load, smoothing_resistance=resistance))
    share = load / (load + resistance)
    same = steady(Battery(dc_voltage=share * found.dc_voltage, internal_resistance=share * resistance))
    for name in ("voltage_amplitude", "displacement_amplitude", "mechanical_power"):
        assert getattr(found, name) == pytest.approx(getattr(same, name), rel=1e-6)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(
    "shunt",
    [
        HalfWave(**DC, smoothing_resistance=1e5, diode_drop=0.3, diode_leakage=1e-7),
        HalfWave(**DC, smoothing_resistance=1e5),
        Doubler(**DC, smoothing_resistance=1e5, diode_drop=0.3, dc_leakage=1e-6),
        SelfPoweredSeriesSSHI(
            **DC, **LOOP, smoothing_resistance=2e4, envelope_capacitance=1e-9, threshold=0.6, diode_drop=0.2
        ),
    ],
    ids=["half wave, leaking", "half wave", "doubler", "series breakers"],
)
def test_capacitor_with_a_resistance_against_ngspice(shunt):
    figures, trusted = compare(System(DEVICE, shunt), DRIVE)
    plain = steady(dataclasses.replace(shunt, smoothing_resistance=0.0))
    assert trusted
    for figure in figures:
        assert abs(figure.difference) < 0.01, figure
    assert abs(figures[0].engine / plain.harvested_power - 1) > 0.02  # it counts


@pytest.mark.parametrize(
    "shunt, actions",
    [
        (ParallelSSHI(**DC, **LOOP), 2),
        (SSHC(**DC, flip_capacitances=(40e-9, 40e-9), switch_resistance=100.0), 10),  # of 5 phases each
        (SECE(), 2),
        (SSDI(**LOOP), 2),
    ],
)
def test_gates_and_control_are_taken_from_the_harvest(shunt, actions):
    plain = steady(shunt)
    found = steady(dataclasses.replace(shunt, gate_energy=1e-8, control_power=3e-7))
    taken = 3e-7 + actions * 1e-8 * DRIVE.frequency
    assert plain.harvested_power - found.harvested_power == pytest.approx(taken, rel=1e-9)
    assert found.energy["shunt_loss"] - plain.energy["shunt_loss"] == pytest.approx(taken * found.period, rel=1e-6)
    assert found.displacement_amplitude == plain.displacement_amplitude
    slopes = gradient(System(DEVICE, dataclasses.replace(shunt, gate_energy=1e-8)), DRIVE)
    slope = slopes.by["harvested_power"][slopes.quantities.index("shunt.gate_energy")]
    assert slope == pytest.approx(-actions * DRIVE.frequency, rel=1e-9)


def test_switch_that_does_not_act_takes_nothing():
    shunt = ParallelSSHI(**DC, **LOOP, detector_threshold=1e3)
    spent = steady(dataclasses.replace(shunt, gate_energy=1e-8))
    assert spent.harvested_power == steady(shunt).harvested_power > 0


@pytest.mark.parametrize(
    "build",
    [
        lambda: Rectifier(dc_voltage=1.0, smoothing_resistance=1.0),
        lambda: Doubler(**DC, smoothing_resistance=1.0, diode_leakage=1e-9),
    ],
)
def test_resistance_without_its_capacitor_is_refused(build):
    with pytest.raises(ParameterError) as caught:
        build()
    assert caught.value.key == "smoothing_resistance"
    assert is_sentence(caught.value.message)
