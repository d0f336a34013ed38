"""Vector fitting: common stable poles of several frequency responses, as the start of a fit of modes.

Sources: Gustavsen & Semlyen, IEEE Trans. Power Delivery 14(3), 1052-1061, 1999; Gustavsen, ibid. 21(3), 1587-1592,
2006 (relaxed); Deschrijver et al., IEEE Microwave and Wireless Components Letters 18(6), 383-385, 2008 (one QR a
response).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class VectorFit(NamedTuple):
    """Partial fractions that fit several responses.

    Attributes
    ----------
    poles : (k,) array of complex
        One of each pair, and real ones; the number of each may differ from that of the start.
    residues : (k, m) array of complex
    direct : (m,) array
    error : float
        Norm of the misfit.
    """

    poles: np.ndarray
    residues: np.ndarray
    direct: np.ndarray
    error: float


def vector_fit(
    s: np.ndarray, responses: np.ndarray, poles: np.ndarray, rounds: int = 15, weight: np.ndarray | float = 1.0
) -> VectorFit:
    """Poles and residues of sum_k R_k/(s - p_k) + D, R and p real or in conjugate pairs, all poles stable.

    Parameters
    ----------
    s : (f,) array of complex
        On the imaginary axis, scaled to the order of 1.
    responses : (f, m) array of complex
    poles : (n,) array of complex
        Start, one of each conjugate pair with positive imaginary part.
    rounds : int
        Relocations of the poles.
    weight : (f,) array or float
        Weight of each line's misfit.
    """
    count, poles, weight = len(s), np.asarray(poles, complex), np.broadcast_to(weight, len(s))[:, None]
    for _ in range(rounds):
        basis = basis_of(s, poles)
        own, shared = np.column_stack((basis, np.ones(count))), basis.shape[1] + 1
        blocks = []
        for response in responses.T:
            rows = _real(weight * np.hstack((own, -response[:, None] * own)))
            triangle = np.asarray(np.linalg.qr(rows, mode="r"))
            blocks.append(triangle[own.shape[1] :, own.shape[1] :])
        # Relaxed: the sum of the scaling function's real part is that of 1, instead of its value at infinity.
        size = np.linalg.norm(blocks) / count
        matrix = np.vstack((*blocks, size * own.sum(axis=0).real))
        right = np.zeros(len(matrix))
        right[-1] = size * count
        scale = np.linalg.norm(matrix, axis=0)
        solution = np.linalg.lstsq(matrix / scale, right)[0] / scale
        poles = _zeros(poles, solution[: shared - 1] / solution[-1])
    rows, wanted = _real(weight * np.column_stack((basis_of(s, poles), np.ones(count)))), _real(weight * responses)
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    found = np.linalg.lstsq(rows / scale, wanted)[0]
    error = float(np.linalg.norm(rows / scale @ found - wanted))
    found = found / scale[:, None]
    return VectorFit(poles, _residues(poles, found), found[-1], error)


def basis_of(s: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """Partial fractions with real coefficients, (f, order): two for each complex pair, one for a real pole."""
    columns = []
    for pole in poles:
        if pole.imag == 0:
            columns.append(1 / (s - pole.real))
        else:
            one, other = 1 / (s - pole), 1 / (s - pole.conjugate())
            columns += [one + other, 1j * (one - other)]
    return np.array(columns).reshape(-1, len(s)).T


def _zeros(poles: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Zeros of 1 + sum factors * basis: the poles of the next iteration, moved to the stable half plane."""
    order = len(factors)
    matrix, column, n = np.zeros((order, order)), np.zeros(order), 0
    for pole in poles:
        if pole.imag == 0:
            matrix[n, n], column[n] = pole.real, 1.0
            n += 1
        else:
            matrix[n : n + 2, n : n + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
            column[n] = 2.0
            n += 2
    zeros = np.linalg.eigvals(matrix - np.outer(column, factors))
    zeros = -np.abs(zeros.real) + 1j * zeros.imag
    return zeros[zeros.imag >= 0]


def _residues(poles: np.ndarray, found: np.ndarray) -> np.ndarray:
    rows, n = [], 0
    for pole in poles:
        rows.append(found[n] + (0 if pole.imag == 0 else 1j * found[n + 1]))
        n += 1 if pole.imag == 0 else 2
    return np.array(rows).reshape(len(poles), found.shape[1])


def _real(values: np.ndarray) -> np.ndarray:
    return np.concatenate((np.real(values), np.imag(values)))
