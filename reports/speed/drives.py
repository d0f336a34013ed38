"""Drives of the hand-written equations: states (force, partner, 1) with a linear generator, and where they break."""

from __future__ import annotations

import math

import numpy as np


class Sine:
    """Force that is a sine; its partner is the cosine."""

    def __init__(self, table: dict) -> None:
        self.amplitude, self.omega = table["amplitude"], 2 * math.pi * table["frequency"]
        self.generator = np.array([[0, self.omega, 0], [-self.omega, 0, 0], [0, 0, 0]])
        self.step = 1 / (64 * table["frequency"])

    def states(self, t: float) -> np.ndarray:
        """Drive's part of the augmented state."""
        return np.array([self.amplitude * math.sin(self.omega * t), self.amplitude * math.cos(self.omega * t), 1.0])

    def force(self, t: float):
        """Force as a function of time from t on, for as long as it is smooth."""
        amplitude, omega, sin = self.amplitude, self.omega, math.sin
        return lambda time: amplitude * sin(omega * time)

    def after(self, t: float) -> float:
        """Next instant at which the drive is not smooth."""
        return math.inf


class Straight:
    """Samples joined by straight lines (first-order hold); the partner is the slope."""

    generator = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])

    def __init__(self, values: np.ndarray, rate: float) -> None:
        self.values, self.rate, self.step = values, rate, 1 / rate
        self.slopes = np.append(np.diff(values) * rate, 0.0)

    def piece(self, t: float) -> int:
        """Index of the straight piece that begins at or before t; a rounding error before a sample is at it."""
        return min(int(t * self.rate * (1 + 1e-14) + 1e-9), len(self.values) - 1)

    def states(self, t: float) -> np.ndarray:
        """Drive's part of the augmented state."""
        k = self.piece(t)
        return np.array([self.values[k] + self.slopes[k] * (t - k / self.rate), self.slopes[k], 1.0])

    def force(self, t: float):
        """Force as a function of time from t on, for as long as it is smooth."""
        value, slope, _ = self.states(t).tolist()
        return lambda time: value + slope * (time - t)

    def after(self, t: float) -> float:
        """Next instant at which the drive is not smooth."""
        k = self.piece(t) + 1
        return k / self.rate if k < len(self.values) else math.inf
