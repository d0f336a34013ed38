"""The objective of a design as a smooth function of a ladder's values, with its slope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezoharvest.design.bound.port import ElectrodePort, PortValues
from piezoharvest.design.goal import SMALLEST_FIGURE
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.synthesis.ladder import chain_slopes

# The worst peak is smoothed to the p-th root of the sum of p-th powers on a grid: within a factor of points^(1/p).
_POWER, _POINTS = 40.0, 121


@dataclass(frozen=True, eq=False)
class LadderMeasure:
    """Logarithm of one over the power, or of the displacement, of ladders across a transducer.

    Attributes
    ----------
    omega : (f,) array
        rad/s.
    at : PortValues
    squares : (f,) array
        Squared peak values of the drive, with which powers or squared displacements add up.
    damping, peak : bool
        True if the displacement counts, and if of that the worst.
    """

    omega: np.ndarray
    at: PortValues
    squares: np.ndarray
    damping: bool
    peak: bool

    @classmethod
    def of(cls, view: LinearView) -> LadderMeasure:
        """The objective of a design in its operation."""
        op, damping = view.operation, view.goal.damping
        frequencies, squares, peak = op.frequencies, op.squares, False
        if damping and op.band is not None:
            frequencies = np.linspace(*op.band, _POINTS)
            squares, peak = np.full(_POINTS, op.amplitude**2), True
        omega = 2 * np.pi * frequencies
        return cls(omega, ElectrodePort(view).at(omega), squares, damping, peak)

    def value(self, arms: str, logs: np.ndarray, loss: float) -> tuple[float, np.ndarray]:
        """Value of a ladder and its derivatives (n,) by the logarithms (n,) of its arms and of the load."""
        (v, i), (dv, di) = chain_slopes(arms, logs, loss, 1j * self.omega)
        z, total = self.at.impedance, self.at.impedance * i + v
        dtotal = z * di + dv
        if not self.damping:
            # The load takes R/2 |v_oc/total|^2.
            powers = self.squares * np.abs(self.at.voltage / total) ** 2
            share = powers / max(float(np.sum(powers)), SMALLEST_FIGURE)
            slope = 2 * np.real(dtotal / total) @ share
            slope[-1] -= 1
            return -float(logs[-1] + np.log(max(0.5 * np.sum(powers), SMALLEST_FIGURE))), slope
        x = self.at.displacement + self.at.influence * i / total
        dx = self.at.influence * (di * total - i * dtotal) / total**2
        order = _POWER if self.peak else 2.0
        sizes = np.sqrt(self.squares) * np.abs(x)
        largest = max(float(np.max(sizes)), SMALLEST_FIGURE)
        parts = (sizes / largest) ** order
        slope = np.real(dx * np.conj(x)) / np.maximum(np.abs(x) ** 2, SMALLEST_FIGURE**2) @ (parts / np.sum(parts))
        return float(np.log(largest) + np.log(np.sum(parts)) / order), slope
