"""Errors that all samples of a record have in common: a few shapes of unknown size, beside white noise.

Where a circuit switches, the amplitude and the phase of a drive, which its noise leaves uncertain, act otherwise than
the linear response that noise is filtered by. White noise w with such errors, w + U a with a ~ N(0, 1), is white again
after multiplication by (1 + U U')^(-1/2): each shape is reduced to the size of noise (Rasmussen & Williams, Gaussian
Processes for Machine Learning, 2006, section 2.7: explicit basis functions).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.identify.noise.spectra import parts


class CommonErrors(NamedTuple):
    """Common errors in whitened spectra.

    Attributes
    ----------
    shapes : (n, channels, f) complex array
        Of unit length, at right angles to each other.
    reductions : (n,) array
        Shares of the shapes that are taken away: 1 - (1 + s^2)^(-1/2), with s their size in units of noise.
    """

    shapes: np.ndarray
    reductions: np.ndarray

    @classmethod
    def of(cls, spectra: np.ndarray) -> CommonErrors:
        """From whitened spectra (channels, n, f), one for each shape, of the size of a standard deviation."""
        columns = spectra.transpose(1, 0, 2)
        flat = parts(columns).reshape(len(columns), -1)
        left, sizes, _ = np.linalg.svd(flat @ flat.T, hermitian=True)
        kept = sizes > 0.0
        shapes = np.einsum("nk,ncf->kcf", left[:, kept] / np.sqrt(sizes[kept]), columns)
        return cls(shapes, 1.0 - 1.0 / np.sqrt(1.0 + sizes[kept]))

    def reduced(self, spectra: np.ndarray) -> np.ndarray:
        """Whitened spectra (channels, ..., f) with the errors reduced to white noise."""
        sizes = sum(
            np.tensordot(parts(each), parts(shape), (-1, -1))
            for each, shape in zip(spectra, self.shapes.transpose(1, 0, 2), strict=True)
        )
        return spectra - np.moveaxis(np.tensordot(self.reductions * sizes, self.shapes, 1), -2, 0)
