"""How a prediction passes on small noise of the measured drive, with derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from piezoharvest.predict.prediction import Prediction

SMALL = 1e-30  # complex step
SLOWEST = 1e-6  # of the sample rate: open electrodes have no response at zero


def gain_of(prediction: Prediction, channels: Sequence[str], frequencies: np.ndarray) -> np.ndarray:
    """Response of channels to small noise of the drive, every element a straight line of its mean slope in the record.

    It is that of the march itself from sample to sample: between them noise runs along the spline through it.

    Parameters
    ----------
    prediction : Prediction
    channels : sequence of str
    frequencies : (f,) array
        Hz.

    Returns
    -------
    (f, channels) complex array
    """
    return _Gain(prediction, channels, frequencies).value


def gain_slopes(
    prediction: Prediction, channels: Sequence[str], frequencies: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Response as `gain_of` gives it, and its derivatives to the parameters, (f, channels, parameters)."""
    gain = _Gain(prediction, channels, frequencies)
    return gain.value, gain.slopes()


class _Gain:
    """States and outputs under a sine of the drive, every element being a straight line of its mean slope."""

    def __init__(self, prediction: Prediction, channels: Sequence[str], frequencies: np.ndarray) -> None:
        m, h = prediction.matrices, prediction.setting.sample_time
        angle = 2 * np.pi * np.maximum(frequencies * h, SLOWEST)
        self._turn = np.exp(1j * angle)
        # Slope of the cubic spline through a sine's samples, for one sample.
        rate = 3j * np.sin(angle) / (2.0 + np.cos(angle))
        ones, turn = np.ones_like(rate), self._turn
        self._cubic = np.column_stack([
            ones, rate, 3.0 * (turn - 1.0) - rate * (2.0 + turn), 2.0 * (1.0 - turn) + rate * (1.0 + turn)
        ])  # fmt: skip
        self._drive = np.column_stack([ones, rate / h])
        outputs = len(m.O) - len(m.channels)
        self._rows = [outputs + m.channels.index(channel) for channel in channels]
        self._prediction = prediction
        step = prediction.step
        self._line = _Line.of(step.M, step.H, step.O, self._rows, prediction)
        line = self._line
        self._resolvent = np.linalg.inv(turn[:, None, None] * line.kept - line.A)
        pushed = self._cubic @ line.cubic.T + self._drive @ line.before.T + turn[:, None] * (self._drive @ line.after.T)
        self._states = (self._resolvent @ pushed[:, :, None])[:, :, 0]
        self.value = self._states @ line.C.T + self._drive @ line.D.T

    def slopes(self) -> np.ndarray:
        """Derivatives to the parameters, (f, channels, parameters)."""
        prediction, turn, found = self._prediction, self._turn, []
        step, slopes = prediction.step, prediction.slopes
        for k in range(len(prediction.parameters)):
            parts = [getattr(step, name) + 1j * SMALL * getattr(slopes, name)[:, :, k] for name in ("M", "H", "O")]
            d = _Line(*(np.imag(part) / SMALL for part in _Line.of(*parts, self._rows, prediction)))
            pushed = self._states @ d.A.T - turn[:, None] * (self._states @ d.kept.T) + self._cubic @ d.cubic.T
            pushed += self._drive @ d.before.T + turn[:, None] * (self._drive @ d.after.T)
            moved = (self._resolvent @ pushed[:, :, None])[:, :, 0]
            found.append(moved @ self._line.C.T + self._states @ d.C.T + self._drive @ d.D.T)
        return np.stack(found, axis=-1) if found else np.zeros((*self.value.shape, 0), complex)


class _Line(NamedTuple):
    """A step with its elements as straight lines.

    kept z(next) = A z + cubic c + before e + after e(next), outputs = C z + D e, where e is the drive and its rate.
    """

    kept: np.ndarray
    A: np.ndarray
    cubic: np.ndarray
    before: np.ndarray
    after: np.ndarray
    C: np.ndarray
    D: np.ndarray

    @classmethod
    def of(cls, M, H, O, rows: Sequence[int], prediction: Prediction) -> _Line:  # noqa: E741
        """Eliminate the elements: w = local * inputs, inputs = O [z; w; e]."""
        m, n = prediction.matrices, H.shape[0]
        w = H.shape[1]
        inputs = (len(O) - len(m.channels)) // 2
        local = np.zeros((w, inputs))
        for j, (first, second) in enumerate(m.places):
            local[j, first] += prediction.local[j, 0]
            local[j, second] += prediction.local[j, 1]
        e = slice(n + w, n + w + 2)
        through = np.linalg.inv(np.eye(w) - local @ O[:inputs, n : n + w]) @ local
        P, Q = through @ O[:inputs, :n], through @ O[:inputs, e]
        Mw, Ow = M[:, n : n + w], O[rows, n : n + w]
        return cls(
            np.eye(n) - H @ P, M[:, :n] + Mw @ P, M[:, n + w : n + w + 4], Mw @ Q, H @ Q,
            O[rows, :n] + Ow @ P, O[rows, e] + Ow @ Q,
        )  # fmt: skip
