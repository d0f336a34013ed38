"""When a switch of the solver acts: at the extrema of sum T_i x_i, with its lag, hold-off and threshold."""

from __future__ import annotations

import math

import numpy as np

# Share of the hold-off by which rounding may bring the next action forward.
ROUNDING = 1e-9


class Switch:
    """When a switch acts: planned actions, the one opening that is due, and the pulses so far.

    Attributes
    ----------
    side : int
        Direction in which sum T_i x_i moves, 0 at rest.
    opening : float
        When the closed switch opens, s; infinite while it is open.
    pulses : list of (float, float)
        When it has closed, and when it opened, s.
    """

    def __init__(self, lag: float, hold_off: float, half_period: float, threshold: float) -> None:
        self.lag, self.hold_off, self.half_period, self.threshold = lag, hold_off, half_period, threshold
        self.side, self.last, self.opening = 0, -math.inf, math.inf
        self.planned: list[tuple[float, int]] = []
        self.pulses: list[tuple[float, float]] = []

    @property
    def due(self) -> float:
        """Next instant at which something happens, s."""
        return min(self.opening, self.planned[0][0] if self.planned else math.inf)

    def guards(self, strain_current: np.ndarray) -> tuple[np.ndarray | float, np.ndarray | float]:
        """Two values below zero until the next extremum, or until the motion begins."""
        if self.side:
            return -self.side * strain_current, 0.0 * strain_current - 1.0
        return strain_current, -strain_current

    def turn(self, guard: int, time: float, voltage: float) -> None:
        """Note that the motion has begun, or an extremum with the electrode voltage at it; plan what follows."""
        if not self.side:
            self.side = 1 - 2 * guard
            return
        kind, self.side = self.side, -self.side
        when = time + self.lag
        if self.lag < 0.0:  # before the coming extremum, of the other kind, half a period from this one
            kind, when = -kind, when + self.half_period
        if abs(voltage) >= self.threshold and when - self.last >= self.hold_off * (1.0 - ROUNDING):
            self.last = when
            self.planned.append((when, kind))
