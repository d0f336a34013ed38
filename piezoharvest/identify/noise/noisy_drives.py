"""Realisations of what is left of a drive's noise after it has been removed as far as it can be."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.identify.noise.drive_denoising import denoised
from piezoharvest.records.record import Signal

_KNOWN: WeakKeyDictionary[Signal, tuple[float, list[np.ndarray]]] = WeakKeyDictionary()


def noisy_drives(signal: Signal, true: np.ndarray, sigma: float, count: int) -> list[np.ndarray]:
    """Drives with noise added and removed again; cached, since many models use them.

    Parameters
    ----------
    signal : Signal
        The measured drive.
    true : (samples,) array
        The same without noise.
    sigma : float
        Standard deviation of its noise.
    count : int
        Number of realisations.
    """
    known, drawn = _KNOWN.get(signal, (np.nan, []))
    if known != sigma:
        drawn = []
    for seed in range(len(drawn), count):
        draw = np.random.default_rng([len(true), seed]).standard_normal(len(true))
        drawn = [*drawn, denoised(true + sigma * draw, sigma)]
    _KNOWN[signal] = sigma, drawn
    return drawn[:count]
