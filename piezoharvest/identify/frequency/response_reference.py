"""What a measured frequency response shows by itself: its resonances, and the noise of its lines.

Two smooth curves are drawn through it that know nothing of the specimen: a rational function through all lines, and one
through the neighbours of each line. The one that leaves less has the noise, and is what a model has to come up to.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as fisher

from piezoharvest.identify.frequency.line_noise import WINDOW, LineNoise, line_noise, smoothed
from piezoharvest.identify.frequency.resonances import MeasuredResonances, resonances
from piezoharvest.records.record import FrequencyRecord

FEWEST = 16  # lines that tell their noise
POLES = 12  # at most, of the rational function
LOCAL_DEGREES = 1.0 - 4.0 / WINDOW  # share of the lines, that the neighbours leave for the noise
SPOILT = 1.1  # times the noise of the neighbours, that the rational function may leave and still be the better curve
CHANCE = 1e-5  # that noise alone makes a model look as if it lacked something
WEIGHINGS = 3  # rounds of noise and of the leverages that it makes
VAGUE, HARDLY = 0.2, 1e3  # relative noise of lines that the rational function leaves out, by taking it for so much
NEARLY_ONE = 1e-6  # coherences are kept so far from 0 and 1


@dataclass(frozen=True, eq=False)
class Reference:
    """A response as its own lines show it.

    Attributes
    ----------
    noise : LineNoise
    smooth : (f,) complex array
        The response without most of its noise.
    resonances : MeasuredResonances
        Of `proper` of the record.
    allowed : float
        Sum of squares, in units of the noise, that a model leaves which lacks nothing.
    """

    noise: LineNoise
    smooth: np.ndarray
    resonances: MeasuredResonances
    allowed: float


_KNOWN: WeakKeyDictionary[FrequencyRecord, Reference | None] = WeakKeyDictionary()


def reference_of(record: FrequencyRecord) -> Reference | None:
    """What a record shows by itself; None of too few lines, or where one is zero."""
    if record not in _KNOWN:
        sound = len(record) >= FEWEST and np.all(record.response) and np.all(record.frequency > 0)
        _KNOWN[record] = _reference(record) if sound else None
    return _KNOWN[record]


def relative(error: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Errors (f, ...) of a response (f,), relative to it and in phase with it."""
    return error / response.reshape(-1, *[1] * (error.ndim - 1))


def proper(record: FrequencyRecord) -> np.ndarray:
    """The response as one that goes to a constant at high frequencies, whose poles are the resonances.

    Of an impedance it is the charge over the voltage, of a current its charge.
    """
    s = 2j * np.pi * record.frequency
    if record.kind == "impedance":
        return 1.0 / (s * record.response)
    if record.output == "current":
        return record.response / s
    return 1.0 / record.response if record.output == "force" else record.response


def _reference(record: FrequencyRecord) -> Reference:
    order = np.argsort(record.frequency, kind="stable")
    back = np.argsort(order)
    s, values = 2j * np.pi * record.frequency, proper(record)
    coherence = None if record.coherence is None else np.clip(record.coherence, NEARLY_ONE, 1.0 - NEARLY_ONE)
    # Times s, an impedance is as smooth as it can be.
    factor = s if record.kind == "impedance" else np.ones(len(s))
    near, drawn = (part[back] for part in smoothed(record.frequency[order], (factor * record.response)[order]))
    near, drawn = near / factor, np.tile(drawn, (2, 1))
    noise = line_noise(near, record.response - near, drawn, coherence)
    share = np.sqrt(0.5 * (noise.along**2 + noise.across**2))
    # What is hardly more than noise has no reciprocal that would tell anything.
    found = resonances(record.frequency, values, np.where(share < VAGUE, share, HARDLY) * np.abs(values), POLES)
    smooth, own = _response(record, found.values), noise
    for _ in range(WEIGHINGS):
        own = line_noise(smooth, record.response - smooth, _leverage(found, own), coherence)
    if _level(own) > SPOILT * _level(noise):
        quantile = fisher.isf(CHANCE, 2 * len(s), LOCAL_DEGREES * 2 * len(s))
        return Reference(noise, near, found, float(2 * len(s) * quantile))
    left = relative(record.response - smooth, smooth)
    least = float(np.sum((np.real(left) / own.along) ** 2 + (np.imag(left) / own.across) ** 2))
    # The same noise is in what a model leaves, which has no more freedom if it is right.
    return Reference(own, smooth, found, least + float(chi2.isf(CHANCE, found.count)))


def _leverage(found: MeasuredResonances, noise: LineNoise) -> np.ndarray:
    """By how much errors of magnitude and phase at each line draw a rational function, (2, f)."""
    inside = relative(found.slopes, found.values)
    rows = np.concatenate([np.real(inside) / noise.along[:, None], np.imag(inside) / noise.across[:, None]])
    rows = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    left, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    return (left[:, sizes > 1e-9 * sizes[0]] ** 2).sum(axis=1).reshape(2, -1)


def _level(noise: LineNoise) -> float:
    return float(np.exp(np.mean(np.log(noise.along * noise.across))) ** 0.5)


def _response(record: FrequencyRecord, values: np.ndarray) -> np.ndarray:
    """The response that is `proper` as these."""
    s = 2j * np.pi * record.frequency
    if record.kind == "impedance":
        return 1.0 / (s * values)
    if record.output == "current":
        return values * s
    return 1.0 / values if record.output == "force" else values
