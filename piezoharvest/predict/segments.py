"""Propagation through a record by segments of samples or of smaller steps: its state and its steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.predict.record_model import Matrices
from piezoharvest.predict.sample_step import SampleStep

LANES = 8  # derivatives are padded to full vector registers
NO_RISE = -1, np.zeros((0, 2))  # for a drive that depends on no parameter


class Pace(NamedTuple):
    """Matrices for steps of one length.

    Attributes
    ----------
    h : float
        s.
    share : float
        Step as fraction of the record.
    arrays, tangents, places : tuple of array
        M, H and O of the step; their derivatives, and the places of these, as arguments of `propagate_block`.
    limits : (elements, lanes) array
        Derivatives of the elements' limits.
    """

    h: float
    share: float
    arrays: tuple[np.ndarray, ...]
    tangents: tuple[np.ndarray, ...]
    places: tuple[np.ndarray, ...]
    limits: np.ndarray


def pace_of(h: float, share: float, step: SampleStep, slopes: SampleStep) -> Pace:
    """Pace from a step and its derivatives, whose last axis may be empty."""
    names = ("M", "H", "O")
    arrays = tuple(np.ascontiguousarray(getattr(step, name)) for name in names)
    places = tuple(np.ascontiguousarray(np.argwhere(np.any(getattr(slopes, name), axis=1))) for name in names)
    tangents = tuple(
        np.ascontiguousarray(getattr(slopes, name)[at[:, 0], :, at[:, 1]].T)
        for name, at in zip(names, places, strict=True)
    )
    return Pace(h, share, arrays, tangents, places, padded(slopes.limits))


def padded(slopes: np.ndarray) -> np.ndarray:
    """Derivatives (rows, parameters) padded with zeros to whole registers."""
    return np.pad(slopes, ((0, 0), (0, -slopes.shape[1] % LANES)))


class Propagation:
    """Present state of a propagation.

    Parameters
    ----------
    matrices : Matrices
    z : (states,) array
        Initial states.
    dz : (states, lanes) array
        Its derivatives.
    w : (elements,) array
        Initial outputs of the stops.
    dw : (elements, lanes) array
        Their derivatives.
    """

    def __init__(self, matrices: Matrices, z: np.ndarray, dz: np.ndarray, w: np.ndarray, dw: np.ndarray) -> None:
        inputs, elements, lanes = len(matrices.O) - len(matrices.channels), len(matrices.kinds), dz.shape[1]
        self._matrices, self.inputs, self.lanes = matrices, inputs, lanes
        self._limits = np.ascontiguousarray(np.real(matrices.parameters))
        # States, outputs of the elements, their inputs and the rates of these; then the derivatives of all three.
        self._values = (z, w, np.zeros(inputs))
        self._slopes = (dz, dw, np.zeros((inputs, lanes)))
        self._sizes = np.zeros(inputs)
        self.local = np.zeros((elements, 2))  # sum of the elements' slopes with respect to their inputs

    def go(
        self, pace: Pace, coefficients: np.ndarray, time: float, at_start: bool, Y: np.ndarray, dY: np.ndarray,
        *, every: int = 1, rise: tuple[int, np.ndarray] = NO_RISE, small: bool = False,
    ) -> int:  # fmt: skip
        """Propagate further; arguments and result as in `propagate_block`. Small steps do not count in `local`."""
        from piezoharvest.predict.propagate import propagate_block

        local = np.zeros_like(self.local) if small else self.local
        (M, H, O), (dM, dH, dO), (M_at, H_at, O_at) = pace.arrays, pace.tangents, pace.places  # noqa: E741
        (z, w, inputs), (dz, dw, dinputs) = self._values, self._slopes
        return propagate_block(
            coefficients, every, *rise, time, pace.share, at_start, pace.h, M, H, O, self._limits,
            self._matrices.kinds, self._matrices.places, dM, dH, dO, M_at, H_at, O_at, pace.limits,
            z, w, inputs, dz, dw, dinputs, local, self._sizes, Y, dY,
        )  # fmt: skip
