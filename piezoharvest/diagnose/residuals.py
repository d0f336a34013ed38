"""Residuals of every record, without and with the effects that were found: for reports."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.diagnose.diagnosis import Diagnosis
from piezoharvest.identify.data import Data
from piezoharvest.identify.fit import Fit, Problem, fit, whiteners
from piezoharvest.identify.identification import judged, prepared
from piezoharvest.identify.noise import Noise
from piezoharvest.identify.responses import FrequencyData
from piezoharvest.identify.sums import residual_blocks, spectra_of


@dataclass(frozen=True, eq=False)
class Residuals:
    """One record over time.

    Attributes
    ----------
    data : Data
    before, after : (samples, channels) array
        Measured less predicted, SI units.
    white_before, white_after : (samples, channels) array
        The same in units of the noise, whitened.
    noise : (channels,) array
        Standard deviation of noise alone, that of the drive included.
    """

    data: Data
    before: np.ndarray
    after: np.ndarray
    white_before: np.ndarray
    white_after: np.ndarray
    noise: np.ndarray

    @property
    def time(self) -> np.ndarray:
        """Seconds since the record's start, (samples,)."""
        return self.data.setting.sample_time * np.arange(len(self.data))

    def gain(self, c: int) -> float:
        """By how much the squares of a channel's whitened residual fall."""
        return float((self.white_before[:, c] ** 2).sum() - (self.white_after[:, c] ** 2).sum())


def residuals(diagnosis: Diagnosis) -> Iterator[Residuals]:
    """Residuals of the records over time, those fitted first."""
    for role in ("fit", "validate"):
        data = prepared(diagnosis.campaign, role)
        if not data:
            continue
        problem = Problem(data, diagnosis.campaign.transducer, diagnosis.before.offsets)
        fits = [_of(problem, found, role) for found in (diagnosis.before.found, diagnosis.search.final)]
        noise = judged(data, fits[1])
        pairs = zip(*(_pairs(problem, found) for found in fits), strict=True)
        for (each, before, white_before), (_, after, white_after) in pairs:
            alone = next(one for one in noise if one.name == each.name).quality.noise
            sigma = np.array([alone[channel] for channel in each.channels])
            yield Residuals(each, before, after, white_before, white_after, sigma)


def _of(problem: Problem, found: Fit, role: str) -> Fit:
    """The fit itself, or for records that were not fitted that of their own numbers."""
    if role == "fit":
        return found
    noise = Noise({**problem.noise().sigma, **found.noise.sigma})
    return fit(problem, replace(found.model, parameters=()), None, noise, estimate_noise=False)


def _pairs(problem: Problem, found: Fit) -> Iterator[tuple[Data, np.ndarray, np.ndarray]]:
    """Records with residuals, plain and whitened."""
    model = replace(found.model, parameters=())
    for data, own, white in zip(problem.data, found.own, whiteners(problem, found.model, found.noise), strict=True):
        if isinstance(data, FrequencyData):
            continue
        plain = [residual for _, _, residual, _ in residual_blocks(model, data, own, False)]
        whitened = [in_time(white.of(len(part))[0] @ spectra_of(part)[:, :, None], len(part)) for part in plain]  # pyright: ignore
        yield data, np.concatenate(plain), np.concatenate(whitened)


def in_time(spectra: np.ndarray, count: int) -> np.ndarray:
    """Samples that have such `spectra_of`, (f, channels, 1) to (count, channels)."""
    lines = spectra[:, :, 0] * np.sqrt(count)
    lines[1 : (count + 1) // 2] /= np.sqrt(2.0)
    return np.fft.irfft(lines, count, axis=0)


def in_bins(values: np.ndarray, where: np.ndarray, edges: Sequence[float] | np.ndarray) -> np.ndarray:
    """Means of whitened residuals in bins of another signal, in units of what noise would make them, (bins,).

    A bin with few samples is not a number.
    """
    place = np.clip(np.searchsorted(edges, where, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(place, minlength=len(edges) - 1)
    total = np.bincount(place, values, minlength=len(edges) - 1)
    return np.where(count >= 5, total / np.sqrt(np.maximum(count, 1)), np.nan)
