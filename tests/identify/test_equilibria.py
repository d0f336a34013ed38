"""Where a record begins: the equilibrium of a spring with any curve, however much of its stiffness that is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from piezoharvest import Resistor, Transducer
from piezoharvest.description.effects.nameless.curves import CURVES
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import Spring
from piezoharvest.description.effects.nameless.shapes import SCALED, Shape
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.parameters import parameters_of, put, value_at
from piezoharvest.predict.prediction import Prediction

DEVICE = Transducer(mass=0.0123, damping=0.21, stiffness=4200.0, coupling=2.1e-3, capacitance=62e-9)


def first_of(device, force, parameters=()):
    """Displacement of the first sample under a constant force, and its derivatives."""
    setting = setting_of("force", Resistor(resistance=150e3), 2.5e-4, np.full(8, force), device)
    prediction = Prediction(device, setting, parameters)
    (block,) = prediction.blocks(bool(parameters))
    n = prediction.channels.index("displacement")
    return block.values[0, n], (block.derivatives[0, n] if parameters else None)


def with_curve(curve, share, scale, *, bent):
    """A spring whose curve is this share of its stiffness at rest; of it a bent one has less of its own."""
    slope = {"langevin": 1.0 / 3.0}.get(curve, 1.0)
    law = Law(place=Spring(), form=Shape(factor=share * 4200.0 * scale / slope, scale=scale, curve=curve, bent=bent))
    return replace(DEVICE, stiffness=4200.0 * (1.0 + share if bent else 1.0), effects=(law,))


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(SCALED), st.floats(0.05, 20.0), st.floats(1e-4, 5e-3), st.floats(-3.0, 3.0), st.booleans(),
)  # fmt: skip
def test_a_record_begins_where_the_forces_balance(curve, share, scale, force, bent):
    """Iterated from the straight line, curves of more than half of the stiffness ran away."""
    device = with_curve(curve, share, scale, bent=bent)
    factor = device.effects[0].form.factor

    def excess(x):
        return 4200.0 * x + factor * float(CURVES[curve](np.float64(x / scale))) - force

    reach = abs(force) / 4200.0 + 1e-12
    wanted = brentq(excess, -reach, reach, xtol=1e-18, rtol=1e-14)
    found, _ = first_of(device, force)
    assert found == pytest.approx(wanted, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("curve", SCALED)
def test_derivatives_of_an_equilibrium(curve):
    device = with_curve(curve, 3.0, 5e-4, bent=True)
    parameters = tuple(p for p in parameters_of(device, {"force"}) if p.path == ("stiffness",))
    _, slopes = first_of(device, 2.0, parameters)
    (parameter,) = parameters
    inner, h = parameter.inner(value_at(device, parameter.path)), 1e-6
    ends = [first_of(put(device, parameter.path, parameter.outer(inner + s * h)), 2.0)[0] for s in (1, -1)]
    assert slopes[0] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-6)
