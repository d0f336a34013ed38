"""Variance that the remaining noise of a measured drive adds to whitened residuals.

Noise in the band of the drive's motion cannot be filtered out. Whitening assumes that it passes through the average
linear response; hysteresis operators pass it on with their instantaneous slopes, and reverse where it makes them.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.likelihood import Whitener
from piezoharvest.identify.fitting.model import Model, residual_blocks
from piezoharvest.identify.noise.noisy_drives import noisy_drives
from piezoharvest.identify.noise.spectra import first_lines
from piezoharvest.predict.circuit.setting import redriven
from piezoharvest.predict.prediction import PredictionError

REALISATIONS = 2  # realisations of the noise


def drive_noise_variance(
    data: Data, white: Whitener, model: Model, nuisance: np.ndarray, sigma: float, edges: np.ndarray
) -> np.ndarray:
    """Variance of whitened residuals in excess of one, (bands, channels), between `edges` in cycles per sample.

    By simulation: noise is added to the denoised drive, which is then denoised again. Realisations with other jumps, or
    that the model cannot follow, are left out.
    """
    found, model = np.zeros((len(edges) - 1, len(data.channels))), replace(model, parameters=())
    if not model.prediction(data).nonlinear:
        return found
    true = _denoised_drive(data)
    plain = {begin: residual for _, begin, residual, _ in residual_blocks(model, data, nuisance, False)}
    counts = np.zeros(len(edges) - 1)
    for noisy in noisy_drives(data.record.signals[data.drive], true, sigma, REALISATIONS):
        setting = redriven(data.setting, noisy)
        if not np.array_equal(setting.motion.jumps, data.setting.motion.jumps):
            continue
        again = replace(data, setting=setting)
        with suppress(PredictionError):
            for _, begin, residual, _ in residual_blocks(model, again, nuisance, False):
                count = len(residual)
                off = residual - plain[begin] + white.passes((noisy - true)[begin : begin + count])
                squares = 0.5 * np.abs(white.whitened(begin, white.weighted(begin, off)).T) ** 2
                for band, (low, high) in enumerate(pairwise(first_lines(edges, count))):
                    found[band] += squares[low:high].sum(axis=0)
                    counts[band] += high - low
    return found / np.maximum(counts, 1.0)[:, None]


def _denoised_drive(data: Data) -> np.ndarray:
    """Drive without noise."""
    return data.record[data.drive] - data.rest
