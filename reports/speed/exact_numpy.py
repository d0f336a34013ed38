"""Exact stepping in NumPy: matrix exponentials of every mode, tabulated for halved steps, events found by bisection.

What an engineer who knows that the equations are piecewise linear would write. Accuracy is that of the event times:
`depth` halvings of the step.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from reports.speed.equations import Loaded, Mode, Motion, Run

# Rounding of a guard's value, of states of about 1e-2 (square root of an energy in J).
NOISE = 1e-15


class Stepper:
    """Simulation of one model."""

    def __init__(self, model: Loaded, depth: int) -> None:
        self.model, self.depth, self.step = model, depth, model.drive.step
        self.tables: dict[Mode, np.ndarray] = {}

    def run(self, times: np.ndarray) -> np.ndarray:
        """States at ascending times, from rest; a row for each."""
        run, states = self.model.start(), []
        for time in times:
            while run.t < time:
                if run.t >= run.opens:
                    self.model.fire(run, "opens")
                self._advance(run, min(time, run.opens, self.model.drive.after(run.t)))
            states.append(run.z)
        return np.array(states)

    def _table(self, mode: Mode) -> np.ndarray:
        """Exponentials over the step, half of it, a quarter, ..."""
        if mode not in self.tables:
            matrix = self.model.motion(mode).matrix
            self.tables[mode] = np.array([expm(matrix * (self.step * 0.5**k)) for k in range(self.depth + 1)])
        return self.tables[mode]

    def _advance(self, run: Run, limit: float) -> None:
        """One step, shortened to end at `limit` or with the first event."""
        motion, table, n = self.model.motion(run.mode), self._table(run.mode), len(run.z)
        y = self.model.augmented(run)
        above = motion.guards @ y > NOISE  # as after its own event; it has to fall first
        span = min(limit - run.t, self.step)
        end = table[0] @ y if span == self.step else self._through(table, y, span, motion.matrix)
        if not self._risen(motion, end, above).any():
            run.z, run.t = end[:n], limit if span < self.step else run.t + span
            return
        passed = 0.0
        for k in range(1, self.depth + 1):
            trial = table[k] @ y
            if not self._risen(motion, trial, above).any():
                y, passed = trial, passed + self.step * 0.5**k
        y = table[-1] @ y
        run.z, run.t = y[:n], run.t + passed + self.step * 0.5**self.depth
        for event in np.flatnonzero(self._risen(motion, y, above)):  # closer together than the bisection tells apart
            self.model.fire(run, *motion.events[event])

    @staticmethod
    def _risen(motion: Motion, y: np.ndarray, above: np.ndarray) -> np.ndarray:
        return (motion.guards @ y > NOISE) & ~above

    def _through(self, table: np.ndarray, y: np.ndarray, span: float, matrix: np.ndarray) -> np.ndarray:
        """Through a part of the step: its binary digits, and what is left of it to first order."""
        for k in range(1, self.depth + 1):
            if span >= self.step * 0.5**k:
                y, span = table[k] @ y, span - self.step * 0.5**k
        return y + span * (matrix @ y)
