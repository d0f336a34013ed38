"""Realisations of what is left of a drive's noise after it has been removed as far as it can be."""

from __future__ import annotations

from collections.abc import Iterator
from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.identify.noise.drive_denoising import denoised
from piezoharvest.records.record import Signal

KEPT = 4  # realisations for each signal that are kept: those that many models use
_KNOWN: WeakKeyDictionary[Signal, tuple[float, list[np.ndarray]]] = WeakKeyDictionary()


def noisy_drives(
    signal: Signal, true: np.ndarray, sigma: float, count: int, *, kept: bool = True
) -> Iterator[np.ndarray]:
    """Drives with noise added and removed again; the first ones are cached, since many models use them.

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
    kept : bool
        False for realisations that are used once, with a noise other than that of the drive.
    """
    if not kept:
        yield from (_realisation(true, sigma, seed) for seed in range(count))
        return
    known, drawn = _KNOWN.get(signal, (np.nan, []))
    if known != sigma:
        drawn = []
    for seed in range(len(drawn), min(count, KEPT)):
        drawn = [*drawn, _realisation(true, sigma, seed)]
    _KNOWN[signal] = sigma, drawn
    yield from drawn[:count]
    for seed in range(KEPT, count):
        yield _realisation(true, sigma, seed)


def _realisation(true: np.ndarray, sigma: float, seed: int) -> np.ndarray:
    draw = np.random.default_rng([len(true), seed]).standard_normal(len(true))
    return denoised(true + sigma * draw, sigma)
