"""Formulas of laws in words, at places whose values or inputs have no unit."""

import re

import pytest

from piezoharvest.description.effects.nameless.forms import (
    Corners,
    DeadZone,
    Knee,
    Line,
    Monomial,
    Polynomial,
    Power,
    TwoKnees,
)
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Play
from piezoharvest.description.effects.nameless.places import GainOverTime, OverTime, Spring
from piezoharvest.description.effects.nameless.shapes import Bump, Coulomb, Shape, StepChange, Stribeck
from piezoharvest.diagnose.discovery.forms.wording import formula

FORMS = (
    Line(factor=-0.0781), Line(factor=0.1, start=2.0), Knee(factor=0.1, knee=2.0), DeadZone(factor=0.1, zone=2.0),
    TwoKnees(factor=0.1, second=0.2, upper=2.0, lower=-1.0), Power(factor=0.1, exponent=1.5, scale=2.0),
    Power(factor=0.1, exponent=1.5, scale=2.0, side=1), Monomial(factor=0.1, scale=2.0, exponent=2),
    Polynomial(factor=0.1, second=0.2, scale=2.0, exponents=(2, 3)), Coulomb(factor=0.1, width=1e-3),
    Stribeck(factor=0.1, excess=0.5, speed=2.0, width=1e-3), StepChange(factor=0.1, at=2.0, width=0.1),
    Bump(factor=0.1, at=2.0, width=1.0),
    Shape(factor=0.1, scale=2.0, curve="exponential", bent=False), Shape(factor=0.1, scale=2.0, curve="log", bent=True),
    Corners(knots=(1.0,), kinks=(0.1,)),
)  # fmt: skip
PLACES = (OverTime("stiffness"), OverTime("stiffness", "amplitude"), GainOverTime("voltage"), Spring())


@pytest.mark.parametrize("place", PLACES, ids=lambda place: f"{place.name} of {place.input}")
@pytest.mark.parametrize("memory", [None, Play(threshold=0.1)])
def test_what_has_no_unit_leaves_no_gap(place, memory):
    """It read "-0.0781  * amplitude"."""
    for form in FORMS:
        text = formula(Law(place=place, form=form, memory=memory))
        assert not re.search(r"  | [);,]|^ | $", text), text


def test_a_relative_change_has_no_unit():
    assert formula(Law(place=OverTime("stiffness", "amplitude"), form=Coulomb(factor=-0.0781, width=1.0))) == (
        "-0.0781 * sign(A)"
    )
