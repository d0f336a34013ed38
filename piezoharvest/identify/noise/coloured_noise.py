"""Coloured noise in a least-squares fit: covariance, and effective number of samples."""

from __future__ import annotations

import numpy as np


def autocovariance(residual: np.ndarray) -> np.ndarray:
    """Autocovariance at all lags, tapered by the quadratic spectral kernel with Andrews' bandwidth; (samples,).

    Source: Andrews, Econometrica 59(3), 817-858, 1991, equations 2.7, 6.2 and 6.4 (an autoregression of order 1 gives
    the bandwidth).
    """
    count = len(residual)
    spectrum = np.abs(np.fft.rfft(residual, 2 * count)) ** 2
    lags = np.fft.irfft(spectrum)[:count] / count
    if lags[0] == 0:
        return lags
    rho = float(np.clip(lags[1] / lags[0], 0.0, 0.999)) if count > 1 else 0.0
    bandwidth = max(1.3221 * (4 * rho**2 / (1 - rho) ** 4 * count) ** 0.2, 1e-9)
    x = 6 * np.pi / 5 * np.arange(1, count) / bandwidth
    taper = 3 / x**2 * (np.sin(x) / x - np.cos(x))
    return lags * np.concatenate(([1.0], taper))


def effective_samples(residual: np.ndarray) -> float:
    """Number of independent samples with the same information about a mean: fewer if the noise is coloured."""
    lags = autocovariance(residual)
    if lags[0] == 0:
        return float(len(residual))
    return float(np.clip(len(residual) * lags[0] / (lags[0] + 2 * lags[1:].sum()), 2.0, len(residual)))


def covariance(jacobian: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Covariance of least-squares estimates whose residual is coloured: the sandwich (J'J)^-1 J'RJ (J'J)^-1.

    Parameters
    ----------
    jacobian : (samples, n) array
        Derivatives of the prediction, of full rank.
    residual : (samples,) array
        Consecutive samples at a constant rate.

    Returns
    -------
    (n, n) array
    """
    from scipy.linalg import matmul_toeplitz, pinv

    lags = autocovariance(residual) * len(residual) / max(len(residual) - jacobian.shape[1], 1)
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    scaled = jacobian / scale
    inverse = pinv(scaled.T @ scaled)
    middle = scaled.T @ matmul_toeplitz(lags, scaled)
    return inverse @ (0.5 * (middle + middle.T)) @ inverse / np.outer(scale, scale)
