"""Linear response of a prediction to small noise of the measured drive."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import fft
from scipy.linalg import schur

from piezoharvest.predict.any_prediction import AnyPrediction
from piezoharvest.predict.band_limited import cubic_of_sine
from piezoharvest.predict.prediction import Prediction

MIN_FREQUENCY = 1e-6  # of the sample rate: lowest frequency, because open electrodes have no response at zero


def gain_of(prediction: AnyPrediction, channels: Sequence[str], frequencies: np.ndarray) -> np.ndarray:
    """Response of channels to small noise of the drive, with every element linear at its mean slope in the record.

    It is that of the discrete model: between samples the noise is interpolated as the drive is.

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

    def made() -> np.ndarray:
        gain = specimen_gain(prediction, channels, frequencies)
        return gain * _delay_factors(prediction, channels, frequencies) if prediction.transducer.effects else gain

    return prediction.shared(("gain", tuple(channels), frequencies.tobytes()), made)


def _delay_factors(prediction: AnyPrediction, channels: Sequence[str], frequencies: np.ndarray) -> np.ndarray:
    """Factors of the channels' delays, (f, channels), by splines through the samples."""
    h, effects = prediction.setting.sample_time, prediction.transducer.effects
    angle = 2 * np.pi * np.maximum(frequencies * h, MIN_FREQUENCY)
    factors = []
    for channel in channels:
        samples = sum(effect.late(channel) for effect in effects) / h
        whole = int(np.floor(samples))
        s, c = 1.0 - (samples - whole), _spline(angle)
        back = np.exp(-1j * angle * (whole + 1))
        factors.append(back * (c[0] + c[1] * s + c[2] * s**2 + c[3] * s**3) if samples else np.ones_like(back))
    return np.column_stack(factors)


def _spline(angle: np.ndarray) -> list[np.ndarray]:
    """Coefficients of the cubic spline through a sine's samples, in powers of the fraction of the step."""
    turn, rate = np.exp(1j * angle), 3j * np.sin(angle) / (2.0 + np.cos(angle))
    return [
        np.ones_like(rate),
        rate,
        3.0 * (turn - 1.0) - rate * (2.0 + turn),
        2.0 * (1.0 - turn) + rate * (1.0 + turn),
    ]


def small_response(prediction: AnyPrediction, channels: Sequence[str], drive: np.ndarray) -> np.ndarray:
    """Response (n, channels) to a small addition (n,) to the drive, taken as periodic."""
    n = len(drive)
    if not np.any(drive):
        return np.zeros((n, len(channels)))
    gain = gain_of(prediction, channels, np.fft.rfftfreq(n, prediction.setting.sample_time))
    # The samples are contiguous in memory, as the frequencies are.
    return np.asarray(fft.irfft(gain.T * fft.rfft(drive), n)).T


def specimen_gain(prediction: AnyPrediction, channels: Sequence[str], frequencies: np.ndarray) -> np.ndarray:
    """Response (f, channels) of the specimen itself, without the delays of the channels."""
    prediction = prediction.linear
    m, h = prediction.matrices, prediction.setting.sample_time
    angle = 2 * np.pi * np.maximum(frequencies * h, MIN_FREQUENCY)
    turn, cubic = np.exp(1j * angle), (cubic_of_sine if prediction.setting.motion.fast else _spline)(angle)
    drive = [cubic[0], cubic[1] / h]
    outputs = len(m.O) - len(m.channels)
    known = [k for k, channel in enumerate(channels) if channel in m.channels]
    line = _LinearStep.of(prediction, [outputs + m.channels.index(channels[k]) for k in known])
    # Frequencies are the last axis throughout. Factors of the drive's part of the equations, (8, f):
    driven = np.array([*cubic, *drive, *(turn * part for part in drive)])
    states = _solved(line.kept, line.A, turn, line.driven() @ driven)
    # The dc side of a circuit averages small noise out.
    gain = np.zeros((len(frequencies), len(channels)), complex)
    gain[:, known] = (line.C @ states + line.D @ np.array(drive)).T
    return gain


def _solved(kept: np.ndarray, A: np.ndarray, turn: np.ndarray, forced: np.ndarray) -> np.ndarray:
    """(turn kept - A)^-1 forced, (n, f), at all frequencies.

    By the Schur form of kept^-1 A: back substitution over the few states, each step for all frequencies.
    """
    triangle, unitary = schur(np.linalg.solve(kept, A), output="complex")[:2]
    states = unitary.conj().T @ np.linalg.solve(kept, forced)
    for k in range(len(A) - 1, -1, -1):
        states[k] += triangle[k, k + 1 :] @ states[k + 1 :]
        states[k] /= turn - triangle[k, k]
    return unitary @ states


class _LinearStep(NamedTuple):
    """A step of the discrete model with its elements linear.

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
    def of(cls, prediction: Prediction, rows: Sequence[int]) -> _LinearStep:
        """Eliminate the elements: w = local * inputs, inputs = O [z; w; e], straight lines within a step."""
        m, (M, H, O, _) = prediction.matrices, prediction.step  # noqa: E741
        n, w = len(M), len(m.kinds)
        H = H[:, :w]
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

    def driven(self) -> np.ndarray:
        """Coefficients of the drive: cubic, before and after, (n, 8)."""
        return np.hstack([self.cubic, self.before, self.after])
