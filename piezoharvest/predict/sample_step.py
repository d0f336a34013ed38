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
from piezoharvest.predict.propagation.element_kinds import STOP
from piezoharvest.predict.record_model import Matrices

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
    exponential, forced = _responses(A * h, np.concatenate([B, W], axis=-1))
    # G[k]: integral of e^(A (h - s)) (s/h)^k ds, applied to what drive, rate, 1, time and the elements' outputs act by.
    G = [h * factorial(k) * each for k, each in enumerate(forced)]
    drive, rate, one, time = ([each[..., k : k + 1] for each in G] for k in range(4))
    outputs = [each[..., 4:] for each in G]
    parts = [drive[0], *(drive[k] + (k / h) * rate[k - 1] for k in range(1, DEGREE + 1))]
    M = np.concatenate([exponential, outputs[0] - outputs[1], *parts, one[0] + share * time[1], time[0]], axis=-1)
    H = np.concatenate([outputs[1], outputs[1] - outputs[2], outputs[2] - outputs[3]], axis=-1)
    return SampleStep(M, H, matrices.O, matrices.parameters)


def _responses(A: np.ndarray, forces: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Exponential of A, and its integrals phi_1 to phi_(DEGREE + 1) applied to forces (..., n, c).

    Of a chain of A and units, whose exponential has them in its first rows: units for each state, or where there are
    fewer forces, such as of many memories beside one drive, for each force. With columns of norm 1 as the units have,
    forces do not enlarge the chain's norm, from which `expm` squares.
    """
    n, c = forces.shape[-2:]
    if c >= n:
        top = _exponentials(A, np.broadcast_to(np.eye(n), A.shape))
        return top[..., :n], [top[..., k * n : (k + 1) * n] @ forces for k in range(1, DEGREE + 2)]
    size = np.abs(forces).sum(axis=-2).reshape(-1, c).max(axis=0, initial=0.0)
    size[~((size > 0.0) & np.isfinite(size))] = 1.0
    top = _exponentials(A, forces / size)
    return top[..., :n], [size * top[..., n + k * c : n + (k + 1) * c] for k in range(DEGREE + 1)]


def _exponentials(A: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Upper rows of the exponential of a chain: A, its first link (..., n, c) and units.

    Of several specimens those without a step have the same one, of real numbers.
    """
    n, c = first.shape[-2:]
    if A.ndim == 2:
        chain = np.zeros((n + (DEGREE + 1) * c, n + (DEGREE + 1) * c), np.result_type(A, first))
        chain[:n, :n] = A
        chain[:n, n : n + c] = first
        chain[n:-c, n + c :] = np.eye(DEGREE * c)
        return np.asarray(expm(chain))[:n]
    varied = np.any(np.imag(A), axis=(1, 2)) | np.any(np.imag(first), axis=(1, 2))
    found = np.empty((len(A), n, n + (DEGREE + 1) * c), complex)
    if not np.all(varied):
        found[~varied] = _exponentials(np.real(A[0]), np.real(first[0]))
    for k in np.flatnonzero(varied):
        found[k] = _exponentials(A[k], first[k])
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
