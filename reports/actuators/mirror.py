"""The mirror: frequency responses, a linear model for each level, and what changes from level to level."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from piezoharvest.identify.frequency.modal_fit import (
    ModalFit,
    MultisineResponse,
    fit_modes,
    multisine_response,
    select_modes,
)
from reports.actuators.data import LEVELS, MIRROR_RATE, multisines

# Relative test errors in %, by level, as published (NOTES.md of the data set).
PUBLISHED = {
    "linear, 28 states, one per level": (8.38, 7.95, 5.63),
    "nonlinear LFR, one for all levels": (6.37, 4.84, 4.19),
}
NUMBERS = (10, 12, 14, 16, 18)
STATES_PUBLISHED = 28


class LevelChange(NamedTuple):
    """A mode at the levels: frequency at 100 mV in Hz, its relative change, damping ratios, standard errors."""

    frequency: float
    shifts: tuple[float, ...]
    shifts_std: tuple[float, ...]
    dampings: tuple[float, ...]
    dampings_std: tuple[float, ...]
    share: float


class Errors(NamedTuple):
    """Of a simulation on the test data: rms in m, and over the rms of the output in %; means over all outputs."""

    rms: float
    relative: float


@lru_cache
def response(level: int) -> MultisineResponse:
    """Frequency response from the training data of a level in mV."""
    return multisine_response(*multisines(level, "train"), MIRROR_RATE)


@lru_cache
def selection(level: int = 200) -> tuple[int, dict[int, float]]:
    """Number of modes, fitted to three realisations and judged on the other three, at every third line."""
    records = multisines(level, "train")
    first, second = (
        multisine_response(records.voltage[:, :, half], records.displacement[:, :, half], MIRROR_RATE)
        for half in (slice(0, 3), slice(3, 6))
    )
    few = slice(None, None, 3)
    return select_modes(first.frequency[few], first.response[few], second.response[few], NUMBERS)


@lru_cache
def fits(number: int) -> dict[int, ModalFit]:
    """Modes of each level in mV; those of 100 and 300 mV begin from those of 200 mV, and keep their order."""
    found = {200: fit_modes(response(200).frequency, response(200).response, number)}
    for level in (100, 300):
        found[level] = fit_modes(response(level).frequency, response(level).response, found[200].modes)
    return found


def test_errors(number: int) -> list[Errors]:
    """Of the linear models, each on the test data of its level."""
    return [_linear_errors(fits(number)[level], level) for level in LEVELS]


def foreign_errors(number: int, from_level: int = 100) -> list[Errors]:
    """Of the linear model of one level, on the test data of all."""
    return [_linear_errors(fits(number)[from_level], level) for level in LEVELS]


def _linear_errors(fit: ModalFit, level: int) -> Errors:
    return errors(fit.modes.periodic(multisines(level, "test").voltage, MIRROR_RATE), level)


def response_errors() -> list[Errors]:
    """Of the frequency responses themselves: a linear model with any number of modes, but with their noise."""
    found = []
    for level in LEVELS:
        voltage, r = multisines(level, "test").voltage, response(level)
        spectra, out = np.fft.rfft(voltage, axis=0), np.zeros((len(voltage) // 2 + 1, 3, *voltage.shape[2:]), complex)
        lines = np.rint(r.frequency * len(voltage) / MIRROR_RATE).astype(int)
        out[lines] = np.einsum("fij,fj...->fi...", r.response, spectra[lines])
        found.append(errors(np.fft.irfft(out, len(voltage), axis=0), level))
    return found


def errors(simulated: np.ndarray, level: int) -> Errors:
    """Root mean square error of each output, realisation and period, absolute and relative; their means."""
    measured = multisines(level, "test").displacement
    rms = np.sqrt(((measured - simulated) ** 2).mean(axis=0))
    return Errors(float(rms.mean()), float((100 * rms / measured.std(axis=0)).mean()))


def floor(level: int) -> tuple[float, float]:
    """Noise and stochastic nonlinear distortion of an output over its rms, in %; means over the outputs."""
    r, size = response(level), multisines(level, "train").displacement.std(axis=(0, 2, 3))
    parts = (np.sqrt((part**2).sum(axis=0)) / size for part in (r.noise_level, r.distortion_level))
    return tuple(float(100 * part.mean()) for part in parts)


def static_gain(level: int) -> float:
    """Mean size of the response from 20 to 100 Hz, below all modes, um/V: Frobenius norm."""
    r = response(level)
    band = (r.frequency > 20) & (r.frequency < 100)
    return float(np.linalg.norm(np.abs(r.response[band].mean(axis=0))) * 1e6)


def level_changes() -> list[LevelChange]:
    """What the level does to each mode; `share` is what of the mean response's energy is in the mode, at 200 mV."""
    found = fits(STATES_PUBLISHED // 2)
    frequencies = np.array([found[level].modes.frequencies for level in LEVELS])
    spread = np.array([found[level].frequencies_std for level in LEVELS])
    dampings = np.array([found[level].modes.dampings for level in LEVELS])
    dampings_std = np.array([found[level].dampings_std for level in LEVELS])
    shifts, shifts_std = frequencies / frequencies[0] - 1, spread / frequencies[0]
    modes = found[200].modes
    sizes = np.linalg.norm(modes.outputs, axis=1) ** 2 / np.abs(modes.poles.real)
    columns = zip(frequencies[0], shifts.T, shifts_std.T, dampings.T, dampings_std.T, sizes / sizes.sum(), strict=True)
    return [LevelChange(float(f), *(tuple(map(float, v)) for v in values), share=float(s)) for f, *values, s in columns]


@lru_cache
def selected() -> int:
    """Number of modes of the levels' models."""
    return selection()[0]
