"""Check for mains hum: a line at 50 or 60 Hz that neither the drive nor its harmonics explain."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.signal.windows import hann

from piezoharvest.description.shunts import LinearShunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.records.checks.score import predicted
from piezoharvest.records.expectation import transfers
from piezoharvest.records.finding import Finding, shifted
from piezoharvest.records.reading.channels import UNITS
from piezoharvest.records.record import Record
from piezoharvest.records.spectra import Spectra

_MAINS = (50.0, 60.0)
_MAINS_TOLERANCE = 0.2  # Hz, of the mains
_MIN_DURATION = 1.0  # s, to resolve a line from its neighbours
_MIN_LINE_RATIO = 5.0  # times all lines around it
_NEIGHBOURHOOD = 15.0  # Hz: two harmonics of any drive that is slow enough to have some on either side
_MIN_EXPLAINED_SHARE = 0.3  # share of a line that is the response to the drive
_MIN_STEADINESS = 0.5  # least over largest amplitude in quarters of the record; a free decay is not hum
_MIN_SEPARATION = 16.0  # over the duration: a tone of the drive that is nearer cannot be resolved in a quarter
# Most tones of the drive whose harmonics and sums are used; least size over the strongest.
_MAX_TONES = 4
_MIN_TONE_RATIO = 0.2
_MAX_ORDER = 3


def mains_hum(record: Record, spectra: Spectra, transducer: Transducer) -> Iterator[Finding]:
    """Check for lines at the frequency of the mains."""
    if record.duration < _MIN_DURATION:
        return
    tones = _tones(record, spectra)
    switched = record.drive != "voltage" and not isinstance(record.shunt, LinearShunt)
    behind = ("voltage", "current") if switched else ()  # channels in which switching makes lines
    for mains in _MAINS:
        if 2.2 * mains > record.sample_rate or _combines(tones, mains, record.duration):
            continue
        lines = {channel: _line(spectra, channel, mains, tones) for channel in record.signals if channel not in behind}
        for channel, line in lines.items():
            if line is None or not _steady(record, channel, float(spectra.frequencies[line])):
                continue
            if _explained(record, spectra, transducer, channel, line):
                continue
            signal = record.signals[channel]
            size = abs(spectra[channel][line])
            found = f"found a line of {size:.3g} {UNITS[channel]} at {spectra.frequencies[line]:.4g} Hz"
            message = f"{found} that does not come from the drive; likely mains hum"
            rows = shifted([(0, len(record) - 1)], signal.first_row)
            yield Finding("warning", "mains hum", signal.file, channel, rows, message)


def _line(spectra: Spectra, channel: str, mains: float, tones: np.ndarray) -> int | None:
    """Index of a line at the mains frequency above all others around it, except the drive's tones."""
    frequencies, size, duration = spectra.frequencies, np.abs(spectra[channel]), spectra.record.duration
    low, high = np.searchsorted(frequencies, (mains - _NEIGHBOURHOOD, mains + _NEIGHBOURHOOD))
    frequencies, size = frequencies[low:high], size[low:high]
    away = np.abs(frequencies - mains)
    near, around = away <= _MAINS_TOLERANCE + 1 / duration, away > _MAINS_TOLERANCE + 3.5 / duration
    for tone in (*tones, *(other for other in _MAINS if other != mains)):
        around &= np.abs(frequencies - tone) > _MAINS_TOLERANCE + 3.5 / duration
    if not near.any() or around.sum() < 5:
        return None
    peak = int(np.argmax(np.where(near, size, 0)))
    return low + peak if size[peak] > _MIN_LINE_RATIO * np.max(size[around]) else None


def _steady(record: Record, channel: str, frequency: float) -> bool:
    """True if a line is about equally strong in each quarter of the record."""
    time, values = record["time"], record[channel]
    sizes = []
    for part in np.array_split(np.arange(len(record)), 4):
        window = hann(len(part), sym=False)
        centred = values[part] - np.mean(values[part])
        sizes.append(abs(np.sum(window * centred * np.exp(-2j * np.pi * frequency * time[part]))) / window.sum())
    return min(sizes) > _MIN_STEADINESS * max(sizes)


def _tones(record: Record, spectra: Spectra) -> np.ndarray:
    """Frequencies of the drive's strongest lines, Hz; none for a drive with many."""
    drive = spectra[record.drive]
    lines = spectra.lines(drive)
    size = np.abs(drive)
    inner = lines[(lines > 0) & (lines < len(size) - 1)]
    peaks = inner[(size[inner] >= size[inner - 1]) & (size[inner] >= size[inner + 1])]
    peaks = peaks[size[peaks] > _MIN_TONE_RATIO * np.max(size[peaks], initial=0)]
    return spectra.frequencies[peaks] if len(peaks) <= _MAX_TONES else np.empty(0)


def _combines(tones: np.ndarray, mains: float, duration: float) -> bool:
    """True if harmonics of the drive, or sums and differences of its tones, are at the mains frequency.

    High harmonics of a slow drive are not considered: they are close to each other, so none of them stands out.
    """
    tolerance = _MAINS_TOLERANCE + 2 / duration
    if any(abs(tone - mains) < _MIN_SEPARATION / duration for tone in tones):
        return True
    if any(abs(n * tone - mains) < (n + 1) / 2 * tolerance for tone in tones for n in range(1, 8) if tone > mains / 8):
        return True
    signed = np.concatenate((tones, -tones, np.zeros(1)))
    return len(tones) > 1 and any(abs(sum(some) - mains) < tolerance for some in product(signed, repeat=_MAX_ORDER))


def _explained(record: Record, spectra: Spectra, transducer: Transducer, channel: str, line: int) -> bool:
    """True if the line is the response to the drive at its frequency; for the drive, True if a response follows it."""
    responses = transfers(transducer, record.shunt, record.drive, spectra.frequencies[line : line + 1])
    causes = {cause: spectra[cause][line : line + 1] for cause in record.signals}
    if channel != record.drive:
        expected = predicted(responses, channel, causes)
        if expected is not None:
            return bool(np.max(np.abs(expected)) > _MIN_EXPLAINED_SHARE * abs(spectra[channel][line]))
        return _line(spectra, record.drive, float(spectra.frequencies[line]), np.empty(0)) is not None
    for response in record.responses:
        expected = predicted(responses, response, causes)
        if expected is not None and abs(spectra[response][line]) < _MIN_EXPLAINED_SHARE * np.min(np.abs(expected)):
            return False
    return True
