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
        n, M, (m, size) = len(self.step.M), self.step.M, self.direct.shape
        M, H, feed = np.eye(*M.shape), np.zeros_like(self.step.H), np.zeros_like(self.step.feed)
        feed[:m, : size - n] = self.direct[:, n:]
        # Nothing is added to the coefficients of an input, as there is no course.
        inputs, to_inputs = self.step.inputs.copy(), np.zeros((len(feed), size))
        inputs[m:], to_inputs[:m] = 0.0, self.direct
        step = StepMatrices(self.step.h, 0.0, True, M, H, inputs, self.step.outputs, feed, *_coupled(feed))
        return step, self.slopes._replace(
            M=_no_tangent(M.shape[1]), H=_no_tangent(H.shape[1]), added=_no_tangent(size - n),
            from_states=_sparse(M[:, :size]), from_elements=_sparse(H, n), to_inputs=_sparse(to_inputs),
            before_added=_sparse(np.zeros((len(feed) - m, size - n)), n),
        )  # fmt: skip


def pace_of(
    h: float, share: float, step: SampleStep, derivatives: SampleStep, inputs: int, reached: np.ndarray,
    influential: np.ndarray,
) -> Pace:  # fmt: skip
    """Arrange a step and its derivatives.

    Parameters
    ----------
    h, share : float
        s; the same as fraction of the record.
    step, derivatives : SampleStep
        The last axis of the derivatives may be empty.
    inputs : int
        Inputs of the elements and their rates.
    reached : (inputs / 2,) array of bool
        Inputs that outputs of elements reach directly.
    influential : (n,) array of bool
        States whose derivatives are propagated.
    """
    n = len(step.M)
    count = step.H.shape[1] // 3
    size = n + count
    M, H, free, outputs = (np.array(A, order="C") for A in (step.M, step.H, step.O[:inputs], step.O[inputs:]))
    direct = free[:, :size].copy()
    free[:, n:size] = 0.0
    feed = direct[:, :n] @ H
    feed[:, :count] += direct[:, n:]
    # An output is a cubic, of which w1 - w0 + p and r - p - 3 (w1 - w0) are added to the coefficients of s and s^2, and
    # the opposite of their sum to that of s^3.
    S = direct[np.flatnonzero(reached), n:]
    before = np.vstack([-S, 3.0 * S])
    free = np.vstack([free, _within(len(before), free.shape[1], before, n)])
    feed = np.vstack([feed, np.hstack([S, S, 0.0 * S]), np.hstack([-3.0 * S, -S, S])])
    to_inputs = np.hstack([_within(len(feed), n, direct[:, :n]), feed])
    dM, dH = (_tangent(A * influential[:, None, None]) for A in (derivatives.M, derivatives.H))
    dO, moved, bent = _tangent(derivatives.O), M[:, :size] * influential[:, None], H * influential[:, None]
    slopes = ElementSlopes(
        dM, dH, dO, int(np.count_nonzero(dO.places[:, 0] < inputs)), padded(derivatives.limits),
        _sparse(moved), _sparse(bent, n), _sparse(to_inputs), _sparse(outputs[:, :size]),
        _tangent(derivatives.O[np.flatnonzero(reached), n:size]), _sparse(before, n),
    )  # fmt: skip
    return Pace(StepMatrices(h, share, False, M, H, free, outputs, feed, *_coupled(feed)), slopes, direct)


def _coupled(feed: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`implicit`, `explicit` and `feeds` of `StepMatrices`."""
    fed = feed != 0.0
    reached = np.any(fed, axis=1)
    return np.flatnonzero(reached), np.flatnonzero(~reached), np.any(fed.any(axis=0).reshape(3, -1), axis=0)


def padded(slopes: np.ndarray) -> np.ndarray:
    """Derivatives (rows, parameters) padded with zeros to whole registers."""
    rows, count = slopes.shape
    return _within(rows, count + -count % LANES, slopes)


def _within(rows: int, columns: int, part: np.ndarray, first: int = 0) -> np.ndarray:
    """Matrix of zeros but for a part of its first rows, from a column on; `np.pad` would take ten times as long."""
    found = np.zeros((rows, columns))
    found[: len(part), first : first + part.shape[1]] = part
    return found


def _no_tangent(columns: int) -> Tangent:
    """Tangent of a matrix that depends on no parameter."""
    return Tangent(np.zeros((columns, 0)), np.zeros((0, 2), int), np.zeros(0))


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
