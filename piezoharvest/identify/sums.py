"""Residuals of a record, whitened, and the sums of squares that a fit is made of."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import reduce
from operator import add
from typing import NamedTuple

import numpy as np

from piezoharvest.identify.data import Data
from piezoharvest.identify.gain import gain_of, gain_slopes, small_response, specimen_gain
from piezoharvest.identify.noise import Noise, rounding
from piezoharvest.identify.spectra import by_bands, components, gram, in_time, line_spectra, parts, passed_on, whitened
from piezoharvest.predict.parameters import Parameter
from piezoharvest.predict.prediction import Lowered, Prediction
from piezoharvest.predict.sensing import sensed
from piezoharvest.transducer import Transducer

EDGES = np.array([0.0, 0.1, 0.3, 0.6, 1.2, 2.4, 5, 10, 20, 40, 80, 160, 320, 640, 1e9])  # Hz: bands of the colour

ROUND = 1e-3  # of the noise: smaller errors by rounding do not matter


@dataclass(frozen=True)
class Sums:
    """What one record says, in units of its noise.

    Attributes
    ----------
    information : (bands, p, p) array
        Sums of products of the derivatives by bands of frequency.
    gradient : (bands, p) array
        Sums of products of derivatives and residuals.
    squares : (bands,) array
        Sums of squares of the residuals.
    count : (bands,) array
        How many squares.
    scatter : (p, p) array
        Covariance of the gradient that rounded sensors add.
    noisy : (bands, p, p) array
        What the noise of the drive adds to the products of the derivatives; `information` is without it.
    """

    information: np.ndarray
    gradient: np.ndarray
    squares: np.ndarray
    count: np.ndarray
    scatter: np.ndarray
    noisy: np.ndarray

    @classmethod
    def empty(cls, p: int) -> Sums:
        """Sums of nothing, for so many parameters."""
        bands = len(EDGES) - 1
        return cls(
            np.zeros((bands, p, p)), np.zeros((bands, p)), np.zeros(bands), np.zeros(bands), np.zeros((p, p)),
            np.zeros((bands, p, p)),
        )  # fmt: skip

    def __add__(self, other: Sums) -> Sums:
        return Sums(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


@dataclass(frozen=True)
class Model:
    """A transducer with what varies of it, and for each record its own numbers.

    Attributes
    ----------
    transducer : Transducer
    parameters : tuple of Parameter
        What is varied for all records.
    offset_channels : tuple of str
        Channels whose offset is free in every record.
    """

    transducer: Transducer
    parameters: tuple[Parameter, ...]
    offset_channels: tuple[str, ...]
    _lowered: dict = field(init=False, repr=False, compare=False, default_factory=dict)

    def prediction(self, data: Data, own: np.ndarray | None = None) -> Prediction:
        """Prediction of a record; `own` are its states at the start and jumps."""
        return Prediction(self.transducer, data.setting, self.parameters, own, self.lowered(data))

    def lowered(self, data: Data) -> Lowered:
        """Equations for a record, which others share."""
        key = Lowered.key(data.setting)
        if key not in self._lowered:
            self._lowered[key] = Lowered(self.transducer, data.setting, self.parameters)
        return self._lowered[key]


class Whitener:
    """Makes the spectra of a record's residuals white; it stays as it is while a model is fitted.

    Parameters
    ----------
    prediction : Prediction
        Of the record, by which the noise of the drive passes.
    noise : Noise
    data : Data
    rough : bool
        Far from the solution, where what the noise of the drive leads to expect means little: it is not taken off.
    """

    def __init__(self, prediction: Prediction, noise: Noise, data: Data, *, rough: bool = False) -> None:
        self._prediction, self._noise, self._data = prediction, noise, data
        self._corrected = data.drive in noise.sigma and not rough
        self._matrices: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._steps = [rounding(data.record[channel], noise.sigma[channel]) for channel in data.channels]

    def of(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Matrices (f, channels, channels) for a block of so many samples, and squares (f,) of the drive's noise."""
        return self._of(count)[:2]

    def _of(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Those of `of`, and the matrices once more with the frequencies last, lower triangular."""
        if count not in self._matrices:
            data = self._data
            gain = gain_of(self._prediction, data.channels, np.fft.rfftfreq(count, data.setting.sample_time))
            white = np.linalg.inv(np.linalg.cholesky(self._noise.covariance(data.channels, data.drive, gain)))
            rows = np.ascontiguousarray(white.transpose(1, 2, 0))
            self._matrices = {count: (white, passed_on(rows, gain.T)[1], rows)}
        return self._matrices[count]

    def sums(self, model: Model, own: np.ndarray, scatter: bool = False) -> Sums:
        """Sums of the record for a model, with what rounded sensors scatter if that is wanted.

        The derivatives of a prediction carry the same noise of the drive as its residuals, so that a model that passes
        on less of it would seem better: what each model is expected to pass on is taken off.

        Raises
        ------
        PredictionError
            The model cannot follow the record.
        """
        h, parts, passed = self._data.setting.sample_time, [], {}
        for prediction, begin, residual, slopes in residual_blocks(model, self._data, own, True):
            count = len(residual)
            white, at_first, rows = self._of(count)
            predicted = self._data.part(begin, begin + count) - residual
            rounded = (lambda D, x=predicted, W=white: self._scatter(x, D, W)) if scatter else None
            part = _whitened(residual, slopes, rows, h, rounded)
            if self._corrected:
                if count not in passed:
                    passed = {count: self._drive_noise(prediction, count, rows, at_first)}
                information, gradient, squares = passed[count]
                p = gradient.shape[1]
                part.information[:, :p, :p] -= information
                part.noisy[:, :p, :p] += information
                part.gradient[:, :p] += gradient
                part.squares[:] -= squares
            parts.append(part)
        return reduce(add, parts)

    def _scatter(self, predicted: np.ndarray, whitened: np.ndarray, white: np.ndarray) -> np.ndarray:
        """Covariance of the gradient by errors of rounded sensors, (p, p), whose phase depends on a free offset."""
        found = np.zeros((whitened.shape[2],) * 2)
        for k, (channel, rounded) in enumerate(zip(self._data.channels, self._steps, strict=True)):
            if max(rounded.size, rounded.second) < ROUND * self._noise.sigma[channel]:
                continue
            turns = predicted[:, k] / rounded.step
            slopes = in_time(np.einsum("fc,fcp->fp", np.conj(white[:, :, k]), whitened), len(turns))
            waves = (
                np.sqrt(0.5) * rounded.size * np.array([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)]) @ slopes
            )
            steps = np.round(turns).astype(np.int64)
            steps -= steps.min()
            each = rounded.second * np.array([np.bincount(steps, column) for column in slopes.T])
            found += waves.T @ waves + each @ each.T
        return found

    def _drive_noise(
        self, prediction: Prediction, count: int, white: np.ndarray, at_first: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the noise of the drive is expected to give, by bands.

        Products of the derivatives, (bands, p, p), of derivatives and passed noise, (bands, p), and squares beyond
        those at first.
        """
        frequencies = np.fft.rfftfreq(count, self._data.setting.sample_time)
        gain, slopes = gain_slopes(prediction, self._data.channels, frequencies)
        power = self._noise.sigma[self._data.drive] ** 2 * components(count)
        passed, squares = passed_on(white, gain.T)
        D = whitened(white, slopes.transpose(1, 2, 0))
        products = np.real(np.einsum("cf,cpf->fp", np.conj(passed), D)) * power[:, None]
        edges = np.minimum(np.searchsorted(frequencies, EDGES), len(frequencies))
        D *= np.sqrt(power)
        information = np.array([gram(D[:, :, a:b]) for a, b in itertools.pairwise(edges)])
        return information, by_bands(products, edges), by_bands((squares - at_first) * power, edges)


class Extra(NamedTuple):
    """An offset or a line in a record, whose size is one of the record's own numbers.

    Attributes
    ----------
    name : str
    gains : (channels,) complex array
        In which channels, and by how much.
    frequency : float
        Hz.
    effect : int or None
        The effect that it belongs to.
    """

    name: str
    gains: np.ndarray
    frequency: float
    effect: int | None

    def columns(self, time: np.ndarray) -> np.ndarray:
        """What a unit adds to the channels, (samples, channels), complex."""
        if self.frequency == 0.0:
            return np.broadcast_to(self.gains, (len(time), len(self.gains)))
        return np.exp(2j * np.pi * self.frequency * time)[:, None] * self.gains


def extras(model: Model, data: Data, prediction: Prediction) -> list[Extra]:
    """Offsets and lines of a record; a line has two, for its two phases."""
    eye = np.eye(len(data.channels))
    free = [c for c in data.channels if c in model.offset_channels]
    found = [Extra(f"{c} offset", eye[data.channels.index(c)], 0.0, None) for c in free]
    for n, effect in enumerate(model.transducer.effects):
        for channel in (*data.channels, data.drive):
            frequency = effect.line(channel)
            if frequency is None:
                continue
            # A line on the measured drive is not in the real one: the prediction has it in all channels.
            at = np.array([frequency])
            gains = (
                -specimen_gain(prediction, data.channels, at)[0]
                if channel == data.drive
                else eye[data.channels.index(channel)]
            )
            found += [
                Extra(f"{effect.name} {channel} {part}", gains * phase, frequency, n)
                for part, phase in (("cos", 1), ("sin", -1j))
            ]
    return found


def first_samples(data: Data) -> list[tuple[int, int]]:
    """Samples (and channels) after a jump: what a sensor reads there, between before and after, stands by itself."""
    return [(int(jump) + 1, c) for jump in data.setting.motion.jumps for c in range(len(data.channels))]


def own_names(model: Model, data: Data) -> tuple[str, ...]:
    """Names of a record's own numbers: states at the start, jumps, first samples after these, offsets, lines."""
    prediction = model.prediction(data)
    first = (f"{data.channels[c]} sample{sample}" for sample, c in first_samples(data))
    return (*prediction.own_names, *first, *(extra.name for extra in extras(model, data, prediction)))


def residual_blocks(model: Model, data: Data, own: np.ndarray, derivatives: bool):
    """Blocks (prediction, begin, residuals, derivatives) of a record; `own` as `own_names` names it."""
    first, more = first_samples(data), extras(model, data, model.prediction(data))
    states, read, added = np.split(own, [len(own) - len(first) - len(more), len(own) - len(more)])
    prediction = model.prediction(data, states)
    places = [prediction.channels.index(c) for c in data.channels]
    h, effects = data.setting.sample_time, model.transducer.effects
    for block in prediction.blocks(derivatives):
        end = block.begin + len(block.values)
        time = (np.arange(block.begin, end) - 0.5 * len(data)) * h
        predicted, slopes = block.values[:, places], None
        if derivatives:
            slopes = _widened(block.derivatives[:, places], len(model.parameters) + len(own))
        _add(model, more, added, time, predicted, slopes)
        rest = data.rest[block.begin : end]
        if np.any(rest):
            passed, passed_slopes = small_response(prediction, data.channels, rest, derivatives)
            predicted += passed
            if slopes is not None:
                slopes[:, :, : passed_slopes.shape[2]] += passed_slopes
        jumps = data.setting.motion.jumps - block.begin
        predicted, slopes = sensed(effects, model.parameters, data.channels, h, predicted, slopes, jumps)
        for k, (sample, c) in enumerate(first):
            if block.begin <= sample < end:
                predicted[sample - block.begin, c] += read[k]
                if slopes is not None:
                    slopes[sample - block.begin, c, k - len(first) - len(more)] = 1.0
        yield prediction, block.begin, data.part(block.begin, end) - predicted, slopes


def _widened(derivatives: np.ndarray, count: int) -> np.ndarray:
    """Derivatives (samples, channels, p) with further columns of zeros.

    The samples lie together in memory, as their spectra want them.
    """
    samples, channels, p = derivatives.shape
    found = np.zeros((channels, count, samples)).transpose(2, 0, 1)
    found[:, :, :p] = derivatives
    return found


def _add(model: Model, more: Sequence[Extra], sizes: np.ndarray, time, predicted, slopes) -> None:
    """Add offsets and lines, and their derivatives in the last columns."""
    for k, (extra, size) in enumerate(zip(more, sizes, strict=True)):
        column = extra.columns(time)
        predicted += size * np.real(column)
        if slopes is None:
            continue
        slopes[:, :, k - len(more)] = np.real(column)
        for p, parameter in enumerate(model.parameters):
            if extra.effect is not None and parameter.path == ("effects", extra.effect, "frequency"):
                slopes[:, :, p] += size * np.real(2j * np.pi * time[:, None] * column)


def spectra_of(values: np.ndarray) -> np.ndarray:
    """One-sided spectra along the first axis, whose squares sum to the squares of the values."""
    return np.moveaxis(line_spectra(np.moveaxis(values, 0, -1)), -1, 0)


def _whitened(
    residual, slopes, W: np.ndarray, sample_time: float, scatter: Callable[[np.ndarray], np.ndarray] | None
) -> Sums:
    """Sums of one block, by bands."""
    count, channels = residual.shape
    R, D = (whitened(W, line_spectra(np.moveaxis(values, 0, -1))) for values in (residual, slopes))
    edges = np.searchsorted(np.fft.rfftfreq(count, sample_time), EDGES)
    P, bands = D.shape[1], len(EDGES) - 1
    sums = Sums.empty(P)
    if scatter is not None:
        sums.scatter[:] = scatter(D.transpose(2, 0, 1))
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
