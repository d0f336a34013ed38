"""Residuals of every record without and with the effects found, for reports."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.diagnose.residual_structure.residual_tests import blocks_of
from piezoharvest.diagnose.result import Diagnosis
from piezoharvest.diagnose.validation import validated
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.residual_quality import judged
from piezoharvest.records.record import FrequencyRecord


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of one record over time.

    Attributes
    ----------
    data : Data
    before, after : (samples, channels) array
        Measured less predicted, SI units.
    white_before, white_after : (samples, channels) array
        The same, whitened and in units of the noise.
    noise : (channels,) array
        Standard deviation of noise alone, including that of the drive.
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
        """Decrease of the sum of squares of a channel's whitened residual."""
        return float((self.white_before[:, c] ** 2).sum() - (self.white_after[:, c] ** 2).sum())


def residuals(diagnosis: Diagnosis) -> Iterator[Residuals]:
    """Residuals of the records over time, fitted records first."""
    found = [diagnosis.before.found, diagnosis.search.final]
    data = prepared(diagnosis.campaign, "fit")
    yield from _residuals_of(Problem(data, diagnosis.campaign.transducer, diagnosis.before.offsets), found)
    unseen, checks = validated(diagnosis.campaign, diagnosis.before, found)
    if any(each.role == "validate" for each in unseen.data):
        yield from _residuals_of(unseen, checks)


def responses(diagnosis: Diagnosis) -> Iterator[tuple[FrequencyRecord, np.ndarray, np.ndarray]]:
    """Measured responses with what the model predicts without and with effects, each (f,); fitted records first."""
    models = [replace(found.model, parameters=()) for found in (diagnosis.before.found, diagnosis.search.final)]
    for role in ("fit", "validate"):
        for data in prepared(diagnosis.campaign, role):
            if isinstance(data, FrequencyData):
                before, after = (data.response(model)[0] for model in models)
                yield data.record, before, after


def _residuals_of(problem: Problem, fits: Sequence[Fit]) -> Iterator[Residuals]:
    """Residuals of the records of a problem, without and with effects."""
    noise = {one.name: one.quality.noise for one in judged(problem.data, fits[1])}
    for (data, before, white_before), (_, after, white_after) in zip(*(_pairs(problem, f) for f in fits), strict=True):
        sigma = np.array([noise[data.name][channel] for channel in data.channels])
        yield Residuals(data, before, after, white_before, white_after, sigma)


def _pairs(problem: Problem, found: Fit) -> Iterator[tuple[Data, np.ndarray, np.ndarray]]:
    """Records with their residuals, plain and whitened."""
    for _, blocks in itertools.groupby(blocks_of(problem, found), key=lambda block: id(block.data)):
        parts = list(blocks)
        plain = [block.residual for block in parts]
        white = [samples_of(block.spectrum, len(block.residual)) for block in parts]
        yield parts[0].data, np.concatenate(plain), np.concatenate(white)


def samples_of(spectra: np.ndarray, count: int) -> np.ndarray:
    """Inverse of `spectra_of`: samples (count, channels) of spectra (f, channels)."""
    lines = spectra * np.sqrt(count)
    lines[1 : (count + 1) // 2] /= np.sqrt(2.0)
    return np.fft.irfft(lines, count, axis=0)


def in_bins(values: np.ndarray, where: np.ndarray, edges: Sequence[float] | np.ndarray) -> np.ndarray:
    """Means of whitened residuals in bins of another signal, in standard errors of white noise, (bins,).

    Bins with fewer than five samples are NaN.
    """
    place = np.clip(np.searchsorted(edges, where, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(place, minlength=len(edges) - 1)
    total = np.bincount(place, values, minlength=len(edges) - 1)
    return np.where(count >= 5, total / np.sqrt(np.maximum(count, 1)), np.nan)
