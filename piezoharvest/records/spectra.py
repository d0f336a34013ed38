"""Spectra of a record's channels, and the spectral lines with the energy of its drive."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.fft import next_fast_len, rfft
from scipy.signal.windows import hann

from piezoharvest.records.record import Record

_ENERGY_SHARE = 0.98  # of the drive's energy that its lines hold
_ABOVE_FLOOR = 30.0  # times the median power, if the drive has few lines and the rest is noise
_MAX_NOISE_SHARE = 0.3  # of the energy: a floor that has more is part of the drive
_MAX_LINES = 400  # lines that are used, spread over all
_LEAST_SEEN = 0.5  # share of a drive's energy that a Hann window has to keep, against what it keeps of a lasting one


class Spectra:
    """Spectra of the channels of a record, computed at first access.

    They are Hann-windowed, unless that would hide the drive: a blow of a hammer near the beginning of a record is
    followed by its response, and both are seen without a window.

    Parameters
    ----------
    record : Record
        Evenly sampled, without NaN.
    """

    def __init__(self, record: Record):
        self.record = record
        self._kept: dict[str, np.ndarray] = {}

    @cached_property
    def frequencies(self) -> np.ndarray:
        """Frequencies in Hz, (f,)."""
        count = self._padded
        return np.arange(count // 2 + 1) * (self.record.sample_rate / count)

    @property
    def _padded(self) -> int:
        """Number of samples to which a record is zero-padded for a fast transform."""
        return next_fast_len(len(self.record), real=True) or len(self.record)

    def __getitem__(self, channel: str) -> np.ndarray:
        """Amplitude spectrum of a channel, (f,) complex: a sine of amplitude A is a peak of |A|."""
        if channel not in self._kept:
            values = self.record[channel]
            n = len(values)
            window = np.ones(n) if self.brief else hann(n, sym=False)
            # Without mean and trend; their rest is in the lowest lines, which are not used. A blow has no trend.
            ramp = np.linspace(-1.0, 1.0, n)
            trend = 0.0 if self.brief else 3.0 * np.dot(ramp, values) / n * (n - 1) / (n + 1)
            ramp *= -trend
            ramp += values
            ramp -= np.mean(values)
            ramp *= window
            spectrum = rfft(ramp, self._padded)
            spectrum *= 2 / window.sum()
            self._kept[channel] = spectrum
        return self._kept[channel]

    @cached_property
    def brief(self) -> bool:
        """True if the drive is over, or all but over, before a Hann window opens.

        A lasting drive keeps 3/8 of its energy in a Hann window, wherever in the record it begins. It is taken from its
        first value on, so that a step lasts.
        """
        drive = self.record[self.record.drive]
        power = (drive - drive[0]) ** 2
        return bool(np.dot(hann(len(drive), sym=False) ** 2, power) < _LEAST_SEEN * 3 / 8 * power.sum())

    def lines(self, spectrum: np.ndarray) -> np.ndarray:
        """Indices of the lines with a spectrum's energy, without those below one period in the record."""
        power = np.abs(spectrum) ** 2
        power[self.frequencies < 1 / self.record.duration] = 0
        power[-1] = 0
        floor = float(np.median(power))
        if (
            floor * len(power) < _MAX_NOISE_SHARE * np.log(2) * power.sum()
        ):  # the median of noise is log 2 times its mean
            power[power < _ABOVE_FLOOR * floor] = 0
        order = np.argsort(power)[::-1]
        total = np.cumsum(power[order])
        if total[-1] == 0:
            return np.empty(0, int)
        kept = np.sort(order[: int(np.searchsorted(total, _ENERGY_SHARE * total[-1])) + 1])
        return kept[power[kept] > 0]


def spread(lines: np.ndarray, most: int = _MAX_LINES) -> np.ndarray:
    """Selection of at most `most` lines, evenly spread."""
    return lines if len(lines) <= most else lines[np.linspace(0, len(lines) - 1, most).astype(int)]
