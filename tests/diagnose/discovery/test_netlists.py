"""Netlists with laws that have no name run in ngspice, and say what the engine says."""

import pytest
from oracles.ngspice import needs_ngspice, run_netlist

from piezoharvest import Resistor, SineForce, System, Transducer, simulate
from piezoharvest.description.effects.nameless.forms import Bends, Corners, Knee, Line
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import LateBy, Play, Relaxation, Resonance
from piezoharvest.description.effects.nameless.places import Capacitor, Damper, Load, LoadCurrent, Spring
from piezoharvest.description.effects.nameless.shapes import Coulomb, Shape, Stribeck
from piezoharvest.spice import export_spice

DAMPED = {"mass": 0.010, "damping": 0.6, "stiffness": 986.96, "coupling": 3e-4, "capacitance": 40e-9}
SINE = SineForce(amplitude=0.02, frequency=48.0)
AHEAD = Relaxation(time_constant=3e-3, behind=True)
LAWS = [
    Law(place=Load(), form=Knee(factor=2e-5, knee=0.3)),
    Law(place=LoadCurrent(), form=Line(factor=1.0), memory=AHEAD),
    Law(place=LoadCurrent(), form=Line(factor=1.0), memory=LateBy(delay=2e-3)),
    Law(place=Spring(), form=Line(factor=80.0), memory=Play(threshold=2e-5)),
    Law(place=Capacitor(), form=Line(factor=-6e-9), memory=Play(threshold=0.5)),
    Law(place=Spring(), form=Line(factor=-60.0), memory=Relaxation(time_constant=4e-3)),
    Law(place=Spring(), form=Line(factor=-60.0), memory=Resonance(frequency=70.0, damping_ratio=0.3)),
    Law(place=Capacitor(), form=Line(factor=2e-8), memory=Relaxation(time_constant=4e-3)),
    Law(place=Damper(), form=Coulomb(factor=2e-3, width=2e-3)),
    Law(place=Damper(), form=Stribeck(factor=2e-3, width=2e-3, excess=1.0, speed=0.02)),
    Law(place=Spring(), form=Shape(factor=4e-3, scale=5e-5, curve="tanh", bent=False)),
    Law(place=Spring(), form=Shape(factor=4e-3, scale=1e-4, curve="exponential", bent=True)),
    Law(place=Spring(), form=Shape(factor=4e-3, scale=1e-4, curve="sinh", bent=True)),
    Law(place=Spring(), form=Shape(factor=4e-3, scale=5e-5, curve="log", bent=False)),
    Law(place=Capacitor(), form=Shape(factor=4e-8, scale=0.3, curve="langevin", bent=False)),
    Law(place=Spring(), form=Shape(factor=-4e-3, scale=3e-5, curve="tanh", bent=False), memory=AHEAD),
    Law(place=Spring(), form=Knee(factor=200.0, knee=0.0, sides=1)),
    Law(place=Spring(), form=Bends(knots=(0.0, -0.0, 5e-5), kinks=(2e6, 3e6, -1e6))),
    Law(place=Damper(), form=Corners(knots=(0.01, -0.01), kinks=(0.1, -0.1))),
]  # fmt: skip


QUICK = ("load knee", "spring relaxation", "spring tanh", "capacitor langevin")
CASES = [
    pytest.param(law, id=f"{law.name} {law.form.word}", marks=() if law.name in QUICK else pytest.mark.slow)
    for law in LAWS
]


@needs_ngspice
@pytest.mark.parametrize("law", CASES)
def test_a_netlist_with_a_law_says_what_the_engine_says(law):
    transducer, shunt = Transducer(**DAMPED, effects=(law,)), Resistor(resistance=8e4)
    response = simulate(System(transducer, shunt), SINE)
    plain = simulate(System(Transducer(**DAMPED), shunt), SINE)
    found = run_netlist(export_spice(transducer, shunt, SINE))
    assert response.converged
    wanted = {
        "harvested_power": response.harvested_power, "mechanical_power": response.mechanical_power,
        "displacement_pp": 2 * response.displacement_amplitude, "voltage_pp": 2 * response.voltage_amplitude,
    }  # fmt: skip
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, rel=2e-3), name
    assert response.harvested_power != pytest.approx(plain.harvested_power, rel=5e-3)  # it matters
