"""Noise that the noise of the drive, or of a recorded gate, adds where a circuit switches: earlier or later.

A voltage inverted within a few samples changes by far more in a shift of a thousandth of a sample than its sensor's
noise. Such samples count for as much as they are known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from piezoharvest.identify.noise.noise_gain import small_response
from piezoharvest.identify.noise.noisy_drives import noisy_drives
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction, loose_edges
from piezoharvest.predict.circuit.setting import redriven
from piezoharvest.predict.discrete_model import Setting
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.record import Signal

REALISATIONS = 4  # of the drive's noise: a variance is known to a factor of two, a weight to less


def sample_weights(
    prediction: CircuitPrediction, channels: Sequence[str], signal: Signal, drive: np.ndarray,
    sigma: Mapping[str, float], noise: float,
) -> np.ndarray:  # fmt: skip
    """Weights (samples, channels) of residuals: the sensors' noise over all that is not known there.

    By simulation: noise is added to the drive and removed again as from a measured one, and the edges of a gate are put
    elsewhere within their samples. What the prediction then changes by, beyond the linear response that whitening
    allows for, is not known.

    Parameters
    ----------
    prediction : CircuitPrediction
        Without parameters.
    channels : sequence of str
    signal : Signal
        The measured drive.
    drive : (samples,) array
        The same without noise.
    sigma : mapping of str to float
        Standard deviations of the channels' noise.
    noise : float
        That of the drive.
    """
    own = np.array([sigma[channel] for channel in channels])
    if noise == 0.0 and not _is_loose(prediction.setting):
        return np.ones((len(drive), len(channels)))
    base, squares, count = _values(prediction, channels), np.zeros((len(drive), len(channels))), 0
    drives = noisy_drives(signal, drive, noise, REALISATIONS) if noise > 0.0 else [drive] * REALISATIONS
    for seed, noisy in enumerate(drives):
        again = prediction.with_drive(_retimed(redriven(prediction.setting, noisy), seed))
        try:
            off = _values(again, channels) - base - small_response(prediction, channels, noisy - drive)
        except PredictionError:
            continue
        squares, count = squares + off**2, count + 1
    return own / np.sqrt(own**2 + squares / max(count, 1))


def _retimed(setting: Setting, seed: int) -> Setting:
    """Setting with the edges of its gate elsewhere within their samples, unless their places are fitted."""
    gate = setting.gate
    if gate is None or not _is_loose(setting):
        return setting
    off = np.random.default_rng([len(gate.times), seed]).uniform(-gate.error, gate.error, len(gate.times))
    return replace(setting, gate=gate._replace(times=gate.times + off))


def _is_loose(setting: Setting) -> bool:
    """True if edges of a gate are somewhere within their samples, and too many to be fitted."""
    return setting.gate is not None and setting.gate.error > 0.0 and not loose_edges(setting)


def _values(prediction: CircuitPrediction, channels: Sequence[str]) -> np.ndarray:
    return np.concatenate([block.values for block in prediction.blocks(derivatives=False, channels=channels)])
