"""Scales of what is beside the states: of the constant, and of smooth elements that act through others alone."""

import numpy as np
import pytest

from piezoharvest import Rectifier, Resistor, SineForce, StepForce, System, Transducer
from piezoharvest.description.effects.nameless.forms import Bends, Monomial
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import Coupling, Spring
from piezoharvest.engine.lowering.element_scales import influences
from piezoharvest.engine.lowering.lower import IDLE_SCALE, lower
from piezoharvest.engine.memory.program import DERIVATIVES
from piezoharvest.equations.pieces import broken_line
from piezoharvest.equations.terms import PIECEWISE, PRODUCT, SmoothElement

BEAM = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1e-3, "capacitance": 40e-9}
SINE = SineForce(amplitude=0.1, frequency=50.0)


@pytest.mark.parametrize("drop", [1e-9, 1e-3, 1.0, 1e6])
@pytest.mark.parametrize("drive", [SINE, StepForce(amplitude=0.1, duration=0.1, rise_time=0.01)])
def test_the_constant_is_never_scaled_beyond_the_drive(drive, drop):
    """Rounding is judged by the scaled state: a constant of a small drop would hide in it, or the drive's value would.

    Of a sampled drive the value counts, not its slope, whose scale is larger by the resonance frequency.
    """
    shunt = Rectifier(smoothing_capacitance=1e-6, load_resistance=1e6, diode_drop=drop)
    scale = lower(System(Transducer(**BEAM), shunt), drive).program.exo_scale
    assert len(scale) == 3  # of the drive's two, and of the constant
    assert scale[-1] <= scale[0]
    if drop < 1e-6:
        assert scale[-1] == scale[0]


@pytest.mark.parametrize(
    ("place", "form"),
    [
        (Coupling(), Monomial(factor=2e-6 / 3, scale=1e-3, exponent=3)),
        (Spring(), Bends(knots=(2e-4, -2e-4), kinks=(2e6, -2e6))),
    ],
)
def test_an_element_that_acts_through_another_has_a_scale(place, form):
    """The slope of a coupling's law, the hinges of a bent spring: out of scale, they were as if they were not there."""
    device = Transducer(**BEAM, effects=(Law(place=place, form=form),))
    program = lower(System(device, Resistor(resistance=1e5)), SINE).program
    scales = program.exo_scale[: DERIVATIVES * len(program.element_power) : DERIVATIVES]
    assert np.all(scales > 0.0)
    assert np.all(scales < 1e-9 * IDLE_SCALE)


def test_an_influence_is_a_derivative_through_the_elements_behind():
    """The square s of an input a hinge h, and their product p, which alone acts on the motion with the force 5 p."""
    none, hinge = np.zeros(0), broken_line([(1.0, 0.2, 1.0)])
    kinds = ((2, None), (PIECEWISE, hinge), (PRODUCT, None))
    elements = [SmoothElement("", none, none, power, pieces) for power, pieces in kinds]
    direct = np.array([0.0, 0.0, 5.0])
    own = np.array([[3.0, 0.0], [0.5, 0.0], [0.0, 0.0]])
    of_outputs = np.zeros((3, 2, 3))
    of_outputs[2, 0, 0], of_outputs[2, 1, 1] = 1.0, 2.0  # p = s (2 h)
    found = influences(elements, direct, own, of_outputs)
    np.testing.assert_allclose(found, [5.0 * 2.0 * 0.5, 5.0 * 9.0 * 2.0, 5.0], rtol=1e-14)
