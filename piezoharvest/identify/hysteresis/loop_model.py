"""Model of a loop for the fit: prediction, derivatives, and the convex fit of offset, slope and weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezoharvest.identify.hysteresis.loop_fit import Kind
from piezoharvest.identify.hysteresis.play_operators import initial_states, plays

MAX_THRESHOLD = 0.999  # of half the input range: thresholds above have no effect


@dataclass(frozen=True, eq=False)
class LoopData:
    """A record of a loop, with the type and the initial state of its operators.

    Attributes
    ----------
    signal, output : (samples,) array
    kind : "stop" or "play"
    virgin : bool
        True if the operators begin from 0; else their initial states are unknown.
    """

    signal: np.ndarray
    output: np.ndarray
    kind: Kind
    virgin: bool

    @property
    def excited(self) -> float:
        """Half the range of the input."""
        return 0.5 * float(np.ptp(self.signal))


@dataclass(frozen=True, eq=False)
class LoopShape:
    """Nonlinear parameters of an operator.

    Attributes
    ----------
    thresholds : (n,) array
    turns : (n,) array
        Initial states as in `play_operators.initial_states`; empty if the record is from the virgin state.
    """

    thresholds: np.ndarray
    turns: np.ndarray

    def states(self, data: LoopData) -> np.ndarray:
        """Initial states, (n,)."""
        if data.virgin:
            return np.zeros(len(self.thresholds))
        return initial_states(data.signal[0], self.thresholds, self.turns)[0]

    def design(self, data: LoopData) -> np.ndarray:
        """Columns of offset, slope and weights, (samples, 2 + n)."""
        outputs = plays(data.signal, self.thresholds, self.states(data)).outputs
        operators = outputs if data.kind == "play" else data.signal[:, None] - outputs
        return np.column_stack((np.ones(len(outputs)), data.signal, operators))

    def derivatives(self, data: LoopData, weights: np.ndarray) -> np.ndarray:
        """Derivatives of the prediction by thresholds and turns, (samples, 2 n); by thresholds only if `virgin`."""
        found = plays(data.signal, self.thresholds, self.states(data))
        signed = weights if data.kind == "play" else -weights
        if data.virgin:
            return found.slopes * signed
        _, by_turns, by_thresholds = initial_states(data.signal[0], self.thresholds, self.turns)
        kept = found.kept * signed
        return np.hstack((found.slopes * signed + kept @ by_thresholds, kept @ by_turns))


def convex_fit(design: np.ndarray, output: np.ndarray, free: int = 1) -> np.ndarray:
    """Least squares with all unknowns except the first `free` at least 0, solved as a convex problem.

    Parameters
    ----------
    design : (samples, n) array
    output : (samples,) array
    free : int
        Leading columns whose unknowns may have any sign.

    Returns
    -------
    (n,) array
    """
    import cvxpy

    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0] = 1.0
    size = float(np.linalg.norm(output)) or 1.0
    # The triangular factor has all information of the samples, and keeps the problem small.
    factor = np.asarray(np.linalg.qr(np.column_stack((design / scale, output / size)), mode="r"))
    matrix, right = factor[:, :-1], factor[:, -1]
    x = cvxpy.Variable(design.shape[1])
    misfit = cvxpy.sum_squares(matrix @ x - right)
    cvxpy.Problem(cvxpy.Minimize(misfit), [x[free:] >= 0]).solve(solver=cvxpy.CLARABEL)
    return _on_bounds(matrix, right, np.asarray(x.value), free) * size / scale


def _on_bounds(matrix: np.ndarray, right: np.ndarray, near: np.ndarray, free: int) -> np.ndarray:
    """Exact solution, on some of the bounds, near that of an interior-point method, by a few pivoting steps.

    It ends when the Karush-Kuhn-Tucker conditions hold: no value below its bound, and no gradient away from it.
    """
    bounded = np.arange(len(near)) >= free
    active = ~bounded | (near > 1e-7 * np.abs(near).max())
    for _ in range(3 * len(near)):
        solution = np.zeros(len(near))
        solution[active] = np.linalg.lstsq(matrix[:, active], right)[0]
        below = bounded & (solution < 0)
        if below.any():
            active[np.argmin(np.where(bounded, solution, np.inf))] = False
            continue
        gradient = np.where(active, -np.inf, matrix.T @ (right - matrix @ solution))
        if gradient.max() < 1e-12:
            return solution
        active[np.argmax(gradient)] = True
    return np.where(bounded, np.maximum(near, 0.0), near)
