"""A march through a record by segments of samples, or of the small steps within one: its state and what paces it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.predict.record_model import Matrices
from piezoharvest.predict.sample_step import SampleStep

LANES = 8  # derivatives are padded to full vector registers
NEVER = -1, np.zeros((0, 2))  # drive that depends on no parameter


class Pace(NamedTuple):
    """What advances by steps of one length.

    Attributes
    ----------
    h : float
        s.
    share : float
        Of the record, that a step takes.
    arrays, tangents, places : tuple of array
        M, H and O of the step; their derivatives, and where these belong, as the march takes them.
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
    """From a step and its derivatives, the last axis of which may be empty."""
    names = ("M", "H", "O")
    arrays = tuple(np.ascontiguousarray(getattr(step, name)) for name in names)
    places = tuple(np.ascontiguousarray(np.argwhere(np.any(getattr(slopes, name), axis=1))) for name in names)
    tangents = tuple(
        np.ascontiguousarray(getattr(slopes, name)[at[:, 0], :, at[:, 1]].T)
        for name, at in zip(names, places, strict=True)
    )
    return Pace(h, share, arrays, tangents, places, padded(slopes.limits))


def padded(slopes: np.ndarray) -> np.ndarray:
    """Derivatives (rows, parameters) with zeros to whole registers."""
    return np.pad(slopes, ((0, 0), (0, -slopes.shape[1] % LANES)))


class Propagation:
    """Where a march has come to.

    Parameters
    ----------
    matrices : Matrices
    z : (states,) array
        At the start.
    dz : (states, lanes) array
        Its derivatives.
    w : (elements,) array
        Outputs of the stops at the start.
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
        self.local = np.zeros((elements, 2))  # sum of the elements' slopes to their inputs

    def go(
        self, pace: Pace, coefficients: np.ndarray, time: float, at_start: bool, Y: np.ndarray, dY: np.ndarray,
        *, every: int = 1, rise: tuple[int, np.ndarray] = NEVER, small: bool = False,
    ) -> int:  # fmt: skip
        """March on; `march` says what the arguments are, and the failed step. Small steps are no samples of `local`."""
        from piezoharvest.predict.propagate import march

        local = np.zeros_like(self.local) if small else self.local
        (M, H, O), (dM, dH, dO), (M_at, H_at, O_at) = pace.arrays, pace.tangents, pace.places  # noqa: E741
        (z, w, inputs), (dz, dw, dinputs) = self._values, self._slopes
        return march(
            coefficients, every, *rise, time, pace.share, at_start, pace.h, M, H, O, self._limits,
            self._matrices.kinds, self._matrices.places, dM, dH, dO, M_at, H_at, O_at, pace.limits,
            z, w, inputs, dz, dw, dinputs, local, self._sizes, Y, dY,
        )  # fmt: skip
