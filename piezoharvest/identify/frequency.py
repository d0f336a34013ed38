"""Modes from measured frequency responses: started by vector fitting, finished by Levenberg-Marquardt steps."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from piezoharvest.identify.modes import ModalFit, Modes
from piezoharvest.identify.multisine import FrequencyError, MultisineResponse, multisine_response
from piezoharvest.identify.vector_fitting import vector_fit

__all__ = ["FrequencyError", "ModalFit", "Modes", "MultisineResponse", "fit_modes", "multisine_response", "select_modes"]
_LEAST_DAMPING = 1e-4
_STEPS = 60


def fit_modes(
    frequency: np.ndarray,
    response: np.ndarray,
    start: int | Modes,
    *,
    weight: np.ndarray | float = 1.0,
) -> ModalFit:
    """Fit modes with rank-one residues, a direct term and a common delay to a frequency response.

    Parameters
    ----------
    frequency : (f,) array
        Hz, above 0 and increasing.
    response : (f, y, u) array of complex
    start : int or Modes
        Number of modes, or where the fit begins: the modes keep their order then, to be compared between levels.
    weight : array, broadcast to that of the response
        Of each misfit; equal weights give the least mean square error under a drive with a flat spectrum.

    Raises
    ------
    FrequencyError
        The arrays do not match, or there are not enough lines for so many modes.
    """
    frequency, response = np.asarray(frequency, float), np.asarray(response, complex)
    _check(frequency, response, start)
    weight = np.broadcast_to(np.asarray(weight, float), response.shape)
    # Scaled to the order of 1: frequencies by the highest, responses by their rms.
    top, size = 2 * np.pi * frequency[-1], float(np.sqrt(np.mean(np.abs(weight * response) ** 2)))
    s, target = 2j * np.pi * frequency / top, weight * response / size
    model = _scaled(start, top) if isinstance(start, Modes) else _start(s, response, weight, start)
    x, (ny, nu) = _pack(model), response.shape[1:]
    misfit, jacobian = _linearised(s, target, weight / size, x, ny, nu)
    damping, cost = 1e-3, _square(misfit)
    for _ in range(_STEPS):
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ misfit
        while True:
            trial = _stable(x + _solve(normal, gradient, damping), ny, nu)
            reached = _square(target - weight / size * _unpack(trial, ny, nu).response(s.imag / (2 * np.pi)))
            if reached < cost or damping > 1e6:
                break
            damping *= 4
        if reached >= cost:
            break
        gain, x, cost, damping = 1 - reached / cost, trial, reached, max(damping / 5, 1e-9)
        misfit, jacobian = _linearised(s, target, weight / size, x, ny, nu)
        if gain < 1e-6:
            break
    return _result(x, top, jacobian, misfit, float(np.sqrt(cost / _square(target))), ny, nu)


def select_modes(
    frequency: np.ndarray,
    response: np.ndarray,
    check: np.ndarray,
    numbers: Iterable[int],
    margin: float = 0.02,
) -> tuple[int, dict[int, float]]:
    """Number of modes: the least whose error on a second, independent response is within a margin of the best.

    Parameters
    ----------
    frequency : (f,) array
        Hz.
    response, check : (f, y, u) array of complex
        To fit and to check, from different realisations.
    numbers : iterable of int
        To try.
    margin : float
        Share of the best error.

    Returns
    -------
    number : int
    errors : dict of int to float
        Norm of the difference to `check` over the norm of `check`, by number.
    """
    errors = {}
    for number in sorted(numbers):
        predicted = fit_modes(frequency, response, number).modes.response(frequency)
        errors[number] = float(np.linalg.norm(predicted - check) / np.linalg.norm(check))
    best = min(errors.values())
    return next(number for number, error in errors.items() if error <= (1 + margin) * best), errors


def _check(frequency: np.ndarray, response: np.ndarray, start: int | Modes) -> None:
    if response.ndim != 3 or len(response) != len(frequency):
        shapes = f"found {len(frequency)} frequencies and a response of shape {response.shape}"
        raise FrequencyError(f"response: {shapes}, allowed is (frequencies, outputs, inputs)")
    if not np.all(np.isfinite(response)) or np.any(np.diff(frequency, prepend=0.0) <= 0):
        raise FrequencyError("response: found NaN or frequencies that do not increase from 0, allowed are neither")
    number = len(start.poles) if isinstance(start, Modes) else start
    if number < 1 or 2 * number * sum(response.shape[1:]) > response.size:
        raise FrequencyError(f"start: found {number} modes, allowed are 1 or more, fewer than the lines can tell")


def _start(s: np.ndarray, response: np.ndarray, weight: np.ndarray, number: int) -> Modes:
    """Vector fit with some poles to spare, of which the rank-one parts that weigh most stay."""
    delay = _delay(s, response)
    flat = (response * np.exp(s * delay)[:, None, None]).reshape(len(s), -1)
    size = np.sqrt(np.mean(np.abs(flat) ** 2))
    # The lowest is where a tenth of the lines is below: vector fitting would put poles where there is nothing else.
    centres = np.linspace(s[len(s) // 10].imag, 1.0, number + 4)
    poles, residues = vector_fit(s, flat / size, -0.01 * centres + 1j * centres)
    found = []
    for pole, residue in zip(poles, residues * size, strict=True):
        if pole.imag == 0:
            continue
        left, values, right = np.linalg.svd(residue.reshape(response.shape[1:]))
        c, b = values[0] * left[:, 0], right[0]
        lines = np.outer(c, b) / (s - pole)[:, None, None]
        found.append((float(np.linalg.norm(weight * lines)), pole, c, b))
    kept = sorted(sorted(found, key=lambda one: -one[0])[:number], key=lambda one: abs(one[1]))
    _, p, c, b = (np.array(part) for part in zip(*kept, strict=True))
    direct = np.zeros(response.shape[1:])
    return Modes(poles=p, outputs=c, inputs=b, direct=direct, delay=delay)


def _delay(s: np.ndarray, response: np.ndarray) -> float:
    """Delay from the phase of the determinant, or of the mean, below the lowest mode."""
    low = response[: max(len(s) // 10, 3)]
    phase = np.unwrap(np.angle(low * np.exp(-1j * np.angle(low[0]))), axis=0)
    weight = np.abs(low)
    x = s[: len(low)].imag[:, None, None]
    slope = (weight * (x - x.mean()) * phase).sum() / (weight * (x - x.mean()) ** 2).sum()
    return float(max(-slope, 0.0))


def _linearised(
    s: np.ndarray, target: np.ndarray, weight: np.ndarray, x: np.ndarray, ny: int, nu: int
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted misfit and the derivatives of the prediction: real parts, then imaginary; (2 f y u, ...)."""
    model = _unpack(x, ny, nu)
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
    predicted = weight * model.response(s.imag / (2 * np.pi))
    columns = (modal, direct, (-s[:, None, None] * predicted)[..., None])
    misfit, jacobian = (target - predicted).ravel(), np.concatenate(columns, axis=-1).reshape(target.size, -1)
    return np.concatenate((misfit.real, misfit.imag)), np.concatenate((jacobian.real, jacobian.imag))


def _derivatives(s: np.ndarray, p: np.ndarray, c: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of c b'/(s - p) by p, c and b, mode by mode; (f, y, u, n (1 + y + u))."""
    factor = 1 / (s[:, None] - p)
    ny, nu = c.shape[1], b.shape[1]
    by_pole = np.einsum("fk,ki,kj->fijk", factor**2, c, b)[..., None]
    by_output = np.einsum("fk,im,kj->fijkm", factor, np.eye(ny), b)
    by_input = np.einsum("fk,ki,jm->fijkm", factor, c, np.eye(nu))
    return np.concatenate((by_pole, by_output, by_input), axis=-1).reshape(len(s), ny, nu, -1)


def _pack(model: Modes) -> np.ndarray:
    """Unknowns as real numbers: of each mode p, c, b as real and imaginary parts, then D and the delay."""
    modal = np.column_stack((model.poles, model.outputs, model.inputs)).ravel()
    return np.concatenate((modal.view(float), model.direct.ravel(), [model.delay]))


def _unpack(x: np.ndarray, ny: int, nu: int) -> Modes:
    modal = x[: -ny * nu - 1].copy().view(complex).reshape(-1, 1 + ny + nu)
    direct = x[-ny * nu - 1 : -1].reshape(ny, nu)
    return Modes(poles=modal[:, 0], outputs=modal[:, 1 : 1 + ny], inputs=modal[:, 1 + ny :], direct=direct, delay=x[-1])


def _stable(x: np.ndarray, ny: int, nu: int) -> np.ndarray:
    """Every pole in the stable half plane, every b of norm 1."""
    m = _unpack(x, ny, nu)
    p = np.minimum(m.poles.real, -_LEAST_DAMPING * np.abs(m.poles)) + 1j * np.abs(m.poles.imag)
    norm = np.linalg.norm(m.inputs, axis=1, keepdims=True)
    return _pack(Modes(poles=p, outputs=m.outputs * norm, inputs=m.inputs / norm, direct=m.direct, delay=m.delay))


def _solve(normal: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray:
    from scipy.linalg import solve

    scale = np.sqrt(np.diag(normal)) + 1e-300
    # The scale of c against that of b is free: the small number keeps the matrix regular.
    matrix = normal / np.outer(scale, scale) + (damping + 1e-10) * np.eye(len(normal))
    return solve(matrix, gradient / scale, assume_a="pos") / scale


def _result(
    x: np.ndarray, top: float, jacobian: np.ndarray, misfit: np.ndarray, error: float, ny: int, nu: int
) -> ModalFit:
    """In Hz and the response's unit, with White's standard errors of frequencies and dampings."""
    model = _unpack(x, ny, nu)
    scale = np.linalg.norm(jacobian, axis=0)
    jacobian = jacobian / scale
    inverse = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True) / scale[:, None]
    scores = sum(part for part in np.split(jacobian * misfit[:, None], 2))
    poles = np.arange(len(model.poles))[:, None] * 2 * (1 + ny + nu) + np.arange(2)
    rows = inverse[poles.ravel()]
    spread = (rows @ (scores.T @ scores) @ rows.T).reshape(len(poles), 2, len(poles), 2)
    spread = np.array([spread[k, :, k] for k in range(len(poles))])
    p, size = model.poles, np.abs(model.poles)
    of_size = np.column_stack((p.real, p.imag)) / size[:, None]
    of_damping = np.column_stack((-(p.imag**2), p.real * p.imag)) / size[:, None] ** 3
    std = [np.sqrt(np.einsum("ki,kij,kj->k", g, spread, g)) for g in (of_size, of_damping)]
    return ModalFit(
        modes=_scaled(model, 1 / top), error=error, frequencies_std=std[0] * top / (2 * np.pi), dampings_std=std[1]
    )


def _scaled(m: Modes, top: float) -> Modes:
    """With frequencies divided by `top`."""
    return Modes(poles=m.poles / top, outputs=m.outputs / top, inputs=m.inputs, direct=m.direct, delay=m.delay * top)


def _square(values: np.ndarray) -> float:
    return float(np.vdot(values, values).real)
