"""Springs without a name whose resonance has two motions under large drives: found as under small ones."""

import numpy as np
import pytest
from diagnose.swept import TRUE, campaign

from piezoharvest.diagnose import diagnose


def found_in(seed, spring):
    """The only law that a diagnosis finds, and the stiffness beside it."""
    found = diagnose(campaign("white", seed, spring=spring))
    assert found.verdict == "new_effect", (found.verdict, found.effects)
    (discovery,) = found.discovery
    assert (discovery.law.place.name, discovery.law.place.input) == ("spring", "displacement")
    assert discovery.gain > 0.95
    for estimate in found.estimates:
        name = estimate.parameter.name
        if name != "stiffness":  # the straight line of the law is a part of it
            assert abs(estimate.value - TRUE[name]) < 4.5 * estimate.std, name
    (stiffness,) = (each for each in found.estimates if each.parameter.name == "stiffness")
    return discovery.law.form, stiffness


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_spring_that_saturates(seed):
    """0.6 N tanh(x/0.4 mm): the model without it was in the other motion, and a table at the capacitor did best."""
    form, stiffness = found_in(seed, lambda x: 0.6 * np.tanh(x / 4e-4))
    assert (form.curve, form.bent) == ("tanh", True)
    assert [form.factor, form.scale] == pytest.approx([0.6, 4e-4], rel=3e-3)
    assert stiffness.value == pytest.approx(TRUE["stiffness"] + 0.6 / 4e-4, rel=1e-3)


@pytest.mark.slow
def test_a_spring_that_hardens_exponentially():
    """Where drives are small it is any of seven formulas: all of them are fitted to all records."""
    form, stiffness = found_in(1, lambda x: 0.84 * np.sinh(x / 8e-4))
    assert (form.curve, form.bent) == ("sinh", True)
    assert [form.factor, form.scale] == pytest.approx([0.84, 8e-4], rel=3e-3)
    assert stiffness.value == pytest.approx(TRUE["stiffness"] + 0.84 / 8e-4, rel=1e-3)


@pytest.mark.slow
def test_a_spring_that_softens_with_the_square():
    form, stiffness = found_in(1, lambda x: -1.2e6 * x * np.abs(x))
    assert form.exponent == pytest.approx(2.0, abs=0.05)
    size = 1e-3
    assert form.values(np.array([size]))[0] == pytest.approx(-1.2e6 * size**2, rel=3e-3)
    assert stiffness.value == pytest.approx(TRUE["stiffness"], rel=1e-3)
