"""One model for all levels of the mirror: linear modes, with Prandtl-Ishlinskii hysteresis in each actuator.

    y = G x,   x = v - w,   w_j = sum_i W_i (stop(s_j; r_i) - H_i s_j),   s = (I + L) x

v is the voltage, G the mirror's modes, and L, with the same poles, what they move at the actuators: the hysteresis
acts on what voltage and deformation together make of an actuator. H_i is the gain of stop i at 200 mV, so that the
modes are those of that level. The weights are shared by the three actuators.

Fitted to the three frequency responses: a stop operator under a multisine is, but for its distortion, a gain that
falls with the level (statistical linearisation), which a simulation of the operators gives. The errors are those of
simulations of the operators themselves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import solve
from scipy.ndimage import uniform_filter1d

from piezoharvest.identify.modes import Modes
from reports.actuators.data import LEVELS, MIRROR_RATE, multisines
from reports.actuators.mirror import Errors, errors, fits

SAMPLES, OVER = 8192, 2  # of a period, and how many times more often the operators are sampled
LINES = np.arange(1, 3840)
SHARES = np.array([0.2, 0.4, 0.7, 1.0, 1.4, 2.0, 2.7, 3.5])  # thresholds by the rms of s at 200 mV
BLOCK = slice(0, 3)  # realisations: as many as inputs
_EVERY = 2  # of the lines, to fit: the narrowest mode is several lines wide
_WISH, _WISH_WEIGHT = 1e-2, 0.3
_IDENTITY = np.eye(3)


@dataclass(frozen=True, eq=False)
class Model:
    """Modes, what they move at the actuators (n, 3), thresholds (V), weights, and gains (lines, 3, thresholds)."""

    modes: Modes
    moved: np.ndarray
    thresholds: np.ndarray
    weights: np.ndarray
    nominal: np.ndarray

    def linear(self, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """G without delay, I + L, and the delay's factor, at lines; (f, 3, 3) twice and (f,)."""
        m, frequency = self.modes, lines * MIRROR_RATE / SAMPLES
        instant = replace(m, delay=0.0)
        at_actuators = replace(instant, outputs=self.moved, direct=_IDENTITY)
        delay = np.exp(-2j * np.pi * frequency * m.delay)
        return instant.response(frequency), at_actuators.response(frequency), delay


@njit(cache=False)
def _stops(signals, thresholds):  # (samples, b), (k,) -> (k, samples, b), periodic
    samples, count = signals.shape
    out = np.empty((len(thresholds), samples, count))
    for k in range(len(thresholds)):
        r = thresholds[k]
        for b in range(count):
            value = 0.0
            for turn in range(2):
                for n in range(samples):
                    value += signals[n, b] - signals[n - 1, b]
                    value = min(max(value, -r), r)
                    out[k, n, b] = value
    return out


def stops(spectra: np.ndarray, thresholds: np.ndarray) -> np.ndarray:
    """Spectra (f, 3, b) to those of stop operators (f, 3, b, k) in the periodic steady state."""
    full = np.zeros((SAMPLES * OVER // 2 + 1, *spectra.shape[1:]), complex)
    full[LINES] = spectra
    signals = np.fft.irfft(full, axis=0) * SAMPLES * OVER
    found = _stops(signals.reshape(len(signals), -1), thresholds)
    back = np.fft.rfft(found, axis=1)[:, LINES] / (SAMPLES * OVER)
    return np.moveaxis(back, 0, -1).reshape(*spectra.shape, len(thresholds))


def gains(s: np.ndarray, stopped: np.ndarray) -> np.ndarray:
    """Best linear gains of the operators, smoothed over lines; (f, 3, k)."""
    cross = (stopped * s.conj()[..., None]).sum(axis=2)
    power = (np.abs(s) ** 2).sum(axis=2)
    size = min(301, len(s))
    smooth = uniform_filter1d(cross.real, size, axis=0) + 1j * uniform_filter1d(cross.imag, size, axis=0)
    return smooth / uniform_filter1d(power, size, axis=0)[..., None]


def simulate(model: Model, voltage: np.ndarray, tolerance: float = 1e-3, most: int = 12) -> tuple[np.ndarray, ...]:
    """Spectra (f, 3, b) of voltage to those of displacement, of s and of the operators.

    The loop of hysteresis and modes is solved by a fixed point, preconditioned by the linearised operators.
    """
    g, actuators, delay = model.linear(LINES)
    x = voltage.copy()
    for _ in range(most):
        s = actuators @ x
        stopped = stops(s, model.thresholds)
        found = gains(s, stopped)
        w = stopped @ model.weights - (model.nominal @ model.weights)[..., None] * s
        left = x + w - voltage
        if np.linalg.norm(left) < tolerance * np.linalg.norm(voltage):
            break
        h = (found - model.nominal) @ model.weights
        x = x - np.linalg.solve(_IDENTITY + h[..., None] * actuators, left)
    return delay[:, None, None] * (g @ x), s, stopped


class Operated(NamedTuple):
    """What the operators do to a block of as many realisations as inputs, and what is measured there.

    Attributes
    ----------
    gains : (lines, 3, k) array
    distortion : (lines, 3, 3, k) array
        What is not in the gains, by the voltages: columns are inputs.
    target : (lines, 3, 3) array
        Displacements by the voltages.
    """

    gains: np.ndarray
    distortion: np.ndarray
    target: np.ndarray


def spectra(level: int, part: str, realisations: slice = slice(None)) -> tuple[np.ndarray, np.ndarray]:
    """Of voltages and displacements, means of the periods; (lines, 3, realisations) each."""
    signals = (signal[:, :, realisations].mean(axis=-1) for signal in multisines(level, part))
    voltage, displacement = (np.fft.rfft(signal, axis=0)[LINES] / SAMPLES for signal in signals)
    return voltage, displacement


@lru_cache
def fitted(number: int, steps: int = 16) -> Model:
    """Modes, motion at the actuators and weights that fit a block of realisations of each level."""
    modes = fits(number)[200].modes
    thresholds = SHARES * _rms(spectra(200, "train", BLOCK)[0])
    empty = np.zeros((len(LINES), 3, len(SHARES)))
    model = Model(modes, np.zeros_like(modes.inputs), thresholds, np.full(len(SHARES), 0.005), empty)
    model = replace(model, nominal=_operated(model, 200).gains)
    model = _search(model, 4, frozen=True)
    # What moves at the actuators has been found: thresholds by the rms of s as it is now, and the same gains.
    s = model.linear(LINES)[1] @ spectra(200, "train", BLOCK)[0]
    model = replace(model, thresholds=SHARES * _rms(s))
    model = replace(model, nominal=_operated(replace(model, weights=0 * model.weights), 200).gains)
    return _search(model, steps)


def _operated(model: Model, level: int) -> Operated:
    """The operators as they are in a simulation of the block of realisations."""
    voltage, displacement = spectra(level, "train", BLOCK)
    _, s, stopped = simulate(model, voltage)
    found, inverse = gains(s, stopped), np.linalg.inv(voltage)
    distortion = stopped - found[:, :, None, :] * s[..., None]
    return Operated(found, np.einsum("firk,frj->fijk", distortion, inverse), displacement @ inverse)


def test_errors(model: Model) -> list[Errors]:
    """Of simulations of the test data."""
    found = []
    for level in LEVELS:
        u = multisines(level, "test").voltage
        v = np.fft.rfft(u, axis=0)[LINES] / SAMPLES
        y, _, _ = simulate(model, v.reshape(len(LINES), 3, -1))
        full = np.zeros((SAMPLES // 2 + 1, *v.shape[1:]), complex)
        full[LINES] = y.reshape(v.shape)
        found.append(errors(np.fft.irfft(full, axis=0) * SAMPLES, level))
    return found


def _rms(s: np.ndarray) -> float:
    return float(np.sqrt(2 * (np.abs(s) ** 2).sum(axis=0)).mean())


def _search(model: Model, steps: int, frozen: bool = False) -> Model:
    """Levenberg-Marquardt steps, judged by simulations of the operators or, to begin with, with these `frozen`.

    In a step the operators' gains and distortions stay as they are.
    """
    damping = 1e-2
    operated = {level: _operated(model, level) for level in LEVELS}
    normal, gradient, cost = _normal(model, operated)
    for _ in range(steps):
        for _ in range(7):
            trial = _unpack(_bounded_step(_pack(model), normal, gradient, damping), model)
            found = operated if frozen else {level: _operated(trial, level) for level in LEVELS}
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
    lines = LINES[::_EVERY]
    g, actuators, delay = model.linear(lines)
    result = []
    for level in LEVELS:
        _, closed, reached = _closed(model, operated[level], actuators)
        target = operated[level].target[::_EVERY]
        predicted = delay[:, None, None] * (g @ closed @ reached)
        result.append((target - predicted) / np.linalg.norm(target))
    return result


def _closed(model: Model, operated: Operated, actuators: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Change of the hysteresis' gain, what the loop makes of a voltage, and the voltage less the distortion."""
    h = ((operated.gains - model.nominal) @ model.weights)[::_EVERY]
    closed = np.linalg.inv(_IDENTITY + h[..., None] * actuators)
    return h, closed, _IDENTITY - (operated.distortion @ model.weights)[::_EVERY]


def _normal(model: Model, operated: dict[int, Operated]) -> tuple[np.ndarray, np.ndarray, float]:
    """Normal matrix, gradient and cost over the levels."""
    lines = LINES[::_EVERY]
    s = 2j * np.pi * lines * MIRROR_RATE / SAMPLES
    g, actuators, delay = model.linear(lines)
    normal, gradient, cost = _prior(_pack(model))
    for level, misfit in zip(LEVELS, _misfits(model, operated), strict=True):
        h, closed, reached = _closed(model, operated[level], actuators)
        change = (operated[level].gains - model.nominal)[::_EVERY]
        forward, x = g @ closed, closed @ reached
        factor = delay / np.linalg.norm(operated[level].target[::_EVERY])
        halves = [
            _modal(s, h, forward, x, *terms)
            for terms in _pairs(model.modes.poles, model.modes.outputs, model.modes.inputs, model.moved)
        ]
        modal = np.stack((halves[0] + halves[1], 1j * (halves[0] - halves[1])), axis=-1).reshape(len(s), 3, 3, -1)
        direct = np.einsum("im,fnj->fijmn", _IDENTITY, x).reshape(len(s), 3, 3, 9)
        lag = (-s[:, None, None] * (g @ x))[..., None]
        by_weight = -np.einsum("fim,fmk,fmj->fijk", forward, change, actuators @ x, optimize=True)
        by_weight -= np.einsum("fim,fmjk->fijk", forward, operated[level].distortion[::_EVERY], optimize=True)
        jacobian = np.concatenate((modal, direct, lag, by_weight), axis=-1) * factor[:, None, None, None]
        jacobian = jacobian.reshape(misfit.size, -1)
        jacobian = np.concatenate((jacobian.real, jacobian.imag))
        e = np.concatenate((misfit.ravel().real, misfit.ravel().imag))
        normal, gradient, cost = normal + jacobian.T @ jacobian, gradient + jacobian.T @ e, cost + float(e @ e)
    return normal, gradient, cost


def _prior(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Normal matrix, gradient and cost of a weak wish for little motion at the actuators: their scale hides in the weights."""
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
    by_c = np.einsum("fk,im,fkj->fijkm", factor, _IDENTITY, right)
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
