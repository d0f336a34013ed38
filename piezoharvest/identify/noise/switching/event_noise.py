"""Noise that the noise of the drive, or of a recorded gate, adds where a circuit switches: earlier or later.

A voltage inverted within a few samples changes by far more in a shift of a thousandth of a sample than its sensor's
noise. Such samples count for as much as they are known. Errors that a whole record has in common, as where the
amplitude and the phase of its drive are known to a part, are removed in whitening (`common_errors`). The others depend
on each other, too: behind a rectifier, the noise of a drive about a resonance is a slow error of the dc voltage. Their
spectra are a part of the noise that residuals are whitened for; standard errors have to know the rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from piezoharvest.identify.noise.noise_gain import small_response
from piezoharvest.identify.noise.noisy_drives import noisy_drives
from piezoharvest.identify.noise.spectra import line_spectra
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction, loose_edges
from piezoharvest.predict.circuit.setting import redriven
from piezoharvest.predict.discrete_model import Setting
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.record import Signal

# Realisations of the drive's noise. A weight needs a variance to a factor of two. The variance of a parameter follows
# from 32 to a quarter, its standard error to an eighth; of longer records fewer are kept, so that they fit into memory.
FOR_WEIGHTS, FOR_ERRORS = 4, 32
# A jump beside a sample may fall on the other side of it, which is rare, but an error of a thousand times the noise:
# realisations with so many times the noise find samples within some standard deviations of a jump.
WIDE, WIDENED = 16, 4.0
MAX_VALUES = 1 << 26
# Common errors: larger, over the whole record, than the noise of a sample, and twice what each realisation would have
# if they had nothing in common. Others, of a drive with many frequencies, are in the spectra.
MIN_COMMON, MIN_COMMON_RATIO = 1.0, 2.0
# Lines of a spectrum that are averaged: with the realisations for weights, 17 % of each of its values are chance.
AVERAGED_LINES = 9


class _Simulated(NamedTuple):
    """Weights (samples, channels), common errors (n, samples, channels), and weighted realisations of the rest."""

    weights: np.ndarray
    common: np.ndarray
    rest: np.ndarray


class EventNoise:
    """What is not known of a record's responses because its switch may have acted earlier or later, by simulation.

    Noise is added to the drive and removed again as from a measured one, and the edges of a gate are put elsewhere
    within their samples. What the prediction then changes by, beyond the linear response that whitening allows for, is
    not known.

    Parameters
    ----------
    prediction : CircuitPrediction
        Without parameters.
    channels : sequence of str
    signal : Signal
        The measured drive.
    drive : (samples,) array
        The same without noise.
    sigma : mapping of str to float
        Standard deviations of the channels' noise.
    noise : float
        That of the drive.

    Attributes
    ----------
    known : bool
        True if neither the drive nor a gate leaves anything open: all weights are one, and nothing is simulated.
    """

    def __init__(
        self, prediction: CircuitPrediction, channels: Sequence[str], signal: Signal, drive: np.ndarray,
        sigma: Mapping[str, float], noise: float,
    ) -> None:  # fmt: skip
        self._prediction, self._channels, self._signal = prediction, channels, signal
        self._drive, self._noise = drive, noise
        self._own = np.array([sigma[channel] for channel in channels])
        self.known = noise == 0.0 and not _is_loose(prediction.setting)

    @cached_property
    def _simulated(self) -> _Simulated:
        """What follows from realisations, which are let go: those of a record of millions of samples take gigabytes."""
        shape = len(self._drive), len(self._channels)
        if self.known:
            return _Simulated(np.ones(shape), np.zeros((0, *shape)), np.zeros((1, *shape), np.float32))
        first, common = self._errors(FOR_WEIGHTS), np.zeros((0, *shape))
        variance = np.mean(first**2, axis=0)
        if self._noise > 0.0:
            wide = self._errors(WIDE, WIDENED, series=1) / WIDENED
            variance = np.maximum(variance, np.mean(wide**2, axis=0))
            common = _in_common(wide, 1.0 / np.sqrt(self._own**2 + variance))
        weights = self._own / np.sqrt(self._own**2 + variance)
        return _Simulated(weights, common, self._without(common, first * weights, weights).astype(np.float32))

    @property
    def weights(self) -> np.ndarray:
        """Weights (samples, channels) of residuals: the sensors' noise over all that is not known there."""
        return self._simulated.weights

    @property
    def common(self) -> np.ndarray:
        """Errors (n, samples, channels) that all samples have in common, each of the size of a standard deviation."""
        return self._simulated.common

    def spectra(self, count: int) -> np.ndarray:
        """Cross-spectra (f, channels, channels) of the weighted errors of `count` samples, in units of white noise."""
        lines = np.fft.rfft(self._simulated.rest[:, :count], axis=1) / np.sqrt(count)
        found = np.einsum("nfa,nfb->fab", lines, np.conj(lines)) / len(lines)
        return uniform_filter1d(found, AVERAGED_LINES, axis=0, mode="nearest")

    def covariance(self, count: int) -> np.ndarray:
        """What `count` samples add to the covariance of the channels' own noise, (f, channels, channels)."""
        lowered = np.mean(1.0 - self.weights**2, axis=0) * self._own**2  # of their noise, by the weights
        return self.spectra(count) - np.diag(lowered)

    @cached_property
    def _base(self) -> np.ndarray:
        """Responses (samples, channels) to the drive without noise."""
        return _values(self._prediction, self._channels)

    @cached_property
    def _weighted_errors(self) -> np.ndarray:
        """Realisations (n, samples, channels) of the errors but the common ones, each with the weight of its sample."""
        count = MAX_VALUES // (len(self._drive) * len(self._channels))
        errors = self._errors(min(max(count, FOR_WEIGHTS), FOR_ERRORS))
        errors *= self.weights
        return self._without(self.common, errors, self.weights).astype(np.float32)

    def _without(self, common: np.ndarray, weighted: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Weighted realisations (n, samples, channels) without the common errors, in place."""
        for shape in common * weights:
            unit = shape / self._own / np.linalg.norm(shape / self._own)
            weighted -= np.tensordot(weighted / self._own, unit, 2)[:, None, None] * (unit * self._own)
        return weighted

    def spread(self, begin: int, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What the errors do to the gradient: its realisations, and the part of its covariance that is counted already.

        Parameters
        ----------
        begin : int
            First of some samples.
        slopes : (channels, samples, p) array
            Changes of the gradient with the errors of the samples.

        Returns
        -------
        realisations : (p, n) array
            Over the square root of `n`, so that their products sum to the covariance.
        counted : (p, p) array
            Covariance if the errors had no more in common than their spectra, as the information has them.
        """
        part, p = slice(begin, begin + slopes.shape[1]), slopes.shape[2]
        if self.known:
            return np.zeros((p, 0)), np.zeros((p, p))
        errors = self._weighted_errors[:, part]
        found = np.einsum("nsc,csp->pn", errors, slopes, optimize=True) / np.sqrt(max(len(errors), 1))
        lines = line_spectra(slopes.transpose(0, 2, 1))  # (channels, p, f)
        return found, np.real(np.einsum("apf,fab,bqf->pq", np.conj(lines), self.spectra(slopes.shape[1]), lines))

    def _errors(self, count: int, times: float = 1.0, series: int = 0) -> np.ndarray:
        """Realisations (n, samples, channels) of the errors by some times the noise of the drive.

        Those of another series are independent: what one has in common is no more of the other than of any noise.
        Those that cannot be followed are left out.
        """
        prediction, channels, found = self._prediction, self._channels, []
        drives: Iterable[np.ndarray] = [self._drive] * count
        if self._noise > 0.0:
            drives = noisy_drives(self._signal, self._drive, times * self._noise, count, series)
        for seed, noisy in enumerate(drives):
            again = prediction.with_drive(_retimed(redriven(prediction.setting, noisy), seed))
            try:
                linear = small_response(prediction, channels, noisy - self._drive)
                found.append(_values(again, channels) - self._base - linear)
            except PredictionError:
                continue
        return np.array(found or [np.zeros_like(self._base)])


def _in_common(errors: np.ndarray, units: np.ndarray) -> np.ndarray:
    """What realisations (n, samples, channels) of errors have in common, by their sizes in some units."""
    flat = (errors * units).reshape(len(errors), -1)
    mixed, squares, _ = np.linalg.svd(flat @ flat.T / len(errors), hermitian=True)
    kept = int(np.sum(squares > max(MIN_COMMON, MIN_COMMON_RATIO * squares.mean())))
    return np.tensordot(mixed[:, :kept].T / np.sqrt(len(errors)), errors, 1)


def _retimed(setting: Setting, seed: int) -> Setting:
    """Setting with the edges of its gate elsewhere within their samples, unless their places are fitted."""
    gate = setting.gate
    if gate is None or not _is_loose(setting):
        return setting
    off = np.random.default_rng([len(gate.times), seed]).uniform(-gate.error, gate.error, len(gate.times))
    return replace(setting, gate=gate._replace(times=gate.times + off))


def _is_loose(setting: Setting) -> bool:
    """True if edges of a gate are somewhere within their samples, and too many to be fitted."""
    return setting.gate is not None and setting.gate.error > 0.0 and not loose_edges(setting)


def _values(prediction: CircuitPrediction, channels: Sequence[str]) -> np.ndarray:
    return np.concatenate([block.values for block in prediction.blocks(derivatives=False, channels=channels)])
