"""Errors that a whole record has in common, beside white noise, are reduced to it."""

import numpy as np
import pytest

from piezoharvest.identify.noise.spectra import line_spectra, parts
from piezoharvest.identify.noise.switching.common_errors import CommonErrors

CHANNELS, SHAPES, SAMPLES = 3, 2, 61


def flat(spectra):
    """Spectra (channels, n, f) as rows of real numbers, (n, all)."""
    return parts(spectra).transpose(1, 0, 2).reshape(spectra.shape[1], -1)


def test_equals_the_inverse_root_of_the_covariance():
    rng = np.random.default_rng(3)
    shapes = line_spectra(5.0 * rng.standard_normal((CHANNELS, SHAPES, SAMPLES)))
    values = line_spectra(rng.standard_normal((CHANNELS, 4, SAMPLES)))
    U = flat(shapes).T
    sizes, vectors = np.linalg.eigh(np.eye(len(U)) + U @ U.T)
    expected = flat(values) @ (vectors / np.sqrt(sizes)) @ vectors.T
    common = CommonErrors.of(shapes)
    np.testing.assert_allclose(flat(common.reduced(values)), expected, atol=1e-10)
    np.testing.assert_allclose(common.reduced(values[:, 1]), common.reduced(values)[:, 1], atol=1e-12)


def test_what_is_white_with_common_errors_has_unit_variance_in_their_direction():
    rng = np.random.default_rng(4)
    shape = 20.0 * rng.standard_normal((1, 1, SAMPLES))
    common = CommonErrors.of(line_spectra(shape))
    sizes = rng.standard_normal((1, 4000, 1))
    noisy = line_spectra(rng.standard_normal((1, 4000, SAMPLES)) + sizes * shape)
    along = flat(common.reduced(noisy)) @ flat(common.shapes.transpose(1, 0, 2))[0]
    assert np.var(along) == pytest.approx(1.0, rel=0.1)
