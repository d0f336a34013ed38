"""Netlists with laws that have no name run in ngspice, and say what the engine says."""

import pytest
from oracles.ngspice import needs_ngspice, run_netlist

from piezoharvest import Resistor, SineForce, System, Transducer, simulate
from piezoharvest.description.effects.nameless.forms import Corners, Knee, Line
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Play, Relaxation, Resonance
from piezoharvest.description.effects.nameless.places import Capacitor, Damper, Load, Spring
from piezoharvest.description.effects.nameless.shapes import Coulomb
from piezoharvest.spice import export_spice

DAMPED = {"mass": 0.010, "damping": 0.6, "stiffness": 986.96, "coupling": 3e-4, "capacitance": 40e-9}
SINE = SineForce(amplitude=0.02, frequency=48.0)
LAWS = [
    Law(place=Load(), form=Knee(factor=2e-5, knee=0.3)),
    Law(place=Spring(), form=Line(factor=80.0), memory=Play(threshold=2e-5)),
    Law(place=Capacitor(), form=Line(factor=-6e-9), memory=Play(threshold=0.5)),
    Law(place=Spring(), form=Line(factor=-60.0), memory=Relaxation(time_constant=4e-3)),
    Law(place=Spring(), form=Line(factor=-60.0), memory=Resonance(frequency=70.0, damping_ratio=0.3)),
    Law(place=Capacitor(), form=Line(factor=2e-8), memory=Relaxation(time_constant=4e-3)),
    Law(place=Damper(), form=Coulomb(factor=2e-3, width=2e-3, knots=(0.0, 2e-3, 0.05, -0.0, -2e-3, -0.05))),
    Law(place=Damper(), form=Corners(knots=(0.01, -0.01), kinks=(0.1, -0.1))),
]  # fmt: skip


QUICK = ("load knee", "spring relaxation")
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
