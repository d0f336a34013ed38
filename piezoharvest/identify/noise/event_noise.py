"""Noise that the noise of the drive adds where a circuit switches: the switch acts earlier or later.

A voltage inverted within a few samples changes by far more in a shift of a thousandth of a sample than its sensor's
noise. Such samples count for as much as they are known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from piezoharvest.identify.noise.noise_gain import small_response
from piezoharvest.identify.noise.noisy_drives import noisy_drives
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.setting import redriven
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.record import Signal

REALISATIONS = 4  # of the drive's noise: a variance is known to a factor of two, a weight to less


def sample_weights(
    prediction: CircuitPrediction, channels: Sequence[str], signal: Signal, drive: np.ndarray,
    sigma: Mapping[str, float], noise: float,
) -> np.ndarray:  # fmt: skip
    """Weights (samples, channels) of residuals: the sensors' noise over all that is not known there.

    By simulation: noise is added to the drive and removed again as from a measured one. What the prediction then
    changes by, beyond the linear response that whitening allows for, is not known.

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
    if noise == 0.0:
        return np.ones((len(drive), len(channels)))
    base, squares, count = _values(prediction, channels), np.zeros((len(drive), len(channels))), 0
    for noisy in noisy_drives(signal, drive, noise, REALISATIONS):
        setting = redriven(prediction.setting, noisy)
        again = type(prediction)(prediction.transducer, setting, (), prediction.nuisance, relaxed=prediction.relaxed)
        try:
            off = _values(again, channels) - base - small_response(prediction, channels, noisy - drive)
        except PredictionError:
            continue
        squares, count = squares + off**2, count + 1
    return own / np.sqrt(own**2 + squares / max(count, 1))


def _values(prediction: CircuitPrediction, channels: Sequence[str]) -> np.ndarray:
    return np.concatenate([block.values for block in prediction.blocks(derivatives=False, channels=channels)])
