"""Propagation through a record by segments of samples or of smaller steps: its state and its steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.predict.propagation.arguments import Drive, Elements, Memory, Slopes, Sparse, State, Step, Tangent
from piezoharvest.predict.record_model import Matrices
from piezoharvest.predict.sample_step import SampleStep

LANES = 8  # derivatives are padded to full vector registers
NO_RISE = 0, np.zeros((0, 2))  # for a drive that depends on no parameter


class Pace(NamedTuple):
    """Steps of one length.

    Attributes
    ----------
    h, share : float
        s; fraction of the record.
    matrices, derivatives : SampleStep
    inputs : int
        Inputs of the elements and their rates.
    arguments : tuple of Step, Slopes
        The same for `propagate_block`.
    """

    h: float
    share: float
    matrices: SampleStep
    derivatives: SampleStep
    inputs: int
    arguments: tuple[Step, Slopes]

    def begun(self) -> tuple[Step, Slopes]:
        """Step of no length at the first sample of a record, where the states are given and the stops hold."""
        M, slopes = np.zeros_like(self.matrices.M), self.derivatives
        np.fill_diagonal(M, 1.0)
        step = self.matrices._replace(M=M, H=np.zeros_like(self.matrices.H))
        slopes = slopes._replace(M=np.zeros_like(slopes.M), H=np.zeros_like(slopes.H))
        return arranged(self.h, 0.0, True, step, slopes, self.inputs)


def pace_of(h: float, share: float, step: SampleStep, slopes: SampleStep, inputs: int) -> Pace:
    """Pace from a step and its derivatives, whose last axis may be empty."""
    return Pace(h, share, step, slopes, inputs, arranged(h, share, False, step, slopes, inputs))


def arranged(h: float, share: float, held: bool, of: SampleStep, by: SampleStep, inputs: int) -> tuple[Step, Slopes]:
    """Arguments of `propagate_block` for a step and its derivatives."""
    n, m = len(of.M), inputs
    size = n + of.H.shape[1]
    M, H, free, outputs = (np.array(A, order="C") for A in (of.M, of.H, of.O[:m], of.O[m:]))
    to_inputs = of.O[:m, :size].copy()
    to_inputs[:, n:] += of.O[:m, :n] @ H
    free[:, n:size] = 0.0
    dO = tangent(by.O)
    slopes = Slopes(
        tangent(by.M), tangent(by.H), dO, int(np.count_nonzero(dO.places[:, 0] < m)), padded(by.limits),
        sparse(M[:, :size]), sparse(H, n), sparse(to_inputs), sparse(outputs[:, :size]),
    )  # fmt: skip
    return Step(h, share, held, M, H, free, outputs, np.ascontiguousarray(to_inputs[:, n:])), slopes


def tangent(slopes: np.ndarray) -> Tangent:
    """Derivatives of a matrix (rows, columns, parameters) with memory."""
    places = np.argwhere(np.any(slopes, axis=1))
    values = np.ascontiguousarray(slopes[places[:, 0], :, places[:, 1]].T)
    return Tangent(values, np.ascontiguousarray(places), np.zeros(len(places)))


def sparse(A: np.ndarray, first: int = 0) -> Sparse:
    """Nonzero entries of a matrix, whose columns count from the first."""
    columns = np.argsort(A == 0.0, axis=1, kind="stable")
    values = A[np.arange(len(A))[:, None], columns]
    return Sparse(values, columns + first, np.count_nonzero(A, axis=1))


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
        m, n, elements, lanes = len(matrices.O) - len(matrices.channels), len(z), len(w), dz.shape[1]
        self.inputs, self.lanes = m, lanes
        self.local = np.zeros((elements, 2))  # sum of the elements' slopes with respect to their inputs
        self._elements = Elements(matrices.kinds, matrices.places, np.ascontiguousarray(np.real(matrices.parameters)))
        self._state = State(
            np.concatenate([z, w, np.zeros(4)]), np.zeros(m), np.vstack([dz, dw]), np.zeros((m, lanes)), self.local,
            np.zeros(m),
        )  # fmt: skip
        self._memory = Memory(
            np.zeros(n + elements + 6), np.zeros(n), np.zeros((n, lanes)), np.zeros(m), np.zeros(m), np.zeros(elements),
            np.zeros(m), np.zeros((m, 1)), np.zeros(m), np.zeros((elements, 7)), np.zeros((m, m)), np.zeros((m, lanes)),
        )  # fmt: skip

    def go(
        self, pace: Pace, coefficients: np.ndarray, time: float, at_start: bool, Y: np.ndarray, dY: np.ndarray,
        *, every: int = 1, rise: tuple[int, np.ndarray] = NO_RISE, small: bool = False,
    ) -> int:  # fmt: skip
        """Propagate further; arguments and result as in `propagate_block`. Small steps do not count in `local`."""
        from piezoharvest.predict.propagation.propagate import propagate_block

        state = self._state._replace(local=np.zeros_like(self.local))
        if at_start:
            value, rate = coefficients[0, :2]
            drive = Drive(np.array([[value - rate, rate, 0.0, 0.0]]), time, 1, *NO_RISE)
            if propagate_block(drive, *pace.begun(), self._elements, state, self._memory, Y[:1], dY[:1]) >= 0:
                return 0
        drive, state = Drive(coefficients, time, every, *rise), state if small else self._state
        return propagate_block(drive, *pace.arguments, self._elements, state, self._memory, Y[1:], dY[1:])
