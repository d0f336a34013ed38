"""Search for the model of the mirror with Prandtl-Ishlinskii actuators: Levenberg-Marquardt on measured spectra."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.linalg import solve

from piezoharvest.identify.frequency.modes import Modes
from reports.actuators.data import LEVELS, MIRROR_RATE
from reports.actuators.mirror import fits
from reports.actuators.mirror_hysteresis import (
    BLOCK,
    EVERY,
    IDENTITY,
    LINES,
    SAMPLES,
    SHARES,
    Model,
    Operated,
    operate,
    rms,
    spectra,
)  # fmt: skip

_WISH, _WISH_WEIGHT = 1e-2, 0.3


@lru_cache
def fitted(number: int, steps: int = 16) -> Model:
    """Modes, motion at the actuators and weights that fit a block of realisations of each level."""
    modes = fits(number)[200].modes
    thresholds = SHARES * rms(spectra(200, "train", BLOCK)[0])
    empty = np.zeros((len(LINES), 3, len(SHARES)))
    model = Model(modes, np.zeros_like(modes.inputs), thresholds, np.full(len(SHARES), 0.005), empty)
    model = replace(model, nominal=operate(model, 200).gains)
    model = _search(model, 4, frozen=True)
    # What moves at the actuators has been found: thresholds by the rms of s as it is now, and the same gains.
    s = model.linear(LINES)[1] @ spectra(200, "train", BLOCK)[0]
    model = replace(model, thresholds=SHARES * rms(s))
    model = replace(model, nominal=operate(replace(model, weights=0 * model.weights), 200).gains)
    return _search(model, steps)


def _search(model: Model, steps: int, frozen: bool = False) -> Model:
    """Levenberg-Marquardt steps, judged by simulations of the operators or, to begin with, with these `frozen`.

    In a step the operators' gains and distortions stay as they are.
    """
    damping = 1e-2
    operated = {level: operate(model, level) for level in LEVELS}
    normal, gradient, cost = _normal(model, operated)
    for _ in range(steps):
        for _ in range(7):
            trial = _unpack(_bounded_step(_pack(model), normal, gradient, damping), model)
            found = operated if frozen else {level: operate(trial, level) for level in LEVELS}
            reached = sum(float(np.linalg.norm(e) ** 2) for e in _misfits(trial, found)) + _prior(_pack(trial))[2]
            if reached < cost:
                break
            damping *= 5
        else:
            break
        gain, model, operated, damping = 1 - reached / cost, trial, found, max(damping / 4, 1e-8)
        normal, gradient, cost = _normal(model, operated)
        if gain < 1e-3:
            break
    return model


def _bounded_step(x: np.ndarray, normal: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray:
    """Step with the weights, which are last, kept at least 0: those that would fall below stay at 0."""
    scale = np.sqrt(np.diag(normal)) + 1e-30
    matrix = normal / np.outer(scale, scale) + (damping + 1e-10) * np.eye(len(x))
    free = np.ones(len(x), bool)
    weights = np.arange(len(x)) >= len(x) - len(SHARES)
    while True:
        step = np.where(weights, -x, 0.0) * scale
        right = gradient / scale - matrix[:, ~free] @ step[~free]
        step[free] = solve(matrix[np.ix_(free, free)], right[free], assume_a="pos")
        below = free & weights & (x + step / scale < 0)
        if not below.any():
            return x + step / scale
        free &= ~below


def _misfits(model: Model, operated: dict[int, Operated]) -> list[np.ndarray]:
    lines = LINES[::EVERY]
    g, actuators, delay = model.linear(lines)
    result = []
    for level in LEVELS:
        _, closed, reached = _closed(model, operated[level], actuators)
        target = operated[level].target[::EVERY]
        predicted = delay[:, None, None] * (g @ closed @ reached)
        result.append((target - predicted) / np.linalg.norm(target))
    return result


def _closed(model: Model, operated: Operated, actuators: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Change of the hysteresis' gain, what the loop makes of a voltage, and the voltage less the distortion."""
    h = ((operated.gains - model.nominal) @ model.weights)[::EVERY]
    closed = np.linalg.inv(IDENTITY + h[..., None] * actuators)
    return h, closed, IDENTITY - (operated.distortion @ model.weights)[::EVERY]


def _normal(model: Model, operated: dict[int, Operated]) -> tuple[np.ndarray, np.ndarray, float]:
    """Normal matrix, gradient and cost over the levels."""
    lines = LINES[::EVERY]
    s = 2j * np.pi * lines * MIRROR_RATE / SAMPLES
    g, actuators, delay = model.linear(lines)
    normal, gradient, cost = _prior(_pack(model))
    for level, misfit in zip(LEVELS, _misfits(model, operated), strict=True):
        h, closed, reached = _closed(model, operated[level], actuators)
        change = (operated[level].gains - model.nominal)[::EVERY]
        forward, x = g @ closed, closed @ reached
        factor = delay / np.linalg.norm(operated[level].target[::EVERY])
        halves = [
            _modal(s, h, forward, x, *terms)
            for terms in _pairs(model.modes.poles, model.modes.outputs, model.modes.inputs, model.moved)
        ]
        modal = np.stack((halves[0] + halves[1], 1j * (halves[0] - halves[1])), axis=-1).reshape(len(s), 3, 3, -1)
        direct = np.einsum("im,fnj->fijmn", IDENTITY, x).reshape(len(s), 3, 3, 9)
        lag = (-s[:, None, None] * (g @ x))[..., None]
        by_weight = -np.einsum("fim,fmk,fmj->fijk", forward, change, actuators @ x, optimize=True)
        by_weight -= np.einsum("fim,fmjk->fijk", forward, operated[level].distortion[::EVERY], optimize=True)
        jacobian = np.concatenate((modal, direct, lag, by_weight), axis=-1) * factor[:, None, None, None]
        jacobian = jacobian.reshape(misfit.size, -1)
        jacobian = np.concatenate((jacobian.real, jacobian.imag))
        e = np.concatenate((misfit.ravel().real, misfit.ravel().imag))
        normal, gradient, cost = normal + jacobian.T @ jacobian, gradient + jacobian.T @ e, cost + float(e @ e)
    return normal, gradient, cost


def _prior(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Normal matrix, gradient and cost of a weak wish for small motions at the actuators and small weights.

    Without it the scale of the one hides in the other, and weights of operators that never slip have no value.
    """
    modes = (len(x) - 10 - len(SHARES)) // 20
    scale = np.zeros((modes, 10, 2))
    poles = x[: 20 * modes].reshape(modes, 10, 2)[:, 0]
    scale[:, 7:] = _WISH / np.linalg.norm(poles, axis=1)[:, None, None]
    weight = np.concatenate((scale.ravel(), np.zeros(10), np.full(len(SHARES), _WISH_WEIGHT)))
    return np.diag(weight**2), -(weight**2) * x, float(((weight * x) ** 2).sum())


def _pairs(*terms: np.ndarray) -> tuple[tuple[np.ndarray, ...], ...]:
    return terms, tuple(term.conj() for term in terms)


def _modal(s, h, forward, x, p, c, b, e) -> np.ndarray:
    """Derivatives by pole, c, b and e of each mode, (f, 3, 3, n 10)."""
    factor = 1 / (s[:, None] - p)
    pushed = forward * h[:, None, :]  # what a unit of s at the actuators takes from the output
    left = c - np.einsum("fim,km->fki", pushed, e)
    right = np.einsum("km,fmj->fkj", b, x)
    by_pole = np.einsum("fk,fki,fkj->fijk", factor**2, left, right)[..., None]
    by_c = np.einsum("fk,im,fkj->fijkm", factor, IDENTITY, right)
    by_b = np.einsum("fk,fki,fmj->fijkm", factor, left, x)
    by_e = -np.einsum("fk,fim,fkj->fijkm", factor, pushed, right)
    return np.concatenate((by_pole, by_c, by_b, by_e), axis=-1).reshape(len(s), 3, 3, -1)


def _pack(model: Model) -> np.ndarray:
    m = model.modes
    modal = np.column_stack((m.poles, m.outputs, m.inputs, model.moved)).ravel()
    return np.concatenate((modal.view(float), m.direct.ravel(), [m.delay], model.weights))


def _unpack(x: np.ndarray, model: Model) -> Model:
    k = len(SHARES)
    modal = x[: -10 - k].copy().view(complex).reshape(-1, 10)
    p, c, b, e = modal[:, 0], modal[:, 1:4], modal[:, 4:7], modal[:, 7:]
    p = np.minimum(p.real, -1e-4 * np.abs(p)) + 1j * np.abs(p.imag)
    norm = np.linalg.norm(b, axis=1, keepdims=True)
    modes = Modes(poles=p, outputs=c * norm, inputs=b / norm, direct=x[-10 - k : -1 - k].reshape(3, 3), delay=x[-1 - k])
    return replace(model, modes=modes, moved=e * norm, weights=x[-k:])
