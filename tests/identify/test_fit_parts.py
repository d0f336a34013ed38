"""Parts of the fit against what they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from piezoharvest.identify.descent import _bent
from piezoharvest.identify.gain import _solved
from piezoharvest.identify.spectra import gram, whitened


def test_a_secant_has_the_curvature_along_its_step_and_stays_that_of_a_minimum():
    rng = np.random.default_rng(0)
    root, step = rng.standard_normal((5, 5)), rng.standard_normal(5)
    curvature = root @ root.T
    information = 0.6 * curvature
    bend = _bent(np.zeros((5, 5)), information, step, curvature @ step)
    np.testing.assert_allclose((information + bend) @ step, curvature @ step)
    assert np.linalg.eigvalsh(bend).min() > -1e-12
    # Where the information already is too much, it is left alone.
    assert not np.any(_bent(np.zeros((5, 5)), 2.0 * curvature, step, curvature @ step))


@pytest.mark.parametrize("n", [1, 3, 8])
def test_states_and_rows_by_the_schur_form_are_those_of_the_inverse(n):
    rng = np.random.default_rng(n)
    kept, A = np.eye(n) + 0.1 * rng.standard_normal((n, n)), 0.5 * rng.standard_normal((n, n))
    A[0] = 0.0  # an eigenvalue of zero, as of a state that has died away within a sample
    turn = np.exp(1j * np.linspace(0.01, np.pi, 50))
    forced, rows = rng.standard_normal((n, 50)) + 1j * rng.standard_normal((n, 50)), rng.standard_normal((2, n))
    states, left = _solved(kept, A, turn, forced, rows)
    inverse = np.linalg.inv(turn[:, None, None] * kept - A)
    np.testing.assert_allclose(states, np.einsum("fij,jf->if", inverse, forced), rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(left, np.einsum("ci,fij->cjf", rows, inverse), rtol=1e-9, atol=1e-11)


def test_products_with_the_frequencies_last_are_those_of_matrices():
    rng = np.random.default_rng(1)
    white = np.tril(rng.standard_normal((7, 3, 3)) + 1j * rng.standard_normal((7, 3, 3)))
    spectra = rng.standard_normal((7, 3, 4)) + 1j * rng.standard_normal((7, 3, 4))
    found = whitened(np.ascontiguousarray(white.transpose(1, 2, 0)), np.ascontiguousarray(spectra.transpose(1, 2, 0)))
    np.testing.assert_allclose(found.transpose(2, 0, 1), white @ spectra)
    flat = (white @ spectra).reshape(-1, 4)
    np.testing.assert_allclose(gram(found), np.real(flat.conj().T @ flat))
