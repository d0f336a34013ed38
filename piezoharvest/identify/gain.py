"""How a prediction passes on small noise of the measured drive, with derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import fft
from scipy.linalg import schur

from piezoharvest.identify.spectra import lines
from piezoharvest.predict.prediction import Prediction
from piezoharvest.predict.sensing import delays

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
    gain = _gain(prediction, channels, frequencies).value
    return gain * _late(prediction, channels, frequencies)[0] if prediction.transducer.effects else gain


def gain_slopes(
    prediction: Prediction, channels: Sequence[str], frequencies: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Response as `gain_of` gives it, and its derivatives to the parameters, (f, channels, parameters)."""
    gain = _gain(prediction, channels, frequencies)
    if not prediction.transducer.effects:
        return gain.value, gain.slopes
    late, rate = _late(prediction, channels, frequencies)
    slopes = gain.slopes * late[:, :, None]
    for n, effect in enumerate(prediction.transducer.effects):
        for k, parameter in enumerate(prediction.parameters):
            if parameter.path == ("effects", n, "delay"):
                delayed = np.array([delays(effect, channel) for channel in channels])
                slopes[:, :, k] += gain.value * rate * delayed
    return gain.value * late, slopes


def specimen_gain(prediction: Prediction, channels: Sequence[str], frequencies: np.ndarray) -> np.ndarray:
    """Response of the specimen itself, before the wiring delays it."""
    return _gain(prediction, channels, frequencies).value


def _late(prediction: Prediction, channels: Sequence[str], frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What delays do to the channels, (f, channels), by splines through the samples, and its derivative."""
    h, effects = prediction.setting.sample_time, prediction.transducer.effects
    angle = 2 * np.pi * np.maximum(frequencies * h, SLOWEST)
    factors, rates = [], []
    for channel in channels:
        samples = sum(effect.late(channel) for effect in effects) / h
        whole = int(np.floor(samples))
        s, back = 1.0 - (samples - whole), np.exp(-1j * angle * (whole + 1))
        c = _spline(angle)
        factors.append(back * (c[0] + c[1] * s + c[2] * s**2 + c[3] * s**3) if samples else np.ones_like(back))
        rates.append(-back * (c[1] + 2 * c[2] * s + 3 * c[3] * s**2) / h)
    return np.column_stack(factors), np.column_stack(rates)


def _spline(angle: np.ndarray) -> list[np.ndarray]:
    """Coefficients of the cubic spline through a sine's samples, in powers of the share of the step."""
    turn, rate = np.exp(1j * angle), 3j * np.sin(angle) / (2.0 + np.cos(angle))
    return [
        np.ones_like(rate),
        rate,
        3.0 * (turn - 1.0) - rate * (2.0 + turn),
        2.0 * (1.0 - turn) + rate * (1.0 + turn),
    ]


def small_response(
    prediction: Prediction, channels: Sequence[str], drive: np.ndarray, derivatives: bool, highest: float = np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """Response to a small addition to the drive, as if it came again and again.

    Parameters
    ----------
    prediction : Prediction
    channels : sequence of str
    drive : (n,) array
    derivatives : bool
    highest : float
        Hz: faster parts of the addition are left out.

    Returns
    -------
    (n, channels) array
    (n, channels, parameters) array
        Derivatives to the parameters, of which there are none unless they are wanted.
    """
    n, wanted = len(drive), len(prediction.parameters) * derivatives
    if not np.any(drive):
        return np.zeros((n, len(channels))), np.zeros((n, len(channels), wanted))
    frequencies = lines(n, prediction.setting.sample_time, highest)
    spectrum = fft.rfft(drive)[: len(frequencies)]
    # The samples lie together in memory, as the frequencies do.
    if not wanted:
        gain = gain_of(prediction, channels, frequencies)
        return np.asarray(fft.irfft(gain.T * spectrum, n)).T, np.zeros((n, len(channels), 0))
    gain, slopes = gain_slopes(prediction, channels, frequencies)
    values = np.asarray(fft.irfft(gain.T * spectrum, n)).T
    return values, np.asarray(fft.irfft(slopes.transpose(1, 2, 0) * spectrum, n)).transpose(2, 0, 1)


def _gain(prediction: Prediction, channels: Sequence[str], frequencies: np.ndarray) -> _Gain:
    """Gain of a prediction, which is asked for by several parts of a fit: the last one is kept with it."""
    key = (tuple(channels), len(frequencies), float(frequencies[-1]), prediction.local.tobytes())
    kept = prediction.__dict__.get("_gain")
    if kept is None or kept[0] != key:
        kept = prediction.__dict__["_gain"] = key, _Gain(prediction, channels, frequencies)
    return kept[1]


class _Gain:
    """States and outputs under a sine of the drive, every element being a straight line of its mean slope."""

    def __init__(self, prediction: Prediction, channels: Sequence[str], frequencies: np.ndarray) -> None:
        m, h = prediction.matrices, prediction.setting.sample_time
        angle = 2 * np.pi * np.maximum(frequencies * h, SLOWEST)
        turn = np.exp(1j * angle)
        cubic = _spline(angle)
        drive = [cubic[0], cubic[1] / h]
        outputs = len(m.O) - len(m.channels)
        self._rows = [outputs + m.channels.index(channel) for channel in channels]
        self._prediction, step = prediction, prediction.step
        self._line = line = _Line.of(step.M, step.H, step.O, self._rows, prediction)
        # Frequencies are the last axis throughout. What multiplies with the drive's part of the equations, (8, f):
        self._driven = np.array([*cubic, *drive, *(turn * part for part in drive)])
        forced = line.driven() @ self._driven
        states, self._left = _solved(line.kept, line.A, turn, forced, line.C)
        self._states = states
        self._drive = np.array(drive)
        self._moving = np.concatenate([states, -turn * states, self._driven])
        self.value = (line.C @ states + line.D @ self._drive).T

    @cached_property
    def slopes(self) -> np.ndarray:
        """Derivatives to the parameters, (f, channels, parameters)."""
        prediction, count = self._prediction, len(self._prediction.parameters)
        if not count:
            return np.zeros((*self.value.shape, 0), complex)
        step, slopes = prediction.step, prediction.slopes
        parts = [
            getattr(step, name) + 1j * SMALL * np.moveaxis(getattr(slopes, name)[:, :, :count], -1, 0)
            for name in ("M", "H", "O")
        ]
        d = _Line(*(np.imag(part) / SMALL for part in _Line.of(parts[0], parts[1], parts[2], self._rows, prediction)))
        inner = np.concatenate(
            [np.broadcast_to(part, (count, *part.shape[-2:])) for part in (d.A, d.kept)] + [d.driven()], axis=-1
        )
        outer = np.concatenate([d.C, d.D], axis=-1)
        found = np.zeros((len(self._rows), count, len(self.value)), complex)
        for parameter, channel, row in _felt(outer, np.vstack([self._states, self._drive])):
            found[channel, parameter] += row
        for parameter, state, row in _felt(inner, self._moving):
            found[:, parameter] += self._left[:, state] * row
        return found.transpose(2, 0, 1)


def _felt(factor: np.ndarray, spectra: np.ndarray) -> Iterator[tuple[int, int, np.ndarray]]:
    """Rows of a real (parameters, rows, n) array that are not zero, times complex spectra (n, f).

    Of many effects at once each is felt by few states.
    """
    parameters, rows = np.nonzero(np.any(factor, axis=2))
    # A real product is half the work of a complex one.
    products = (factor[parameters, rows] @ np.ascontiguousarray(spectra).view(float)).view(complex)
    return zip(parameters.tolist(), rows.tolist(), products, strict=True)


def _solved(kept, A, turn: np.ndarray, forced: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R forced, (n, f), and rows R, (rows, n, f), with R = (turn kept - A)^-1 at all frequencies.

    By the Schur form of kept^-1 A: substitution runs over the few states, each step over all frequencies.
    """
    triangle, unitary = schur(np.linalg.solve(kept, A), output="complex")[:2]
    right = unitary.conj().T @ np.linalg.inv(kept)
    inverse, n = 1.0 / (turn - np.diag(triangle)[:, None]), len(A)
    states = right @ forced
    for k in range(n - 1, -1, -1):
        states[k] += triangle[k, k + 1 :] @ states[k + 1 :]
        states[k] *= inverse[k]
    left = np.repeat((rows @ unitary)[:, :, None], len(turn), axis=2)
    for k in range(n):
        left[:, k] += triangle[:k, k] @ left[:, :k]
        left[:, k] *= inverse[k]
    return unitary @ states, right.T @ left


class _Line(NamedTuple):
    """A step with its elements as straight lines.

    kept z(next) = A z + cubic c + before e + after e(next), outputs = C z + D e, where e is the drive and its rate;
    parameters may be the first axis.
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
        m, (n, w) = prediction.matrices, H.shape[-2:]
        inputs = (O.shape[-2] - len(m.channels)) // 2
        local = np.zeros((w, inputs))
        for j, (first, second) in enumerate(m.places):
            local[j, first] += prediction.local[j, 0]
            local[j, second] += prediction.local[j, 1]
        e = slice(n + w, n + w + 2)
        through = np.linalg.inv(np.eye(w) - local @ O[..., :inputs, n : n + w]) @ local
        P, Q = through @ O[..., :inputs, :n], through @ O[..., :inputs, e]
        Mw, Ow = M[..., n : n + w], O[..., rows, n : n + w]
        return cls(
            np.eye(n) - H @ P, M[..., :n] + Mw @ P, M[..., n + w : n + w + 4], Mw @ Q, H @ Q,
            O[..., rows, :n] + Ow @ P, O[..., rows, e] + Ow @ Q,
        )  # fmt: skip

    def driven(self) -> np.ndarray:
        """What multiplies with the drive: cubic, before and after, (..., n, 8)."""
        return np.concatenate([self.cubic, self.before, self.after], axis=-1)
