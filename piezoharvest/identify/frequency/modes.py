"""Modes of a linear system: rank-one residues, a direct term and a common delay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False, kw_only=True)
class Modes:
    """G(s) = exp(-s delay) (sum_k c_k b_k'/(s - p_k) + conjugate + D), with u inputs and y outputs.

    n modes have 2 n states for any number of inputs and outputs.

    Attributes
    ----------
    poles : (n,) array of complex
        rad/s, one of each pair, by frequency.
    outputs : (n, y) array of complex
        c_k; the residues are c_k b_k'.
    inputs : (n, u) array of complex
        b_k, of norm 1.
    direct : (y, u) array
        D: contribution of modes beyond the band.
    delay : float
        s.
    """

    poles: np.ndarray
    outputs: np.ndarray
    inputs: np.ndarray
    direct: np.ndarray
    delay: float

    @property
    def frequencies(self) -> np.ndarray:
        """Natural frequencies in Hz, (n,)."""
        return np.abs(self.poles) / (2 * np.pi)

    @property
    def dampings(self) -> np.ndarray:
        """Damping ratios, (n,)."""
        return -np.real(self.poles) / np.abs(self.poles)

    def response(self, frequency: np.ndarray) -> np.ndarray:
        """Frequency response at frequencies in Hz, (f, y, u) of complex."""
        s = 2j * np.pi * np.asarray(frequency, float)
        total = np.broadcast_to(self.direct.astype(complex), (len(s), *self.direct.shape)).copy()
        terms = (self.poles, self.outputs, self.inputs)
        for pole, c, b in (terms, tuple(term.conj() for term in terms)):
            total += np.einsum("fk,ki,kj->fij", 1 / (s[:, None] - pole), c, b, optimize=True)
        return total * np.exp(-s * self.delay)[:, None, None]

    def periodic(self, inputs: np.ndarray, sample_rate: float) -> np.ndarray:
        """Outputs in the periodic steady state, without their mean; (samples, y, ...).

        Parameters
        ----------
        inputs : (samples, u, ...) array
            One period.
        sample_rate : float
            Hz.
        """
        spectra = np.fft.rfft(inputs, axis=0)
        response = self.response(np.fft.rfftfreq(len(inputs), 1 / sample_rate))
        response[0] = 0.0
        return np.fft.irfft(np.einsum("fij,fj...->fi...", response, spectra), len(inputs), axis=0)

    def statespace(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Real A, B, C, D of 2 n states, without the delay."""
        n = len(self.poles)
        a, b, c = np.zeros((2 * n, 2 * n)), np.empty((2 * n, self.inputs.shape[1])), np.empty((len(self.direct), 2 * n))
        for k, pole in enumerate(self.poles):
            pair = slice(2 * k, 2 * k + 2)
            a[pair, pair] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
            b[pair] = [2 * self.inputs[k].real, -2 * self.inputs[k].imag]
            c[:, pair] = np.column_stack((self.outputs[k].real, self.outputs[k].imag))
        return a, b, c, self.direct


@dataclass(frozen=True, eq=False, kw_only=True)
class ModalFit:
    """Modes fitted to a frequency response.

    Attributes
    ----------
    modes : Modes
    error : float
        Norm of the weighted misfit over that of the weighted response.
    frequencies_std, dampings_std : (n,) array
        White's standard errors from the misfit at each line: noise, distortion and model error.
    """

    modes: Modes
    error: float
    frequencies_std: np.ndarray
    dampings_std: np.ndarray
