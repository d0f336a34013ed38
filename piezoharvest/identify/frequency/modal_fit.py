"""Modes from measured frequency responses: started by vector fitting, finished by Levenberg-Marquardt steps."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.identify.frequency.modal_unknowns import linearised, pack, scaled, stable, unpack
from piezoharvest.identify.frequency.modes import ModalFit, Modes
from piezoharvest.identify.frequency.multisine import FrequencyError, MultisineResponse, multisine_response
from piezoharvest.identify.frequency.vector_fitting import vector_fit
from piezoharvest.threads import single_threaded

__all__ = [
    "FrequencyError", "ModalFit", "Modes", "MultisineResponse", "fit_modes", "multisine_response", "select_modes",
]  # fmt: skip
_MAX_ITERATIONS = 60
_SPARE_POLES, _DELAY_LINES = 4, 600  # poles of the start beyond the modes, and lines used to choose its delay
_DELAYS = (0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0)  # of the start, times the highest angular frequency


@single_threaded
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
        Number of modes, or start of the fit: its modes keep their order, for comparison between levels.
    weight : array, broadcast to that of the response
        Weight of each misfit; equal weights give the least mean square error under a drive with a flat spectrum.

    Raises
    ------
    FrequencyError
        The arrays do not match, or there are too few lines for the modes.
    """
    frequency, response = np.asarray(frequency, float), np.asarray(response, complex)
    _check(frequency, response, start)
    weight = np.broadcast_to(np.asarray(weight, float), response.shape)
    # Scaled to the order of 1: frequencies by the highest, responses by their rms.
    top, size = 2 * np.pi * frequency[-1], float(np.sqrt(np.mean(np.abs(weight * response) ** 2)))
    s, target = 2j * np.pi * frequency / top, weight * response / size
    model = scaled(start, top) if isinstance(start, Modes) else _start(s, response, weight, start)
    x, (ny, nu) = pack(model), response.shape[1:]
    misfit, jacobian = linearised(s, target, weight / size, x, ny, nu)
    damping, cost = 1e-3, _square(misfit)
    for _ in range(_MAX_ITERATIONS):
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ misfit
        while True:
            trial = stable(x + _solve(normal, gradient, damping), ny, nu)
            reached = _square(target - weight / size * unpack(trial, ny, nu).response(s.imag / (2 * np.pi)))
            if reached < cost or damping > 1e6:
                break
            damping *= 4
        if reached >= cost:
            break
        gain, x, cost, damping = 1 - reached / cost, trial, reached, max(damping / 5, 1e-9)
        misfit, jacobian = linearised(s, target, weight / size, x, ny, nu)
        if gain < 1e-6:
            break
    return _result(x, top, jacobian, misfit, float(np.sqrt(cost / _square(target))), ny, nu)


@single_threaded
def select_modes(
    frequency: np.ndarray,
    response: np.ndarray,
    check: np.ndarray,
    numbers: Iterable[int],
    margin: float = 0.02,
) -> tuple[int, dict[int, float]]:
    """Select the least number of modes whose error on a second, independent response is within a margin of the best.

    Parameters
    ----------
    frequency : (f,) array
        Hz.
    response, check : (f, y, u) array of complex
        Responses to fit and to check, from different realisations.
    numbers : iterable of int
        Numbers of modes to try.
    margin : float
        Relative to the best error.

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
        shapes = f"found {counted(len(frequency), 'frequency', 'frequencies')} and a response of shape {response.shape}"
        raise FrequencyError(f"response: {shapes}, its axes must be (frequencies, outputs, inputs)")
    if not np.all(np.isfinite(response)) or np.any(np.diff(frequency, prepend=0.0) <= 0):
        raise FrequencyError("response: found NaN, or frequencies that do not increase from 0")
    number = len(start.poles) if isinstance(start, Modes) else start
    if number < 1 or 2 * number * sum(response.shape[1:]) > response.size:
        allowed = "allowed are 1 or more, and at most as many as the lines can determine"
        raise FrequencyError(f"start: found {counted(number, 'mode')}, {allowed}")


def _start(s: np.ndarray, response: np.ndarray, weight: np.ndarray, number: int) -> Modes:
    """Start from vector fits with spare poles and several delays: the strongest rank-one parts of the best fit."""
    flat = response.reshape(len(s), -1) / np.sqrt(np.mean(np.abs(response) ** 2))
    few = slice(None, None, max(len(s) // _DELAY_LINES, 1))
    # The lowest has a tenth of the lines below: vector fitting would place poles where there are few lines.
    centres = np.linspace(s[len(s) // 10].imag, 1.0, number + _SPARE_POLES)
    poles = -0.01 * centres + 1j * centres
    tried = {delay: vector_fit(s[few], flat[few] * np.exp(s[few] * delay)[:, None], poles, 8) for delay in _DELAYS}
    delay = min(tried, key=lambda delay: tried[delay].error)
    fit = vector_fit(s, flat * np.exp(s * delay)[:, None], tried[delay].poles[np.imag(tried[delay].poles) > 0], 8)
    size, found = np.sqrt(np.mean(np.abs(response) ** 2)), []
    for pole, residue in zip(fit.poles, fit.residues * size, strict=True):
        if pole.imag == 0:
            continue
        left, values, right = np.linalg.svd(residue.reshape(response.shape[1:]))
        c, b = values[0] * left[:, 0], right[0]
        lines = np.outer(c, b) / (s - pole)[:, None, None]
        found.append((float(np.linalg.norm(weight * lines)), pole, c, b))
    if len(found) < number:
        raise FrequencyError(
            f"response: found {counted(len(found), 'resonance')}, allowed are at least as many as modes ({number})"
        )
    kept = sorted(sorted(found, key=lambda one: -one[0])[:number], key=lambda one: abs(one[1]))
    _, p, c, b = (np.array(part) for part in zip(*kept, strict=True))
    return Modes(poles=p, outputs=c, inputs=b, direct=fit.direct.reshape(response.shape[1:]) * size, delay=delay)


def _solve(normal: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray:
    from scipy.linalg import solve

    scale = np.sqrt(np.diag(normal)) + 1e-300
    # The scale of c relative to b is free: the small number keeps the matrix regular.
    matrix = normal / np.outer(scale, scale) + (damping + 1e-10) * np.eye(len(normal))
    return solve(matrix, gradient / scale, assume_a="pos") / scale


def _result(
    x: np.ndarray, top: float, jacobian: np.ndarray, misfit: np.ndarray, error: float, ny: int, nu: int
) -> ModalFit:
    """Fit in Hz and the response's unit, with White's standard errors of frequencies and dampings."""
    model = unpack(x, ny, nu)
    scale = np.linalg.norm(jacobian, axis=0)
    jacobian = jacobian / scale
    inverse = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True) / scale[:, None]
    scores = np.add(*np.split(jacobian * misfit[:, None], 2))
    poles = np.arange(len(model.poles))[:, None] * 2 * (1 + ny + nu) + np.arange(2)
    rows = inverse[poles.ravel()]
    spread = (rows @ (scores.T @ scores) @ rows.T).reshape(len(poles), 2, len(poles), 2)
    spread = np.array([spread[k, :, k] for k in range(len(poles))])
    real, imaginary, size = np.real(model.poles), np.imag(model.poles), np.abs(model.poles)
    of_size = np.column_stack((real, imaginary)) / size[:, None]
    of_damping = np.column_stack((-(imaginary**2), real * imaginary)) / size[:, None] ** 3
    std = [np.sqrt(np.einsum("ki,kij,kj->k", g, spread, g)) for g in (of_size, of_damping)]
    return ModalFit(
        modes=scaled(model, 1 / top), error=error, frequencies_std=std[0] * top / (2 * np.pi), dampings_std=std[1]
    )


def _square(values: np.ndarray) -> float:
    return float(np.vdot(values, values).real)
