"""Propagation through a record by segments of samples or of smaller steps: its state."""

from __future__ import annotations

import numpy as np

from piezoharvest.predict.pace import Pace
from piezoharvest.predict.propagation.arguments import SLOPES, Elements, PropagatedState, StepDrive, StepMemory
from piezoharvest.predict.propagation.within_step import VARIABLES
from piezoharvest.predict.record_model import Matrices

NO_RISE = 0, np.zeros((0, 2))  # for a drive that depends on no parameter


class Propagation:
    """Present state of a propagation.

    Parameters
    ----------
    matrices : Matrices
    acts : (elements,) array of bool
        As in `Elements`.
    reached : (distinct inputs,) array of bool
        Inputs that outputs of elements reach directly.
    z : (states,) array
        Initial states.
    dz : (states, lanes) array
        Its derivatives.
    w : (elements,) array
        Initial outputs of the stops.
    dw : (elements, lanes) array
        Their derivatives.
    """

    def __init__(
        self, matrices: Matrices, acts: np.ndarray, reached: np.ndarray, z: np.ndarray, dz: np.ndarray, w: np.ndarray,
        dw: np.ndarray,
    ) -> None:  # fmt: skip
        self.inputs, self.lanes, self.reached = len(matrices.O) - len(matrices.channels), dz.shape[1], reached
        n, elements, lanes = len(z), len(w), self.lanes
        more = int(np.count_nonzero(reached))
        m = self.inputs + 2 * more
        self.local = np.zeros((elements, 2))  # sum of the elements' slopes with respect to their inputs
        limits = np.real(matrices.parameters).astype(float)  # whole exponents, too: another type compiles all anew
        added = np.where(reached, self.inputs + np.cumsum(reached) - 1, -1)
        self._elements = Elements(matrices.kinds, matrices.places, limits, acts, matrices.rated, added, more)
        self._state = PropagatedState(
            y=np.concatenate([z, w, np.zeros(4)]), inputs=np.zeros(m),
            d=np.vstack([dz, dw, np.zeros((2 * elements, lanes))]),
            dinputs=np.zeros((m, lanes)), local=self.local, sizes=np.zeros(m),
        )  # fmt: skip
        self._memory = StepMemory(
            g=np.zeros(n + elements + 6), z=np.zeros(n), dz=np.zeros((n, lanes)),
            base=np.zeros(m), old=np.zeros(m), before=np.zeros(elements),
            trial=np.zeros(m), residual=np.zeros((m, 1)), move=np.zeros(m),
            outputs=np.zeros(3 * elements), slopes=np.zeros((3, elements, SLOPES)), off=np.zeros(elements, bool),
            rises=np.zeros((2, elements)),
            first=np.zeros(4), second=np.zeros(4), inside=np.zeros((3, SLOPES + 1)),
            by_base=np.zeros(VARIABLES), moments=np.zeros((2, VARIABLES + 1)), corners=np.zeros((3, VARIABLES + 1)),
            J=np.zeros((m, m + 1)), right=np.zeros((m, lanes)),
        )  # fmt: skip

    def go(
        self, pace: Pace, coefficients: np.ndarray, time: float, at_start: bool, Y: np.ndarray, dY: np.ndarray,
        *, every: int = 1, rise: tuple[int, np.ndarray] = NO_RISE, small: bool = False,
    ) -> int:  # fmt: skip
        """Propagate further.

        Parameters
        ----------
        pace : Pace
        coefficients, time, every, rise
            `coefficients`, `begin`, `every`, and `lane` with `rise` of `StepDrive`.
        at_start : bool
            The record begins here: its first sample is written, too.
        Y : (samples + 1, outputs) array
        dY : (samples + 1, outputs, lanes) array
            Both outputs; first the sample from which the steps begin.
        small : bool
            Steps do not count in `local`.

        Returns
        -------
        int
            As of `propagate_block`.
        """
        from piezoharvest.predict.propagation.propagate import propagate_block

        aside = self._state._replace(local=np.zeros_like(self.local))
        if at_start:
            # A straight line that ends where the record begins, with the rate there.
            value, rate = coefficients[0, :2]
            first = StepDrive(np.array([[value - rate, rate, 0.0, 0.0]]), time, 1, *NO_RISE)
            if propagate_block(first, *pace.at_start(), self._elements, aside, self._memory, Y[:1], dY[:1]) >= 0:
                return 0
        drive, state = StepDrive(coefficients, time, every, *rise), aside if small else self._state
        return propagate_block(drive, pace.step, pace.slopes, self._elements, state, self._memory, Y[1:], dY[1:])
