"""Model-free reference of a measured frequency response: its resonances, and the noise of its lines.

Two smooth curves are fitted to it without a model of the specimen: a rational function to all lines, and one to the
neighbours of each line. The residual of the better curve is the noise, by which the fit of a model is judged.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as fisher

from piezoharvest.identify.frequency.line_noise import WINDOW_LINES, LineNoise, line_noise, smoothed
from piezoharvest.identify.frequency.resonances import MeasuredResonances, resonances
from piezoharvest.records.reading.channels import RATES
from piezoharvest.records.record import FrequencyRecord

MIN_LINES = 16  # least number of lines for an estimate of their noise
MAX_POLES = 12  # most poles of the rational function
LOCAL_DEGREES = 1.0 - 4.0 / WINDOW_LINES  # degrees of freedom of the local curve per line
MAX_NOISE_RATIO = 1.1  # times the noise by the neighbours, up to which the rational function is the better curve
FALSE_ALARM_PROBABILITY = 1e-5  # probability that noise alone makes a right model seem incomplete
NOISE_ROUNDS = 3  # rounds of estimating the noise and its leverages
# Relative noise from which on lines are ignored in the rational fit, by setting it to this.
MAX_RELATIVE_NOISE = 0.2
IGNORED_NOISE = 1e3
COHERENCE_MARGIN = 1e-6  # least distance of coherences from 0 and 1


@dataclass(frozen=True, eq=False)
class Reference:
    """Model-free estimate of a response and its noise.

    Attributes
    ----------
    noise : LineNoise
    smooth : (f,) complex array
        Smoothed response.
    resonances : MeasuredResonances
        Resonances of `proper` of the record.
    allowed : float
        Largest sum of squares, in units of the noise, of a complete model.
    """

    noise: LineNoise
    smooth: np.ndarray
    resonances: MeasuredResonances
    allowed: float


_CACHE: WeakKeyDictionary[FrequencyRecord, Reference | None] = WeakKeyDictionary()


def reference_of(record: FrequencyRecord) -> Reference | None:
    """Reference of a record; None if it has too few lines, or if one is zero."""
    if record not in _CACHE:
        sound = len(record) >= MIN_LINES and np.all(record.response) and np.all(record.frequency > 0)
        _CACHE[record] = _reference(record) if sound else None
    return _CACHE[record]


def relative(error: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Errors (f, ...) of a response (f,), relative to it and in phase with it."""
    return error / response.reshape(-1, *[1] * (error.ndim - 1))


def proper(record: FrequencyRecord) -> np.ndarray:
    """The response converted to one that tends to a constant at high frequencies, whose poles are the resonances.

    For an impedance it is the charge over the voltage, for a current its charge, for a velocity or an acceleration the
    displacement.
    """
    if record.kind == "impedance":
        return 1.0 / (_laplace(record) * record.response)
    return 1.0 / record.response if record.output == "force" else record.response / _rate(record)


def _reference(record: FrequencyRecord) -> Reference:
    order = np.argsort(record.frequency, kind="stable")
    back = np.argsort(order)
    s, values = _laplace(record), proper(record)
    coherence = (
        None if record.coherence is None else np.clip(record.coherence, COHERENCE_MARGIN, 1.0 - COHERENCE_MARGIN)
    )
    # Multiplied by s, an impedance is as smooth as possible, and a velocity or an acceleration divided by its rate.
    factor = s if record.kind == "impedance" else s ** -RATES.get(record.output, 0)
    near, drawn = (part[back] for part in smoothed(record.frequency[order], (factor * record.response)[order]))
    near, drawn = near / factor, np.tile(drawn, (2, 1))
    noise = line_noise(near, record.response - near, drawn, coherence)
    share = np.sqrt(0.5 * (noise.along**2 + noise.across**2))
    # Lines that are hardly above noise have no meaningful reciprocal.
    found = resonances(
        record.frequency, values, np.where(share < MAX_RELATIVE_NOISE, share, IGNORED_NOISE) * np.abs(values), MAX_POLES
    )
    smooth, own = _response(record, found.values), noise
    for _ in range(NOISE_ROUNDS):
        own = line_noise(smooth, record.response - smooth, _leverage(found, own), coherence)
    if _level(own) > MAX_NOISE_RATIO * _level(noise):
        quantile = fisher.isf(FALSE_ALARM_PROBABILITY, 2 * len(s), LOCAL_DEGREES * 2 * len(s))
        return Reference(noise, near, found, float(2 * len(s) * quantile))
    left = relative(record.response - smooth, smooth)
    least = float(np.sum((np.real(left) / own.along) ** 2 + (np.imag(left) / own.across) ** 2))
    # The residual of a model contains the same noise; a right model has no more freedom.
    return Reference(own, smooth, found, least + float(chi2.isf(FALSE_ALARM_PROBABILITY, found.count)))


def _leverage(found: MeasuredResonances, noise: LineNoise) -> np.ndarray:
    """Leverage of errors of magnitude and phase at each line on the rational function, (2, f)."""
    inside = relative(found.slopes, found.values)
    rows = np.concatenate([np.real(inside) / noise.along[:, None], np.imag(inside) / noise.across[:, None]])
    rows = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    left, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    return (left[:, sizes > 1e-9 * sizes[0]] ** 2).sum(axis=1).reshape(2, -1)


def _level(noise: LineNoise) -> float:
    return float(np.exp(np.mean(np.log(noise.along * noise.across))) ** 0.5)


def _response(record: FrequencyRecord, values: np.ndarray) -> np.ndarray:
    """Response whose `proper` form has the given values."""
    if record.kind == "impedance":
        return 1.0 / (_laplace(record) * values)
    return 1.0 / values if record.output == "force" else values * _rate(record)


def _laplace(record: FrequencyRecord) -> np.ndarray:
    return 2j * np.pi * record.frequency


def _rate(record: FrequencyRecord) -> np.ndarray:
    """Factor from charge or displacement to an output that is a derivative of it."""
    return _laplace(record) ** {"current": 1, **RATES}.get(record.output, 0)
