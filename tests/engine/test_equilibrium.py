"""Equilibrium of smooth elements under a constant drive, against the root of a quadratic equation."""

import numpy as np
import pytest

from piezoharvest.engine.lowering.equilibrium import _nonlinear_equilibrium
from piezoharvest.equations.terms import SmoothElement

SQUARE = SmoothElement("square", np.zeros(0), np.zeros(0), 2)


@pytest.mark.parametrize("factor", [-0.5, 0.1, 0.2])
def test_a_square_of_the_state_adds_what_the_quadratic_formula_says(factor):
    """Equation z = 1 + factor z^2, of whose roots that is meant which is one without the square."""
    found = _nonlinear_equilibrium(
        [SQUARE], np.array([1.0]), np.array([[factor]]), np.array([[1.0], [0.0]]), np.array([[0.0], [0.0]])
    )
    assert found == pytest.approx([(1.0 - np.sqrt(1.0 - 4.0 * factor)) / (2.0 * factor)], rel=1e-12)


def test_an_input_that_is_zero_but_for_rounding_does_nothing():
    """The equation w = w^2 has another root, one, at which nothing is at rest."""
    rest = np.array([0.1, 0.2, 0.3])
    inputs = np.array([[1.0, 1.0, -1.0], [0.0, 0.0, 0.0]])
    assert (inputs @ rest)[0] != 0.0  # 5.6e-17
    found = _nonlinear_equilibrium([SQUARE], rest, np.ones((3, 1)), inputs, np.zeros((2, 1)))
    np.testing.assert_allclose(found, rest, rtol=1e-12)
