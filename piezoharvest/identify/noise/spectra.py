"""Spectra of real signals scaled to preserve the sum of squares, and their products; frequencies are the last axis."""

from __future__ import annotations

import numpy as np
from scipy import fft


def whitened(white: np.ndarray, spectra: np.ndarray) -> np.ndarray:
    """Products of lower triangular matrices (channels, channels, f) with spectra (channels, ..., f).

    With the frequencies last, this is much faster than a product of small matrices for every frequency.
    """
    found = np.empty_like(spectra)
    for a in range(len(white)):
        np.multiply(spectra[0], white[a, 0], out=found[a])
        for b in range(1, a + 1):
            found[a] += spectra[b] * white[a, b]
    return found


def parts(spectra: np.ndarray) -> np.ndarray:
    """Real and imaginary parts of spectra side by side: (..., 2 f)."""
    return np.ascontiguousarray(spectra).view(float)


def gram(D: np.ndarray) -> np.ndarray:
    """Real part of D D^H summed over channels, (p, p), for spectra (channels, p, f)."""
    return sum((part @ part.T for part in parts(D)), np.zeros((D.shape[1],) * 2))


def components(count: int) -> np.ndarray:
    """Number of real components of each line of a real spectrum: two, but one at zero and at half the sample rate."""
    found = np.full(count // 2 + 1, 2.0)
    found[0] = 1.0
    if count % 2 == 0:
        found[-1] = 1.0
    return found


def first_lines(edges: np.ndarray, count: int) -> np.ndarray:
    """First line at or above each edge, in cycles per sample, of the spectrum of `count` samples; at most its length.

    An edge on a line counts as that line, whatever its rounding error.
    """
    return np.minimum(np.ceil(edges * count * (1.0 - 1e-9)), count // 2 + 1).astype(int)


def line_spectra(values: np.ndarray) -> np.ndarray:
    """Spectra as those of `spectra_of`, along the last axis."""
    count = values.shape[-1]
    found = fft.rfft(values)
    found *= np.sqrt(components(count) / count)
    return found


def in_time(spectra: np.ndarray, count: int) -> np.ndarray:
    """Weights of samples, (samples, p), equivalent to weights of their `spectra_of`."""
    return np.fft.irfft(spectra * np.sqrt(count / components(count))[:, None], count, axis=0)
