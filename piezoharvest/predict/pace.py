"""Steps of one length, arranged for the compiled propagation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.predict.propagation.arguments import Slopes, Sparse, Step, Tangent
from piezoharvest.predict.sample_step import SampleStep

LANES = 8  # derivatives are padded to full vector registers


class Pace(NamedTuple):
    """Steps of one length.

    Attributes
    ----------
    h, share : float
        Sample time or the part of it that a step takes (s); the same as fraction of the record.
    step, derivatives : SampleStep
        The matrices and their derivatives, whose last axis may be empty.
    inputs : int
        Inputs of the elements and their rates.
    arguments : tuple of Step, Slopes
        All of it, as `propagate_block` takes it.
    """

    h: float
    share: float
    step: SampleStep
    derivatives: SampleStep
    inputs: int
    arguments: tuple[Step, Slopes]

    def arguments_at_start(self) -> tuple[Step, Slopes]:
        """Step of no length at the first sample of a record, where the states are given and the stops are held."""
        step, slopes = self.step, self.derivatives
        step = step._replace(M=np.eye(*step.M.shape), H=np.zeros_like(step.H))
        slopes = slopes._replace(M=np.zeros_like(slopes.M), H=np.zeros_like(slopes.H))
        return _arranged(step, slopes, self.inputs, self.h, 0.0, True)


def pace_of(h: float, share: float, step: SampleStep, derivatives: SampleStep, inputs: int) -> Pace:
    """Pace from what its attributes of these names are."""
    return Pace(h, share, step, derivatives, inputs, _arranged(step, derivatives, inputs, h, share, False))


def padded(slopes: np.ndarray) -> np.ndarray:
    """Derivatives (rows, parameters) padded with zeros to whole registers."""
    return np.pad(slopes, ((0, 0), (0, -slopes.shape[1] % LANES)))


def _arranged(
    step: SampleStep, derivatives: SampleStep, inputs: int, h: float, share: float, held: bool
) -> tuple[Step, Slopes]:
    """Step and its derivatives in the form that the compiled propagation takes."""
    n = len(step.M)
    size = n + step.H.shape[1]
    M, H, free, outputs = (np.array(A, order="C") for A in (step.M, step.H, step.O[:inputs], step.O[inputs:]))
    to_inputs = free[:, :size].copy()
    to_inputs[:, n:] += to_inputs[:, :n] @ H
    free[:, n:size] = 0.0
    dM, dH, dO = (_tangent(A) for A in (derivatives.M, derivatives.H, derivatives.O))
    slopes = Slopes(
        dM, dH, dO, int(np.count_nonzero(dO.places[:, 0] < inputs)), padded(derivatives.limits),
        _sparse(M[:, :size]), _sparse(H, n), _sparse(to_inputs), _sparse(outputs[:, :size]),
    )  # fmt: skip
    return Step(h, share, held, M, H, free, outputs, np.ascontiguousarray(to_inputs[:, n:])), slopes


def _tangent(derivatives: np.ndarray) -> Tangent:
    """Derivatives of a matrix (rows, columns, parameters)."""
    places = np.ascontiguousarray(np.argwhere(np.any(derivatives, axis=1)))
    values = np.ascontiguousarray(derivatives[places[:, 0], :, places[:, 1]].T)
    return Tangent(values, places, np.zeros(len(places)))


def _sparse(A: np.ndarray, first: int = 0) -> Sparse:
    """Nonzero entries of a matrix, whose columns count from the first."""
    columns = np.argsort(A == 0.0, axis=1, kind="stable")
    values = A[np.arange(len(A))[:, None], columns]
    return Sparse(values, columns + first, np.count_nonzero(A, axis=1))
