"""What holds for every effect, whoever wrote it: run over all that are registered."""

import dataclasses
import itertools
import math

import numpy as np
import pint
import pytest
from examples import plain_examples, typical
from studies import BENCH, DRIVE, LOOP, STOPS, distance

from piezoharvest import effects, shunts
from piezoharvest.engine import simulate
from piezoharvest.excitation import SineForce
from piezoharvest.hysteresis import Hysteresis
from piezoharvest.system import System
from piezoharvest.transducer import Transducer

UNITS = pint.UnitRegistry()
PLAIN = Transducer(**BENCH)
HYSTERETIC = dataclasses.replace(PLAIN, hysteresis=Hysteresis(**STOPS))
DRIVE = SineForce(amplitude=DRIVE["amplitude"], frequency=DRIVE["frequency"])
SHUNTS = {
    "open": shunts.Open(),
    "resistor": shunts.Resistor(resistance=8e4),
    "rectifier": shunts.Rectifier(smoothing_capacitance=1e-6, load_resistance=1e5, diode_drop=0.1),
    "parallel_sshi": shunts.ParallelSSHI(dc_voltage=2.0, phase_lag=0.1, **LOOP),
    "sece": shunts.SECE(),
}
REGISTERED = effects.registered()
EXAMPLES = {name: plain_examples(cls, {})[0] for name, cls in REGISTERED.items()}
each_effect = pytest.mark.parametrize("name", REGISTERED)
each_shunt = pytest.mark.parametrize("shunt", SHUNTS)


def run(shunt, *present, device=HYSTERETIC):
    found = simulate(System(dataclasses.replace(device, effects=present), SHUNTS[shunt]), DRIVE)
    assert found.converged, found.message
    return found


@each_effect
def test_names_its_source_its_units_and_its_null(name):
    cls = REGISTERED[name]
    assert len(cls.source) > 5
    assert cls.__doc__
    assert any(field.metadata.get("null") is not None for field in dataclasses.fields(cls))
    for field in dataclasses.fields(cls):
        UNITS.parse_units(field.metadata["unit"])
        assert field.metadata["doc"]


@each_shunt
@each_effect
def test_absent_at_its_null_value(name, shunt):
    """As near the null as its bounds allow."""
    cls, changes = REGISTERED[name], {}
    for field in dataclasses.fields(cls):
        null = field.metadata.get("null")
        if null is not None:
            near = typical(cls, field)
            changes[field.name] = 1e18 * near if math.isinf(null) else null + 1e-18 * near
    found, wanted = run(shunt, dataclasses.replace(EXAMPLES[name], **changes)), run(shunt)
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-9)
    assert found.harvested_power == pytest.approx(wanted.harvested_power, rel=1e-9, abs=1e-18)
    assert found.energy[name] == pytest.approx(0.0, abs=1e-12 * wanted.energy["mechanical_in"])
    assert distance(found.waveforms.voltage, wanted.waveforms.voltage) < 1e-7


@each_shunt
@each_effect
def test_changes_something_and_never_gives_energy(name, shunt):
    found, without = run(shunt, EXAMPLES[name]), run(shunt)
    assert abs(found.displacement_amplitude / without.displacement_amplitude - 1) > 1e-6
    assert abs(found.energy["closure"]) < 1e-10
    assert found.energy[name] >= 0.0


@each_shunt
def test_order_changes_nothing(shunt):
    orders = itertools.islice(itertools.permutations(EXAMPLES.values()), 6)
    first, *others = [run(shunt, *order) for order in orders]
    for other in others:
        assert other.harvested_power == pytest.approx(first.harvested_power, rel=1e-10, abs=1e-18)
        assert other.displacement_amplitude == pytest.approx(first.displacement_amplitude, rel=1e-10)
        assert other.voltage_amplitude == pytest.approx(first.voltage_amplitude, rel=1e-9)
        for name, value in first.energy.items():
            assert other.energy[name] == pytest.approx(value, rel=1e-8, abs=1e-9 * first.energy["mechanical_in"]), name


def test_two_leakages_are_one_of_half_the_resistance():
    one, half = effects.Leakage(resistance=4e5), effects.Leakage(resistance=2e5)
    found = simulate(System(dataclasses.replace(PLAIN, effects=(one,)), shunts.Resistor(resistance=4e5)), DRIVE)
    wanted = simulate(System(dataclasses.replace(PLAIN, effects=(half,)), shunts.Open()), DRIVE)
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-10)
    assert found.energy["harvested"] + found.energy["leakage"] == pytest.approx(wanted.energy["leakage"], rel=1e-9)


def test_relaxation_is_the_same_branch_as_a_network_would_be():
    branch = effects.DielectricRelaxation(capacitance=15e-9, time_constant=5e-3)
    effect = simulate(System(dataclasses.replace(PLAIN, effects=(branch,)), shunts.Open()), DRIVE)
    network = shunts.Network(netlist=f"C1 1 2 15n\nR1 2 0 {5e-3 / 15e-9!r}")
    shunt = simulate(System(PLAIN, network), DRIVE)
    assert effect.displacement_amplitude == pytest.approx(shunt.displacement_amplitude, rel=1e-10)
    assert effect.energy["dielectric_relaxation"] == pytest.approx(shunt.energy["shunt_loss"], rel=1e-9)
    assert np.abs(effect.waveforms.current).max() < 1e-9 * np.abs(shunt.waveforms.current).max()
