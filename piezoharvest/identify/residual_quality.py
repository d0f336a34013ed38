"""Residuals of records against the noise that is expected in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.likelihood import Whitener
from piezoharvest.identify.fitting.measured_responses import FrequencyData, ResponseQuality
from piezoharvest.identify.fitting.model import unexplained_blocks
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_gain import gain_of
from piezoharvest.identify.result import Quality, RecordQuality

MOST_SAMPLES = 1 << 17  # of an impulse response, which has decayed after so many


def judged(data: Sequence[Data | FrequencyData], found: Fit) -> list[RecordQuality]:
    """Residuals of each record."""
    each_record = []
    for each, nuisance, white in zip(data, found.nuisance, found.white, strict=True):
        if isinstance(each, FrequencyData):
            value, _ = each.response(replace(found.model, parameters=()))
            rms = float(np.sqrt(np.mean(np.abs(each.record.response - value) ** 2)))
            noise = float(np.sqrt(np.mean(each.sigma_of_lines**2)))
            output = f"{each.record.output}/{each.record.input}"
            judgement = each.judged(value)
            quality = Quality({output: rms}, {output: noise}, {output: judgement.ratio})
            missed = judgement.missed is not None
            each_record.append(RecordQuality(each.name, each.role, quality, {}, _warning(each, judgement), missed))
            continue
        squares, count = np.zeros(len(each.channels)), 0
        for _, begin, residual in unexplained_blocks(found.model, each, nuisance):
            assert isinstance(white, Whitener)
            squares += (white.weighted(begin, residual) ** 2).sum(axis=0)
            count += len(residual)
        rms = dict(zip(each.channels, np.sqrt(squares / count).tolist(), strict=True))
        names = Problem([each], found.model.transducer, found.model.offset_channels).nuisance_names(found.model, each)
        nuisance_values = dict(zip(names, nuisance.tolist(), strict=True))
        each_record.append(
            RecordQuality(each.name, each.role, Quality(rms, _expected_rms(each, found)), nuisance_values)
        )
    return each_record


def _warning(data: FrequencyData, judged: ResponseQuality) -> str:
    """Warning about the fit of a response, or ""."""
    if data.reference is None:
        return f"{data.name}: {counted(len(data), 'line')}, too few to show their noise: the residual was used instead"
    if judged.missed is not None:
        return (
            f"{data.name}: near {judged.missed:.6g} Hz the fit is off by {judged.share:.0%} of the response, where the "
            "noise is far less: it misses a resonance, or the specimen has one that the model lacks"
        )
    if judged.lacking:
        return (
            f"{data.name}: the residual is {judged.ratio:.3g} times the noise that the lines themselves show: the "
            "model lacks something; standard errors are increased accordingly"
        )
    return ""


def _expected_rms(data: Data, found: Fit) -> dict[str, float]:
    """Standard deviation of residuals from noise alone, that of the drive included.

    The response to the noise of the drive builds up from the beginning of the record, before which none was measured:
    the n-th sample has that of n samples of noise, its variance the sum of as many squares of the impulse response.
    """
    count = len(data)
    frequencies = np.fft.rfftfreq(min(2 * count, MOST_SAMPLES), data.setting.sample_time)
    gain = gain_of(replace(found.model, parameters=()).prediction(data), data.channels, frequencies)
    impulse = np.fft.irfft(gain, axis=0)[:count]
    share = 1.0 - np.arange(len(impulse)) / count  # of the samples that this part of the response has reached
    sigma = found.noise.at(data.levels).sigma
    passed = share @ impulse**2 * sigma.get(data.drive, 0.0) ** 2
    own = [sigma[channel] ** 2 for channel in data.channels]
    return dict(zip(data.channels, np.sqrt(passed + own).tolist(), strict=True))


def combined_quality(records: Sequence[RecordQuality]) -> Quality:
    """Root mean squares over records."""

    def mean(which: str) -> dict[str, float]:
        values: dict[str, list[float]] = {}
        for record in records:
            for channel, value in getattr(record.quality, which).items():
                values.setdefault(channel, []).append(value)
        return {channel: float(np.sqrt(np.mean(np.square(some)))) for channel, some in values.items()}

    return Quality(mean("rms"), mean("noise"), mean("weighted"))
