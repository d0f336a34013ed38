"""Realisations of what is left of a drive's noise after it has been removed as far as it can be."""

from __future__ import annotations

from collections.abc import Iterator
from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.identify.noise.drive_denoising import FoundTones, denoised_and_tones
from piezoharvest.records.record import Signal

MAX_KEPT = 1 << 22  # numbers that are kept for each signal and noise (32 MiB): all realisations of most records
NOISES = 2  # for which they are kept: that of the drive, and a wider one


class _Realisations:
    """Realisations for one noise; many models use the first ones."""

    def __init__(self, true: np.ndarray, sigma: float, series: int) -> None:
        self.true, self.sigma, self.series = true, sigma, series
        self.kept: list[np.ndarray] = []
        self.like: FoundTones | None = None

    def each(self, count: int) -> Iterator[np.ndarray]:
        for seed in range(count):
            if seed < len(self.kept):
                yield self.kept[seed]
                continue
            draw = np.random.default_rng([len(self.true), seed, self.series]).standard_normal(len(self.true))
            found, like = denoised_and_tones(self.true + self.sigma * draw, self.sigma, self.like)
            self.like = like if self.like is None else self.like
            if seed == len(self.kept) and len(found) * (seed + 1) <= MAX_KEPT:
                self.kept.append(found)
            yield found


_KNOWN: WeakKeyDictionary[Signal, list[_Realisations]] = WeakKeyDictionary()


def noisy_drives(signal: Signal, true: np.ndarray, sigma: float, count: int, series: int = 0) -> Iterator[np.ndarray]:
    """Drives with noise added and removed again.

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
    series : int
        Those of another series are independent.
    """
    known = _KNOWN.get(signal, [])
    same = (each for each in known if (each.sigma, each.series) == (sigma, series) and np.array_equal(each.true, true))
    found = next(same, None) or _Realisations(true, sigma, series)
    _KNOWN[signal] = [found, *(each for each in known if each is not found)][:NOISES]
    return found.each(count)
