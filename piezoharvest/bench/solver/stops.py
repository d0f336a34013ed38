"""Stop operators of the solver: linear between the instants at which they begin to slip or stick."""

from __future__ import annotations

import numpy as np


class Stop:
    """Prandtl-Ishlinskii stop operator of one coordinate, with its present branch.

    Sticking, its output is the coordinate less an origin; slipping, it is the threshold with the sign of the motion.
    Either is exact until the branch changes, so the operator adds no state to the equations.

    Parameters
    ----------
    row : int
        State that is its coordinate: the charge (C), or a displacement (m).
    threshold : float
        In the unit of the coordinate.
    """

    def __init__(self, row: int, threshold: float) -> None:
        self.row, self.threshold = row, threshold
        self.side, self.origin = 0, 0.0

    def relax(self, coordinate: float) -> None:
        """Set the output to zero at this coordinate."""
        self.side, self.origin = 0, coordinate

    @property
    def line(self) -> tuple[float, float]:
        """Slope and level of the output as a function of the coordinate."""
        return (0.0, self.side * self.threshold) if self.side else (1.0, -self.origin)

    def guards(self, coordinate: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray | float, np.ndarray | float]:
        """Two values below zero while the branch holds: distances to the thresholds, or the direction of motion."""
        if self.side:
            return -self.side * rate, -1.0
        output = coordinate - self.origin
        return output - self.threshold, -output - self.threshold

    def fire(self, guard: int, y: np.ndarray) -> None:
        """Change the branch after a guard has crossed zero, at the state `y`."""
        if self.side:
            self.side, self.origin = 0, float(y[self.row]) - self.side * self.threshold
        else:
            self.side = 1 - 2 * guard

    @property
    def branch(self) -> tuple[int, float]:
        """Side (0 while sticking) and origin, for a later reset."""
        return self.side, self.origin

    @branch.setter
    def branch(self, value: tuple[int, float]) -> None:
        self.side, self.origin = value
