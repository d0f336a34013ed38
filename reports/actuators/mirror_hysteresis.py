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
from scipy.ndimage import uniform_filter1d

from piezoharvest.identify.frequency.modal_fit import fit_modes
from piezoharvest.identify.frequency.modes import Modes
from reports.actuators.data import LEVELS, MIRROR_RATE, multisines
from reports.actuators.mirror import Errors, errors, fits

SAMPLES, OVER = 8192, 2  # of a period, and how many times more often the operators are sampled
LINES = np.arange(1, 3840)
SHARES = np.array([0.2, 0.4, 0.7, 1.0, 1.4, 2.0, 2.7, 3.5])  # thresholds by the rms of s at 200 mV
BLOCK = slice(0, 3)  # realisations: as many as inputs
EVERY = 2  # of the lines, to fit: the narrowest mode is several lines wide
IDENTITY = np.eye(3)


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
        at_actuators = replace(instant, outputs=self.moved, direct=IDENTITY)
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
            for _ in range(2):
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
        x = x - np.linalg.solve(IDENTITY + h[..., None] * actuators, left)
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


def operate(model: Model, level: int) -> Operated:
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


@lru_cache
def predicted_shifts(model: Model, number: int) -> tuple[float, ...]:
    """Relative change of each mode's frequency from the first to the last level, in modes fitted to simulations."""
    frequencies = []
    for level in (LEVELS[0], LEVELS[-1]):
        voltage, _ = spectra(level, "train")
        found = simulate(model, voltage)[0] @ np.linalg.pinv(voltage)
        lines = slice(None, None, EVERY)
        fit = fit_modes(LINES[lines] * MIRROR_RATE / SAMPLES, found[lines], fits(number)[level].modes)
        frequencies.append(fit.modes.frequencies)
    return tuple(map(float, frequencies[1] / frequencies[0] - 1))


def rms(s: np.ndarray) -> float:
    return float(np.sqrt(2 * (np.abs(s) ** 2).sum(axis=0)).mean())
