"""Resonances of a measured frequency response, estimated without nominal values.

Poles are added one by one, each where it explains most of the residual, tried at many lines and dampings: for a given
pole, the residue is a linear least-squares solution. So a peak between two lines is found as well. Vector fitting then
refines all of them together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.identify.frequency.vector_fitting import VectorFit, basis_of, vector_fit

MAX_PLACES = 120  # most lines at which a pole is tried, those with the largest residuals
DAMPINGS = np.geomspace(1e-6, 0.3, 17)  # damping ratios that are tried
OUTSIDE_FACTOR = 1.5  # factor outside the band at which poles are tried, too, because they act within it
RELOCATIONS = 8
MIN_F_RATIO = 8.0  # least F ratio (4 degrees of freedom) of a pole, by chance with a probability of 1e-5
MAX_RESONANCE_DAMPING = 0.5  # damping ratio from which on a pole does not count as a resonance


class MeasuredResonances(NamedTuple):
    """Rational function that fits a response, D + sum R/(s - p) + conjugates.

    Attributes
    ----------
    poles, residues : (k,) array of complex
        rad/s; of resonances only, the strongest first.
    direct : float
        D.
    error : float
        Sum of squares of the misfit in units of the noise.
    values : (f,) complex array
        Of the whole function, including poles that are not resonances.
    count : int
        Number of its real coefficients.
    slopes : (f, count) complex array
        Derivatives of the values with respect to these coefficients.
    """

    poles: np.ndarray
    residues: np.ndarray
    direct: float
    error: float
    values: np.ndarray
    count: int
    slopes: np.ndarray


def resonances(frequency: np.ndarray, response: np.ndarray, sigma: np.ndarray, most: int) -> MeasuredResonances:
    """Resonances of a response that tends to a constant at high frequencies.

    Parameters
    ----------
    frequency : (f,) array
        Hz.
    response : (f,) complex array
    sigma : (f,) array
        Standard deviation of the noise in each of real and imaginary part.
    most : int
        Largest number of poles.
    """
    top, size = 2.0 * np.pi * float(frequency.max()), float(np.sqrt(np.mean(np.abs(response) ** 2)))
    s, target, weight = 2j * np.pi * frequency / top, response / size, size / sigma
    fit = vector_fit(s, target[:, None], np.zeros(0, complex), 0, weight)
    for count in range(1, most + 1):
        if 2 * len(s) <= 4 * count + 4:
            break
        begin = np.append(fit.poles, _next_pole(s, target, weight, fit.poles))
        better = _best_fit(s, target, weight, begin)
        degrees = 2 * len(s) - 4 * count - 1
        if fit.error**2 - better.error**2 < MIN_F_RATIO * 4.0 * better.error**2 / degrees:
            break
        fit = better
    values = (basis_of(s, fit.poles) @ _coefficients(fit))[:, 0] + fit.direct[0]
    return _strongest(fit, s, weight, top, size, values)


def _best_fit(s: np.ndarray, target: np.ndarray, weight: np.ndarray, poles: np.ndarray) -> VectorFit:
    """The best of the iterates of vector fitting."""
    best = fit = vector_fit(s, target[:, None], poles, 0, weight)
    for _ in range(RELOCATIONS):
        fit = vector_fit(s, target[:, None], fit.poles, 1, weight)
        best = min(best, fit, key=lambda each: each.error)
    return best


def _next_pole(s: np.ndarray, target: np.ndarray, weight: np.ndarray, poles: np.ndarray) -> complex:
    """The pole that explains most of the residual of the given poles."""
    own = np.column_stack((basis_of(s, poles), np.ones(len(s))))
    known, _ = np.linalg.qr(_real(weight[:, None] * own) / np.linalg.norm(_real(weight[:, None] * own), axis=0))
    left = _real((weight * target)[:, None])[:, 0]
    left = left - known @ (known.T @ left)
    lines = np.argsort(-(left[: len(s)] ** 2 + left[len(s) :] ** 2))[:MAX_PLACES]
    omega = np.imag(s)
    places = np.concatenate([omega[np.sort(lines)], [omega.min() / OUTSIDE_FACTOR, omega.max() * OUTSIDE_FACTOR]])
    places = np.union1d(places, 0.5 * (places[1:] + places[:-1]))
    best, found = -1.0, 0j
    for damping in DAMPINGS:
        tried = -damping * places + 1j * places
        one, other = 1.0 / (s[:, None] - tried), 1.0 / (s[:, None] - tried.conj())
        columns = [_real(weight[:, None] * part) for part in (one + other, 1j * (one - other))]
        columns = [column - known @ (known.T @ column) for column in columns]
        taken = _explained_squares(*columns, left)
        if taken.max() > best:
            best, found = float(taken.max()), complex(tried[np.argmax(taken)])
    return found


def _explained_squares(first: np.ndarray, second: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Decrease of the residual's squares by each pair of columns, (tried,)."""
    a, b, c = (np.einsum("ft,ft->t", *pair) for pair in ((first, first), (first, second), (second, second)))
    p, q = first.T @ left, second.T @ left
    determinant = a * c - b**2
    sound = determinant > 1e-10 * a * c
    both = (c * p**2 - 2.0 * b * p * q + a * q**2) / np.where(sound, determinant, 1.0)
    return np.where(sound, both, np.maximum(p**2 / np.maximum(a, 1e-300), q**2 / np.maximum(c, 1e-300)))


def _coefficients(fit: VectorFit) -> np.ndarray:
    """Real factors of the partial fractions, (order, 1)."""
    parts = [[residue.real] if pole.imag == 0 else [residue.real, residue.imag]
             for pole, residue in zip(fit.poles, fit.residues[:, 0], strict=True)]  # fmt: skip
    return np.array([part for some in parts for part in some]).reshape(-1, 1)


def _strongest(
    fit: VectorFit, s: np.ndarray, weight: np.ndarray, top: float, size: float, values: np.ndarray
) -> MeasuredResonances:
    """Result in rad/s and the response's unit, with the resonances sorted by their weight in the response."""
    chosen = [k for k, pole in enumerate(fit.poles) if pole.imag > 0 and -pole.real < MAX_RESONANCE_DAMPING * abs(pole)]
    weights = [float(np.linalg.norm(weight * fit.residues[k, 0] / (s - fit.poles[k]))) for k in chosen]
    order = [chosen[n] for n in np.argsort(weights)[::-1]]
    return MeasuredResonances(
        fit.poles[order] * top, fit.residues[order, 0] * size * top, float(np.real(fit.direct[0])) * size,
        fit.error**2, values * size, 1 + sum(1 if pole.imag == 0 else 2 for pole in fit.poles) * 2, _slopes(fit, s),
    )  # fmt: skip


def _slopes(fit: VectorFit, s: np.ndarray) -> np.ndarray:
    """Derivatives by residues, poles and the direct term, one for each real coefficient; of any scale."""
    own = basis_of(s, fit.poles)
    columns = [np.ones(len(s), complex), *own.T]
    for pole, residue in zip(fit.poles, fit.residues[:, 0], strict=True):
        one, other = residue / (s - pole) ** 2, residue.conjugate() / (s - pole.conjugate()) ** 2
        columns += [one] if pole.imag == 0 else [one + other, 1j * (one - other)]
    return np.array(columns).T


def _real(values: np.ndarray) -> np.ndarray:
    return np.concatenate((np.real(values), np.imag(values)))
