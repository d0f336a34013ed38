"""Noise behind a filter against aliasing: white up to where the filter begins, and attenuated above.

By a windowed spectrum: the cosine transform's lines of a signal that ends elsewhere than it begins would hide it.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import coherence
from scipy.signal.windows import tukey

SHARES = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3)  # of all frequencies, up to which a filter may pass all
LOWEST = 0.5  # of the frequencies of a pass band: from there on it must be noise
# Of these, which must have the same mean; a filter lowers some of them by no more than what they scatter: the noise is
# that of the higher half of them, a few per cent too much where none is lowered.
PARTS = 8
STANDARD_DEVIATIONS = 4.0  # by which means of parts may be off, and the end of the whole band must be: one in 10^4
TAPER = 0.2  # of a record, which its window takes to fade in and out: hardly any line depends on its neighbours then
INDEPENDENT = 0.9  # lines for a line of this spectrum
SEGMENTS = 32  # of a record, for the coherence of a response with its drive
MAX_COHERENCE = 3.0 / SEGMENTS  # three times that of independent noise, whose mean over many lines hardly scatters


def attenuated_noise(values: np.ndarray, drive: np.ndarray) -> tuple[float, int] | None:
    """Standard deviation of a response's noise in its pass band, as if it were white, and the number of lines used.

    None where no filter attenuates the highest frequencies, where a signal covers the noise, and where what seems to be
    noise is coherent with the drive.
    """
    power = _spectrum(values)
    if not _is_attenuated(power):
        return None
    bands = [slice(int(LOWEST * share * len(power)), int(share * len(power))) for share in SHARES]
    flat = [_is_flat(power[band]) for band in bands]
    if not any(flat):
        return None
    first = flat.index(True)
    band = bands[first + 1 if any(flat[first + 1 : first + 2]) else first]  # a filter begins before it shows
    frequency, common = coherence(drive, values, nperseg=len(values) // SEGMENTS)
    inside = (frequency > 0.5 * band.start / len(power)) & (frequency < 0.5 * band.stop / len(power))
    if common[inside].mean() > MAX_COHERENCE:
        return None
    plateau = np.sort(_means(power[band]))[-PARTS // 2 :].mean()
    return float(np.sqrt(plateau)), int(2.0 * INDEPENDENT * (band.stop - band.start))


def _spectrum(values: np.ndarray) -> np.ndarray:
    """Powers of the lines of a windowed record, whose mean is the variance of white noise."""
    window = tukey(len(values), TAPER)
    return np.abs(np.fft.rfft((values - values.mean()) * window)) ** 2 / np.sum(window**2)


def _is_attenuated(power: np.ndarray) -> bool:
    """True if the highest tenth of the frequencies has less power than the others of the highest octave."""
    width = len(power) // 10
    top, below = power[-width:], power[len(power) // 2 : -width]
    return bool(top.mean() < below.mean() * (1.0 - STANDARD_DEVIATIONS / np.sqrt(INDEPENDENT * width)))


def _is_flat(power: np.ndarray) -> bool:
    """True if parts of a band have the same mean within their scatter."""
    off = np.abs(_means(power) / power.mean() - 1.0)
    return bool(off.max() < STANDARD_DEVIATIONS / np.sqrt(INDEPENDENT * len(power) / PARTS))


def _means(power: np.ndarray) -> np.ndarray:
    return np.array([part.mean() for part in np.array_split(power, PARTS)])
