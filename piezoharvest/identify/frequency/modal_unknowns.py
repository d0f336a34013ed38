"""Modes as real unknowns of a fit, and the derivatives of a response with respect to them."""

from __future__ import annotations

import numpy as np

from piezoharvest.identify.frequency.modes import Modes

_MIN_DAMPING = 1e-4


def linearised(
    s: np.ndarray, target: np.ndarray, weight: np.ndarray, x: np.ndarray, ny: int, nu: int
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted misfit and the derivatives of the prediction: real parts, then imaginary; (2 f y u, ...)."""
    model = unpack(x, ny, nu)
    frequency = np.imag(s) / (2 * np.pi)
    lag = weight * np.exp(-s * model.delay)[:, None, None]
    halves = [
        _derivatives(s, *terms)
        for terms in (
            (model.poles, model.outputs, model.inputs),
            (model.poles.conj(), model.outputs.conj(), model.inputs.conj()),
        )
    ]
    real, imaginary = halves[0] + halves[1], 1j * (halves[0] - halves[1])
    modal = np.stack((real, imaginary), axis=-1).reshape(len(s), ny, nu, -1) * lag[..., None]
    direct = np.eye(ny * nu).reshape(ny, nu, -1) * lag[..., None]
    predicted = weight * model.response(frequency)
    columns = (modal, direct, (-s[:, None, None] * predicted)[..., None])
    jacobian = np.concatenate(columns, axis=-1).reshape(target.size, -1)
    return _real((target - predicted).ravel()), _real(jacobian)


def _derivatives(s: np.ndarray, p: np.ndarray, c: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Derivatives of c b'/(s - p) by p, c and b, mode by mode; (f, y, u, n (1 + y + u))."""
    factor = 1 / (s[:, None] - p)
    ny, nu = c.shape[1], b.shape[1]
    by_pole = np.einsum("fk,ki,kj->fijk", factor**2, c, b)[..., None]
    by_output = np.einsum("fk,im,kj->fijkm", factor, np.eye(ny), b)
    by_input = np.einsum("fk,ki,jm->fijkm", factor, c, np.eye(nu))
    return np.concatenate((by_pole, by_output, by_input), axis=-1).reshape(len(s), ny, nu, -1)


def pack(model: Modes) -> np.ndarray:
    """Unknowns as real numbers: of each mode p, c, b as real and imaginary parts, then D and the delay."""
    modal = np.column_stack((model.poles, model.outputs, model.inputs)).ravel()
    return np.concatenate((modal.view(float), model.direct.ravel(), [model.delay]))


def unpack(x: np.ndarray, ny: int, nu: int) -> Modes:
    """Modes of ny outputs and nu inputs from their unknowns."""
    modal = x[: -ny * nu - 1].copy().view(complex).reshape(-1, 1 + ny + nu)
    direct = x[-ny * nu - 1 : -1].reshape(ny, nu)
    return Modes(poles=modal[:, 0], outputs=modal[:, 1 : 1 + ny], inputs=modal[:, 1 + ny :], direct=direct, delay=x[-1])


def stable(x: np.ndarray, ny: int, nu: int) -> np.ndarray:
    """Unknowns with every pole in the stable half plane and every b of norm 1."""
    m = unpack(x, ny, nu)
    p = np.minimum(np.real(m.poles), -_MIN_DAMPING * np.abs(m.poles)) + 1j * np.abs(np.imag(m.poles))
    norm = np.linalg.norm(m.inputs, axis=1, keepdims=True)
    return pack(Modes(poles=p, outputs=m.outputs * norm, inputs=m.inputs / norm, direct=m.direct, delay=m.delay))


def scaled(m: Modes, top: float) -> Modes:
    """Modes with frequencies divided by `top`."""
    return Modes(poles=m.poles / top, outputs=m.outputs / top, inputs=m.inputs, direct=m.direct, delay=m.delay * top)


def _real(values: np.ndarray) -> np.ndarray:
    return np.concatenate((np.real(values), np.imag(values)))
