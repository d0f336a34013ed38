"""Steps of one length, arranged for the compiled propagation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.predict.propagation.arguments import ElementSlopes, Sparse, StepMatrices, Tangent
from piezoharvest.predict.sample_step import SampleStep

LANES = 8  # derivatives are padded to full vector registers


class Pace(NamedTuple):
    """Steps of one length, as `propagate_block` takes them.

    Attributes
    ----------
    step : StepMatrices
    slopes : ElementSlopes
    direct : (inputs, n + elements) array
        Influence of states and elements' outputs at one instant on the elements' inputs.
    """

    step: StepMatrices
    slopes: ElementSlopes
    direct: np.ndarray

    def at_start(self) -> tuple[StepMatrices, ElementSlopes]:
        """Step of no length at the first sample of a record, where the states are given and the stops are held."""
        n, (M, H) = len(self.step.M), (self.step.M, self.step.H)
        M, H, feed = np.eye(*M.shape), np.zeros_like(H), np.zeros_like(self.step.feed)
        feed[:, : self.direct.shape[1] - n] = self.direct[:, n:]
        none = (Tangent(np.zeros((A.shape[1], 0)), np.zeros((0, 2), int), np.zeros(0)) for A in (M, H))
        return self.step._replace(share=0.0, held=True, M=M, H=H, feed=feed), self.slopes._replace(
            **dict(zip(("M", "H"), none, strict=True)), from_states=_sparse(M[:, : self.direct.shape[1]]),
            from_elements=_sparse(H, n), to_inputs=_sparse(self.direct),
        )  # fmt: skip


def pace_of(h: float, share: float, step: SampleStep, derivatives: SampleStep, inputs: int) -> Pace:
    """Arrange a step and its derivatives.

    Parameters
    ----------
    h, share : float
        s; the same as fraction of the record.
    step, derivatives : SampleStep
        The last axis of the derivatives may be empty.
    inputs : int
        Inputs of the elements and their rates.
    """
    n = len(step.M)
    count = step.H.shape[1] // 3
    size = n + count
    M, H, free, outputs = (np.array(A, order="C") for A in (step.M, step.H, step.O[:inputs], step.O[inputs:]))
    direct = free[:, :size].copy()
    free[:, n:size] = 0.0
    feed = direct[:, :n] @ H
    feed[:, :count] += direct[:, n:]
    dM, dH, dO = (_tangent(A) for A in (derivatives.M, derivatives.H, derivatives.O))
    slopes = ElementSlopes(
        dM, dH, dO, int(np.count_nonzero(dO.places[:, 0] < inputs)), padded(derivatives.limits),
        _sparse(M[:, :size]), _sparse(H, n), _sparse(np.hstack([direct[:, :n], feed])), _sparse(outputs[:, :size]),
    )  # fmt: skip
    return Pace(StepMatrices(h, share, False, M, H, free, outputs, feed), slopes, direct)


def padded(slopes: np.ndarray) -> np.ndarray:
    """Derivatives (rows, parameters) padded with zeros to whole registers."""
    return np.pad(slopes, ((0, 0), (0, -slopes.shape[1] % LANES)))


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
