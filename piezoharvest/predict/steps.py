"""From equations to a step of one sample: exact for the linear part under a cubic drive and straight elements."""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from piezoharvest.predict.elements import outputs_of
from piezoharvest.predict.specimen import STOP, Matrices

REST = 50  # iterations to an equilibrium
DEGREE = 3  # of the drive between two samples


class Step(NamedTuple):
    """What advances a specimen by one sample.

    With g = [z, w, c0..c3, 1, time] (states, elements' outputs, the drive's coefficients in powers of the share of the
    step):
    z <- M g + H w and O as in `Matrices`. For derivatives every array has the parameters as its last axis.

    Attributes
    ----------
    M : (n, n + elements + 6) array
    H : (n, elements) array
    O : (2 inputs + outputs, n + elements + 4) array
    limits : (elements,) array
        Thresholds of stops, exponents of powers.
    """

    M: np.ndarray
    H: np.ndarray
    O: np.ndarray  # noqa: E741
    limits: np.ndarray


# A model that a fit tries may be so far off that nothing of it is finite: the march says so.
@np.errstate(over="ignore", invalid="ignore")
def step_of(matrices: Matrices, sample_time: float, share: float) -> Step:
    """Discretise.

    Parameters
    ----------
    matrices : Matrices
        Real, or with a complex step.
    sample_time : float
        s.
    share : float
        Of the record, that one step takes.
    """
    A, B, W, h = matrices.A, matrices.B, matrices.W, sample_time
    A = A if np.any(np.imag(A)) else np.real(A)  # an exponential of real numbers takes a quarter of the time
    n = len(A)
    chain = np.zeros(((DEGREE + 2) * n, (DEGREE + 2) * n), np.result_type(A, float))
    chain[:n, :n] = A * h
    for k in range(DEGREE + 1):
        chain[k * n : (k + 1) * n, (k + 1) * n : (k + 2) * n] = np.eye(n)
    top = expm(chain)[:n]
    # G[k]: integral of e^(A (h - s)) (s/h)^k ds.
    G = [h * factorial(k) * top[:, (k + 1) * n : (k + 2) * n] for k in range(DEGREE + 1)]
    drive, rate, one, time = B.T
    parts = [G[0] @ drive, *(G[k] @ drive + (k / h) * (G[k - 1] @ rate) for k in range(1, DEGREE + 1))]
    constant = G[0] @ one + share * (G[1] @ time)
    M = np.column_stack([top[:, :n], (G[0] - G[1]) @ W, *parts, constant, G[0] @ time])
    return Step(M, G[1] @ W, matrices.O, matrices.parameters)


def inverse_of(matrices: Matrices) -> np.ndarray:
    """Inverse of A; open electrodes keep their charge, of which the pseudo-inverse takes that with the least energy."""
    return np.linalg.pinv(np.real(matrices.A), rcond=1e-13)


@np.errstate(over="ignore", invalid="ignore")
def equilibrium(matrices: Matrices, inverse: np.ndarray, first: complex, stops: np.ndarray) -> np.ndarray:
    """State that does not move under the first value of the drive.

    Parameters
    ----------
    matrices : Matrices
        Real, or with a complex step.
    inverse : (n, n) array
        That of the real A.
    first : float or complex
        First value of the drive.
    stops : (elements,) array
        Outputs of the stops; of the other elements none.
    """
    A, B, W = matrices.A, matrices.B, matrices.W
    if np.iscomplexobj(A):
        inverse = inverse - 1j * (inverse @ np.imag(A) @ inverse)
    e = np.array([first, 0.0, 1.0, 0.0])
    kind = np.result_type(A, e, stops)
    w = stops.astype(kind)
    z = np.zeros(len(A), kind)
    for _ in range(REST):
        before, z = z, -inverse @ (B @ e + W @ w)
        if np.abs(z - before).max() <= 1e-14 * np.abs(z).max() or not np.any(matrices.kinds != STOP):
            break
        w = outputs_of(matrices, z, w, e)
    return z
