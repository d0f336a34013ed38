"""Exponentials of a step of a sample: against those of the whole chain, and closed forms of stiff equations."""

import numpy as np
import pytest
from scipy.linalg import expm

from piezoharvest.predict.parameters import STEP
from piezoharvest.predict.sample_step import DEGREE, _exponentials

RATES = np.array([[-0.3, 2.0, 0.1], [-2.5, -0.2, 0.7], [0.0, -0.9, -1.4]])
CHANGE = np.array([[0.2, -1.0, 0.0], [0.4, 0.0, 3.0], [1.0, -0.5, 0.1]])


def chain(A: np.ndarray) -> np.ndarray:
    """Upper rows of the exponential of A followed by integrators."""
    n = len(A)
    whole = np.zeros(((DEGREE + 2) * n,) * 2, A.dtype)
    whole[:n, :n] = A
    whole[np.arange((DEGREE + 1) * n), np.arange(n, (DEGREE + 2) * n)] = 1.0
    return expm(whole)[:n]


@pytest.mark.parametrize("size", [0.0, 0.01, 1.0, 20.0])
def test_functions_of_a_matrix_are_the_exponential_of_a_chain_of_integrators(size):
    np.testing.assert_allclose(_exponentials(size * RATES), chain(size * RATES), rtol=0, atol=2e-14 * (1 + size))


@pytest.mark.parametrize("size", [0.01, 1.0, 20.0])
def test_a_complex_step_gives_the_derivative(size):
    several = size * np.array([RATES, RATES + 1j * STEP * CHANGE])
    found, varied = _exponentials(several)
    wanted = chain(size * (RATES + 1e-100j * CHANGE)).imag / 1e-100
    np.testing.assert_allclose(varied.imag / STEP, wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())
    assert not np.any(found.imag)
    np.testing.assert_array_equal(found.real, _exponentials(size * RATES))


def test_a_slow_state_beside_a_fast_one_keeps_its_digits():
    """Squaring e^A itself would double the rounding of one minus a small share two dozen times."""
    fast, slow, into = 3e7, 1e-3, 5.0
    top = _exponentials(np.array([[-fast, into], [0.0, -slow]]))
    wanted = np.array([[0.0, into * np.exp(-slow) / (fast - slow)], [0.0, np.exp(-slow)]])
    np.testing.assert_allclose(top[:, :2], wanted, rtol=1e-14, atol=1e-30)
    np.testing.assert_allclose(top[1, 3], -np.expm1(-slow) / slow, rtol=1e-14)


def test_equations_out_of_the_range_of_numbers_have_no_step_and_no_error():
    with np.errstate(over="ignore", invalid="ignore"):  # as `step_of`
        assert np.all(np.isnan(_exponentials(np.array([[np.inf, 1.0], [0.0, -1.0]]))))
        _exponentials(1e200 * RATES)
