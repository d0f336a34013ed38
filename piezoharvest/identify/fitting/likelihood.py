"""Whitened residuals of a record, and the sums of squares that a fit uses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property, reduce
from operator import add

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.model import Model, evaluated, residual_blocks
from piezoharvest.identify.noise.noise_gain import gain_of, small_response
from piezoharvest.identify.noise.noise_model import Noise, Rounding, rounding
from piezoharvest.identify.noise.spectra import first_lines, gram, in_time, line_spectra, parts, whitened
from piezoharvest.identify.noise.switching.common_errors import CommonErrors
from piezoharvest.identify.noise.switching.event_noise import EventNoise
from piezoharvest.predict.any_prediction import AnyPrediction
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.prediction import PredictionError

# Cycles per sample: bands of the colour of residuals, from about an octave each down to a line of 10^4 samples.
BAND_EDGES = np.array([0.0, 1e-4, 3e-4, 6e-4, 1.2e-3, 2.4e-3, 5e-3, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 1.0])
LARGEST = 1e120  # residual or derivative whose squares, over those of a noise, are still numbers
MIN_ROUNDING_ERROR = 1e-3  # of the noise: smaller errors by rounding are neglected


@dataclass(frozen=True)
class Sums:
    """Contribution of one record to cost and information, in units of its noise.

    Attributes
    ----------
    information : (bands, p, p) array
        Sums of products of the derivatives by bands of frequency.
    gradient : (bands, p) array
        Sums of products of derivatives and residuals.
    squares : (bands,) array
        Sums of squares of the residuals.
    count : (bands,) array
        Number of squares.
    scatter : (p, p) array
        Covariance of the gradient that rounded sensors add.
    counted : (p, p) array
        What the information counts of the noise of switching, as if its errors were independent.
    switching : (p, n) array
        Realisations of the change of the gradient, over the square root of `n`, by a switch that acts earlier or later.
        The last three are of `Fit.scattered` alone, elsewhere zero.
    """

    information: np.ndarray
    gradient: np.ndarray
    squares: np.ndarray
    count: np.ndarray
    scatter: np.ndarray
    counted: np.ndarray
    switching: np.ndarray

    @classmethod
    def empty(cls, p: int) -> Sums:
        """Sums equal to zero, for `p` parameters."""
        bands = len(BAND_EDGES) - 1
        sums, bare = (np.zeros((bands, p, p)), np.zeros((bands, p))), (np.zeros(bands), np.zeros(bands))
        return cls(*sums, *bare, np.zeros((p, p)), np.zeros((p, p)), np.zeros((p, 0)))

    @property
    def spread(self) -> np.ndarray:
        """Covariance of the gradient that white noise does not have, (p, p)."""
        return self.scatter - self.counted + self.switching @ self.switching.T

    def __add__(self, other: Sums) -> Sums:
        return Sums(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


class Whitener:
    """Whitens the spectra of a record's residuals; it is fixed while a model is fitted.

    The noise of the drive is subtracted from the residuals as filtered by the specimen. The filter need not be exact
    for white residuals, but must be the same as in the whitening: that of another model is as good, and the difference
    between the filters of two models is no information about these.

    Parameters
    ----------
    prediction : Prediction or CircuitPrediction
        Prediction of the record, whose mean slopes filter the noise of the drive.
    noise : Noise
        Of the campaign.
    data : Data
    """

    def __init__(self, prediction: AnyPrediction, noise: Noise, data: Data) -> None:
        self._prediction, self._noise, self._data = prediction, noise.at(data.levels), data
        self._matrices: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self._passed: dict[tuple[int, int], np.ndarray] = {}
        self._common: dict[tuple[int, int], CommonErrors | None] = {}

    @cached_property
    def _steps(self) -> list[Rounding]:
        """Rounding of the channels."""
        data = self._data
        return [rounding(data.record[channel], self._noise.sigma[channel]) for channel in data.channels]

    def of(self, count: int) -> np.ndarray:
        """Whitening matrices (f, channels, channels) for a block of `count` samples."""
        return self._of(count)[0]

    def _of(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """The matrices of `of`, and the same with the frequencies last, lower triangular."""
        if count not in self._matrices:
            sigma = tuple(self._noise.sigma.get(name) for name in (*self._data.channels, self._data.drive))
            key = "whitening", self._data.channels, sigma, count
            self._matrices = {count: self._prediction.shared(key, lambda: self._made(count))}
        return self._matrices[count]

    def _made(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        data = self._data
        self._settle()
        gain = gain_of(self._prediction, data.channels, np.fft.rfftfreq(count, data.setting.sample_time))
        covariance = self._noise.covariance(data.channels, data.drive, gain)
        if self._events is not None:
            covariance = covariance + self._events.covariance(count)
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        return white, np.ascontiguousarray(white.transpose(1, 2, 0))

    def passed(self, begin: int, end: int) -> np.ndarray:
        """Response to the noise of the drive in some samples, (samples, channels)."""
        if (begin, end) not in self._passed:
            self._passed = {(begin, end): self.passes(self._data.rest[begin:end])}
        return self._passed[begin, end]

    def passes(self, drive: np.ndarray) -> np.ndarray:
        """Response to a small addition to the drive, (samples, channels)."""
        self._settle()
        return small_response(self._prediction, self._data.channels, drive)

    def _settle(self) -> None:
        """Compute mean slopes of the elements if the drive has noise."""
        noisy = self._data.drive in self._noise.sigma or np.any(self._data.rest)
        if self._prediction.nonlinear and noisy:
            self._prediction.settle()

    @cached_property
    def _events(self) -> EventNoise | None:
        """What is not known behind a circuit because of its switch."""
        prediction, data = self._prediction, self._data
        if not isinstance(prediction, CircuitPrediction):
            return None
        drive, noise = data.record[data.drive] - data.rest, self._noise.sigma.get(data.drive, 0.0)
        signal = data.record.signals[data.drive]
        return EventNoise(prediction.plain, data.channels, signal, drive, self._noise.sigma, noise)

    @cached_property
    def _weights(self) -> np.ndarray | None:
        """Weights (samples, channels) of the residuals; None where all are one."""
        events, hidden = self._events, self._data.hidden
        own = None if self._data.variance is None else self._weights_within(self._data.variance)
        if events is None:
            return own
        weights = events.weights if own is None else own * events.weights
        return weights if hidden is None else np.where(hidden[:, None], 0.0, weights)

    def _weights_within(self, variance: np.ndarray) -> np.ndarray:
        """Weights for noise of the channels of a relative variance, beside which that of the drive is constant."""
        data, sigma = self._data, self._noise.sigma
        own = np.array([sigma[channel] ** 2 for channel in data.channels])
        self._settle()
        gain = gain_of(self._prediction, data.channels, np.fft.rfftfreq(len(data), data.setting.sample_time))
        passed = sigma.get(data.drive, 0.0) ** 2 * np.mean(np.abs(gain) ** 2, axis=0) / own
        return np.sqrt((1.0 + passed) / (variance + passed))

    def weighted(self, begin: int, values: np.ndarray) -> np.ndarray:
        """Residuals of consecutive samples, or their derivatives, (samples, channels, ...), each with its weight."""
        weights = self._weights
        if weights is None:
            return values
        part = weights[begin : begin + len(values)]
        return values * part.reshape(*part.shape, *[1] * (values.ndim - 2))

    def sums(self, model: Model, nuisance: np.ndarray, scatter: bool = False) -> Sums:
        """Sums of the record for a model, with the scatter of the gradient if required.

        Raises
        ------
        PredictionError
            The model cannot follow the record.
        """
        parts = []
        for begin, found, slopes in evaluated(model, self._data, nuisance):
            end = begin + len(found)
            residual = found - self.passed(begin, end)
            if not (_is_moderate(residual) and _is_moderate(slopes)):
                raise PredictionError("the model diverges: its predictions leave the range of numbers")
            predicted = self._data.part(begin, end) - residual
            residual, slopes = self.weighted(begin, residual), self.weighted(begin, slopes)
            white = self.of(len(residual))
            more = (lambda D, n=begin, x=predicted, W=white: self.spread(n, x, D, W)) if scatter else None
            R, D = self.whitened(begin, residual), self.whitened(begin, slopes)
            parts.append(_by_bands(R, D, len(residual), more))
        return reduce(add, parts)

    def whitened(self, begin: int, values: np.ndarray) -> np.ndarray:
        """Whitened spectra (channels, ..., f) of weighted residuals, or their derivatives, (samples, channels, ...)."""
        spectra = whitened(self._of(len(values))[1], line_spectra(np.moveaxis(values, 0, -1)))
        return self.reduced(begin, len(values), spectra)

    def reduced(self, begin: int, count: int, spectra: np.ndarray) -> np.ndarray:
        """Whitened spectra (channels, ..., f) of some samples, with errors that the record has in common reduced."""
        if (begin, count) not in self._common:
            self._common = {(begin, count): self._common_in(begin, count)}
        common = self._common[begin, count]
        return spectra if common is None else common.reduced(spectra)

    def _common_in(self, begin: int, count: int) -> CommonErrors | None:
        """Errors that some samples have in common; None where there are none."""
        common = None if self._events is None else self._events.common[:, begin : begin + count]
        if common is None or len(common) == 0:
            return None
        values = self.weighted(begin, common.transpose(1, 2, 0))
        return CommonErrors.of(whitened(self._of(count)[1], line_spectra(np.moveaxis(values, 0, -1))))

    def left(self, model: Model, nuisance: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Blocks (begin, residuals, their whitened spectra (f, channels)) of a record for a model."""
        for _, begin, residual, _ in residual_blocks(replace(model, parameters=()), self._data, nuisance, False):
            residual -= self.passed(begin, begin + len(residual))
            yield begin, residual, self.whitened(begin, self.weighted(begin, residual)).T

    def spread(
        self, begin: int, predicted: np.ndarray, whitened: np.ndarray, white: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`scatter` and `counted` (p, p), and `switching` (p, n), of `Sums` for a block.

        Parameters
        ----------
        begin : int
            First sample of a block.
        predicted : (samples, channels) array
            Its predictions.
        whitened : (f, channels, p) array
            Spectra of its derivatives.
        white : (f, channels, channels) array
            Matrices that whitened them.
        """
        # A gradient is the product of whitened derivatives and whitened residuals: errors reach it through both.
        whitened = self.reduced(begin, len(predicted), whitened.transpose(1, 2, 0)).transpose(2, 0, 1)
        scatter = self.rounding_scatter(predicted, whitened, white)
        if self._events is None or self._events.known:
            return scatter, np.zeros_like(scatter), np.zeros((len(scatter), 0))
        channels = range(predicted.shape[1])
        slopes = np.array([_slopes(k, whitened, white, len(predicted)) for k in channels])
        if self._data.hidden is not None:
            slopes[:, self._data.hidden[begin : begin + len(predicted)]] = 0.0
        switching, counted = self._events.spread(begin, slopes)
        return scatter, counted, switching

    def rounding_scatter(self, predicted: np.ndarray, whitened: np.ndarray, white: np.ndarray) -> np.ndarray:
        """Covariance of the gradient by errors of rounded sensors, (p, p), with random phase, due to a free offset.

        Parameters
        ----------
        predicted, whitened, white
            As in `spread`.
        """
        found = np.zeros((whitened.shape[2],) * 2)
        for k, (channel, rounded) in enumerate(zip(self._data.channels, self._steps, strict=True)):
            if max(rounded.size, rounded.second) < MIN_ROUNDING_ERROR * self._noise.sigma[channel]:
                continue
            turns = predicted[:, k] / rounded.step
            slopes = _slopes(k, whitened, white, len(turns))
            waves = (
                np.sqrt(0.5) * rounded.size * np.array([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)]) @ slopes
            )
            each = rounded.second * by_code(turns, slopes)
            found += waves.T @ waves + each @ each.T
        return found


def _is_moderate(values: np.ndarray) -> bool:
    """True if squares of values are numbers; without a copy of the derivatives of a long record."""
    return bool(values.min(initial=0.0) > -LARGEST and values.max(initial=0.0) < LARGEST)


def _slopes(k: int, whitened: np.ndarray, white: np.ndarray, count: int) -> np.ndarray:
    """Changes of the gradient with errors of the samples of channel `k`, (samples, p)."""
    return in_time(np.einsum("fc,fcp->fp", np.conj(white[:, :, k]), whitened), count)


def by_code(turns: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Sums (p, codes) of slopes (samples, p) over the samples with the same code of a converter.

    Codes that do not occur are left out: in simulated values the step may be a billionth of the range.
    """
    _, code = np.unique(np.round(turns), return_inverse=True)
    return np.array([np.bincount(code, column) for column in slopes.T])


def spectra_of(values: np.ndarray) -> np.ndarray:
    """One-sided spectra along the first axis, whose squares sum to the squares of the values."""
    return np.moveaxis(line_spectra(np.moveaxis(values, 0, -1)), -1, 0)


def _by_bands(R: np.ndarray, D: np.ndarray, count: int, spread: Callable | None) -> Sums:
    """Sums of one block of so many samples, by bands, from whitened spectra of residuals and derivatives."""
    channels, edges = len(R), first_lines(BAND_EDGES, count)
    P, bands = D.shape[1], len(BAND_EDGES) - 1
    sums = Sums.empty(P)
    if spread is not None:
        scatter, counted, switching = spread(D.transpose(2, 0, 1))
        sums = replace(sums, scatter=scatter, counted=counted, switching=switching)
    for band in range(bands):
        part = slice(edges[band], edges[band + 1])
        if part.start == part.stop:
            continue
        sums.information[band] = gram(D[:, :, part])
        r = parts(R[:, part])
        sums.gradient[band] = sum(d @ e for d, e in zip(parts(D[:, :, part]), r, strict=True))
        sums.squares[band] = float(np.sum(r**2))
        # The lines at zero and at half the sample rate have one component, the others two.
        ends = (part.start == 0) + (part.stop == count // 2 + 1 and count % 2 == 0)
        sums.count[band] = (2 * (part.stop - part.start) - ends) * channels
    return sums
