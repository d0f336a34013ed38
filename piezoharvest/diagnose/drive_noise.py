"""What the noise that a drive still holds makes residuals larger by.

Where a drive moves, its noise cannot be taken off at the same frequencies. Residuals are whitened as if a specimen
passed it on by its mean slopes; operators pass it on by those of the instant, and turn where it lets them.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.likelihood import Whitener, spectra_of
from piezoharvest.identify.fitting.model import Model, residual_blocks
from piezoharvest.identify.noise.drive_denoising import denoised
from piezoharvest.predict.drive import drive_of
from piezoharvest.predict.prediction import PredictionError

DRAWS = 2  # of noise

_DRAWN: WeakKeyDictionary[Data, tuple[float, list[np.ndarray]]] = WeakKeyDictionary()


def drive_scatter(
    data: Data, white: Whitener, model: Model, own: np.ndarray, sigma: float, edges: np.ndarray
) -> np.ndarray:
    """Variance by which whitened residuals are above one, (bands, channels), in bands between frequencies in Hz.

    By simulation: the drive without noise is taken for the true one, noise is added to it and taken off again. What is
    not a record of the same jumps then, or none that the model can follow, tells nothing.
    """
    found, model = np.zeros((len(edges) - 1, len(data.channels))), replace(model, parameters=())
    if not len(model.prediction(data).matrices.kinds):
        return found
    true = _true(data)
    plain = {begin: residual for _, begin, residual, _ in residual_blocks(model, data, own, False)}
    counts = np.zeros(len(edges) - 1)
    for noisy in _drawn(data, sigma):
        motion = drive_of(noisy)
        if not np.array_equal(motion.jumps, data.setting.motion.jumps):
            continue
        again = replace(data, setting=replace(data.setting, first=float(noisy[0]), motion=motion))
        with suppress(PredictionError):
            for _, begin, residual, _ in residual_blocks(model, again, own, False):
                count = len(residual)
                off = residual - plain[begin] + white.passes((noisy - true)[begin : begin + count])
                squares = 0.5 * np.abs((white.of(count) @ spectra_of(off)[:, :, None])[:, :, 0]) ** 2
                places = np.searchsorted(np.fft.rfftfreq(count, data.setting.sample_time), edges)
                for band, (low, high) in enumerate(pairwise(places)):
                    found[band] += squares[low:high].sum(axis=0)
                    counts[band] += high - low
    return found / np.maximum(counts, 1.0)[:, None]


def _true(data: Data) -> np.ndarray:
    """Drive without noise."""
    return data.record[data.drive] - data.rest


def _drawn(data: Data, sigma: float) -> list[np.ndarray]:
    """What is made of the drive when noise is added, several times; many models are asked for the same record."""
    known, drawn = _DRAWN.get(data, (np.nan, []))
    if known != sigma:
        true = _true(data)
        draws = (np.random.default_rng([len(data), seed]).standard_normal(len(data)) for seed in range(DRAWS))
        drawn = [denoised(true + sigma * draw, sigma) for draw in draws]
        _DRAWN[data] = sigma, drawn
    return drawn
