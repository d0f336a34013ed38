"""Discretisation to a step of one sample, exact for the linear part where drive and elements' outputs are cubics."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from math import factorial
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from piezoharvest.predict.elements import outputs_of
from piezoharvest.predict.parameters import STEP
from piezoharvest.predict.record_model import STOP, Matrices

MAX_ITERATIONS = 50  # iterations to an equilibrium
DEGREE = 3  # of the drive between two samples


class SampleStep(NamedTuple):
    """Matrices that propagate a specimen by one sample.

    With g = [z, w, c0..c3, 1, time] (states, elements' outputs, the drive's coefficients in powers of time over the
    step): z <- M g + H p, p being the elements' outputs over the step as in `StepMemory`, and O as in `Matrices`. For
    derivatives every array has the parameters as its last axis.

    Attributes
    ----------
    M : (n, n + elements + 6) array
    H : (n, 3 elements) array
    O : (2 inputs + outputs, n + elements + 4) array
    limits : (elements,) array
        Thresholds of stops, exponents of powers, knots of hinges.
    """

    M: np.ndarray
    H: np.ndarray
    O: np.ndarray  # noqa: E741
    limits: np.ndarray


# A trial model of a fit may be so far off that its matrices overflow: the propagation reports it.
@np.errstate(over="ignore", invalid="ignore")
def step_of(matrices: Matrices, sample_time: float, share: float) -> SampleStep:
    """Discretise the equations.

    Parameters
    ----------
    matrices : Matrices
        Real, or of several specimens with complex steps, which are the first axis of the step's arrays then.
    sample_time : float
        s.
    share : float
        Step as fraction of the record.
    """
    A, B, W, h = matrices.A, matrices.B, matrices.W, sample_time
    n = A.shape[-1]
    top = _exponentials(A * h)
    # G[k]: integral of e^(A (h - s)) (s/h)^k ds.
    G = [h * factorial(k) * top[..., (k + 1) * n : (k + 2) * n] for k in range(DEGREE + 1)]
    drive, rate, one, time = (B[..., k : k + 1] for k in range(4))
    parts = [G[0] @ drive, *(G[k] @ drive + (k / h) * (G[k - 1] @ rate) for k in range(1, DEGREE + 1))]
    constant = G[0] @ one + share * (G[1] @ time)
    M = np.concatenate([top[..., :n], (G[0] - G[1]) @ W, *parts, constant, G[0] @ time], axis=-1)
    H = np.concatenate([G[1] @ W, (G[1] - G[2]) @ W, (G[2] - G[3]) @ W], axis=-1)
    return SampleStep(M, H, matrices.O, matrices.parameters)


def _exponentials(A: np.ndarray) -> np.ndarray:
    """Upper rows (..., n, (DEGREE + 2) n) of the exponential of a chain of A and units, whose others are integrals.

    Of several specimens those without a step in A have the same one, of real numbers.
    """
    n = A.shape[-1]
    if A.ndim == 2:
        chain = np.zeros(((DEGREE + 2) * n, (DEGREE + 2) * n), A.dtype)
        chain[:n, :n] = A
        for k in range(DEGREE + 1):
            chain[k * n : (k + 1) * n, (k + 1) * n : (k + 2) * n] = np.eye(n)
        return np.asarray(expm(chain))[:n]
    varied = np.any(np.imag(A), axis=(1, 2))
    found = np.empty((len(A), n, (DEGREE + 2) * n), complex)
    if not np.all(varied):
        found[~varied] = _exponentials(np.real(A[0]))
    for k in np.flatnonzero(varied):
        found[k] = _exponentials(A[k])
    return found


def inverse_of(matrices: Matrices) -> np.ndarray:
    """Inverse of A; if open electrodes conserve their charge, the pseudo-inverse, which minimises the energy."""
    return np.linalg.pinv(np.real(matrices.A), rcond=1e-13)


@np.errstate(over="ignore", invalid="ignore")
def equilibria(several: Matrices, inverse: np.ndarray, first: np.ndarray, stops: np.ndarray) -> np.ndarray:
    """Equilibria under the first value of the drive, of several specimens that differ in small complex steps.

    Parameters
    ----------
    several : Matrices
        Of k specimens.
    inverse : (n, n) array
        That of the real A.
    first : (k,) array
        First values of the drive.
    stops : (k, elements) array
        Outputs of the stops; zero for the other elements.

    Returns
    -------
    (k, n) array
    """
    inverses = inverse - 1j * (inverse @ np.imag(several.A) @ inverse)
    e = first[:, None] * (1.0, 0.0, 0.0, 0.0) + (0.0, 0.0, 1.0, 0.0)
    forced, bent = _applied(several.B, e), several.kinds != STOP

    def states(w: np.ndarray, k: slice | np.ndarray) -> np.ndarray:
        return -_applied(inverses[k], forced[k] + _applied(several.W[k], w))

    def missing(w: np.ndarray, k: slice | np.ndarray) -> np.ndarray:
        """By how much elements give more than `w` in the states that follow from it."""
        seen = _applied(several.O[k], np.hstack([states(w, k), w, e[k]]))
        return outputs_of(several.kinds, several.places, several.parameters[k], seen, w) - w

    every, w, nearest, move = slice(None), stops.astype(complex), np.inf, np.zeros(stops.shape, complex)
    for _ in range(MAX_ITERATIONS if np.any(bent) else 0):
        miss, z = missing(w, every), states(w, every)
        off = np.abs(_applied(inverses, _applied(several.W, miss)))[0].max()
        if off < nearest:
            nearest, move = off, _newton(missing, w, miss, bent)
            w = w + move
        else:  # too far, where slopes fall
            move = 0.5 * move
            w = w - move
        if off <= 1e-14 * np.abs(z[0]).max():  # the last step was that of the small complex parts
            break
    return states(w, every)


def _newton(missing: Callable[..., np.ndarray], w: np.ndarray, miss: np.ndarray, bent: np.ndarray) -> np.ndarray:
    """Change of the outputs (k, elements) of elements without memory, with the slopes of the first, real system."""
    move = np.zeros_like(w)
    if not np.any(miss):
        return move
    turned = np.real(w[0]) + 1j * STEP * np.eye(len(bent))[bent]
    slopes = np.imag(missing(turned, np.zeros(len(turned), int))[:, bent]).T / STEP
    with suppress(np.linalg.LinAlgError):  # of a trial model without an equilibrium
        move[:, bent] = np.linalg.solve(slopes, -miss[:, bent].T).T
    return move


def _applied(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Product of each matrix (k, n, m) with its vector (k, m)."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
