"""Residuals of a record, whitened, and the sums of squares that a fit is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezoharvest.identify.data import Data
from piezoharvest.identify.noise import Noise
from piezoharvest.predict.parameters import Parameter
from piezoharvest.predict.prediction import Prediction
from piezoharvest.transducer import Transducer

EDGES = np.array([0.0, 0.1, 0.3, 0.6, 1.2, 2.4, 5, 10, 20, 40, 80, 160, 320, 640, 1e9])  # Hz: bands of the colour


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
    """

    information: np.ndarray
    gradient: np.ndarray
    squares: np.ndarray
    count: np.ndarray


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

    def prediction(self, data: Data, own: np.ndarray | None = None) -> Prediction:
        """Prediction of a record; `own` are its states at the start and jumps."""
        return Prediction(self.transducer, data.setting, self.parameters, own)


def gain_of(prediction: Prediction, channels: Sequence[str], frequencies: np.ndarray) -> np.ndarray:
    """Response of the channels to small noise of the drive, operators slipping, (f, channels)."""
    m = prediction.matrices
    n, w, first = len(m.A), len(m.kinds), len(m.O) - len(m.channels)
    s = 2j * np.pi * np.maximum(frequencies, 1e-6 / prediction.setting.sample_time)
    b = m.B[:, :1] + 0j
    inner = np.linalg.solve(s[:, None, None] * np.eye(n) - m.A, b + s[:, None, None] * m.B[:, 1:2])[:, :, 0]
    rows = m.O[[first + m.channels.index(channel) for channel in channels]]
    return inner @ rows[:, :n].T + rows[:, n + w] + s[:, None] * rows[:, n + w + 1]


class Whitener:
    """Makes the spectra of a record's residuals white; it stays as it is while a model is fitted.

    Parameters
    ----------
    prediction : Prediction
        Of the record, by which the noise of the drive passes.
    noise : Noise
    data : Data
    """

    def __init__(self, prediction: Prediction, noise: Noise, data: Data) -> None:
        self._prediction, self._noise, self._data = prediction, noise, data
        self._matrices: dict[int, np.ndarray] = {}

    def of(self, count: int) -> np.ndarray:
        """Matrices for a block of so many samples, (f, channels, channels)."""
        if count not in self._matrices:
            data = self._data
            gain = gain_of(self._prediction, data.channels, np.fft.rfftfreq(count, data.setting.sample_time))
            covariance = self._noise.covariance(data.channels, data.drive, gain)
            self._matrices = {count: np.linalg.inv(np.linalg.cholesky(covariance))}
        return self._matrices[count]

    def sums(self, model: Model, own: np.ndarray) -> Sums:
        """Sums of the record for a model.

        Raises
        ------
        PredictionError
            The model cannot follow the record.
        """
        parts = [
            _whitened(residual, slopes, self.of(len(residual)), self._data.setting.sample_time)
            for _, _, residual, slopes in residual_blocks(model, self._data, own, True)
        ]
        return Sums(*(sum(each) for each in zip(*(vars(part).values() for part in parts), strict=True)))


def residual_blocks(model: Model, data: Data, own: np.ndarray, derivatives: bool):
    """Blocks (begin, residuals, derivatives) of a record; `own` ends with the offsets."""
    offsets = [c for c in data.channels if c in model.offset_channels]
    count = len(own) - len(offsets)
    prediction = model.prediction(data, own[:count])
    places = [prediction.channels.index(c) for c in data.channels]
    shift = np.zeros(len(data.channels))
    for k, c in enumerate(offsets):
        shift[data.channels.index(c)] = own[count + k]
    for block in prediction.blocks(derivatives):
        end = block.begin + len(block.values)
        residual = data.values[block.begin : end] - block.values[:, places] - shift
        if not derivatives:
            yield prediction, block.begin, residual, None
            continue
        more = np.zeros((len(residual), len(data.channels), len(offsets)))
        for k, c in enumerate(offsets):
            more[:, data.channels.index(c), k] = 1.0
        yield prediction, block.begin, residual, np.concatenate([block.derivatives[:, places], more], axis=2)


def spectra_of(values: np.ndarray) -> np.ndarray:
    """One-sided spectra along the first axis, whose squares sum to the squares of the values."""
    count = len(values)
    found = np.fft.rfft(values, axis=0) / np.sqrt(count)
    found[1 : (count + 1) // 2] *= np.sqrt(2.0)
    return found


def _whitened(residual: np.ndarray, slopes: np.ndarray, W: np.ndarray, sample_time: float) -> Sums:
    """Sums of one block, by bands."""
    count, channels = residual.shape
    R = (W @ spectra_of(residual)[:, :, None])[:, :, 0]
    D = W @ spectra_of(slopes)
    edges = np.searchsorted(np.fft.rfftfreq(count, sample_time), EDGES)
    P, bands = D.shape[2], len(EDGES) - 1
    sums = Sums(np.zeros((bands, P, P)), np.zeros((bands, P)), np.zeros(bands), np.zeros(bands))
    for band in range(bands):
        part = slice(edges[band], edges[band + 1])
        if part.start == part.stop:
            continue
        d, r = D[part].reshape(-1, P), R[part].reshape(-1)
        full, flat = np.concatenate([d.real, d.imag]), np.concatenate([r.real, r.imag])
        sums.information[band], sums.gradient[band], sums.squares[band] = full.T @ full, full.T @ flat, flat @ flat
        # The lines at zero and at half the sample rate have one component, the others two.
        ends = (part.start == 0) + (part.stop == count // 2 + 1 and count % 2 == 0)
        sums.count[band] = (2 * (part.stop - part.start) - ends) * channels
    return sums
