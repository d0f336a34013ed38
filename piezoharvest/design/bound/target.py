"""Figure that is bounded: harvested power, the worst displacement in a band, or its mean square."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from piezoharvest.design.bound.density import trapezoid_weights
from piezoharvest.design.bound.port import PortValues

Kind = Literal["power", "peak", "mean_square"]


@dataclass(frozen=True)
class Target:
    """Figure of a loop admittance Q over a band.

    Attributes
    ----------
    kind : "power", "peak" or "mean_square"
        Harvested power in W, largest displacement amplitude in m, or the root of the mean square in m, that of a sine
        with this amplitude.
    band : pair of float
        rad/s.
    density : float
        Squared peak value of the drive for each rad/s; for "peak" the squared amplitude itself.
    """

    kind: Kind
    band: tuple[float, float]
    density: float

    def inside(self, omega: np.ndarray) -> np.ndarray:
        """True (f,) in the band."""
        return (omega >= self.band[0]) & (omega <= self.band[1])

    def weights(self, omega: np.ndarray) -> np.ndarray:
        """Weights (f,) of an integral over the band; its edges are among the points."""
        inside = self.inside(omega)
        found = np.zeros(len(omega))
        found[inside] = trapezoid_weights(omega[inside])
        return found

    def available(self, at: PortValues) -> np.ndarray:
        """Density (f,) of the power into the matched load, |v|^2/(8 Re Z), W s/rad."""
        return self.density * np.abs(at.voltage) ** 2 / (8 * at.resistance)

    def frequency_wise(self, omega: np.ndarray, at: PortValues) -> float:
        """Figure if every frequency had a passive shunt of its own."""
        if self.kind == "power":
            return float(self.weights(omega) @ self.available(at))
        return self._size(omega, least_displacement(at))

    def value(self, omega: np.ndarray, at: PortValues, admittance: np.ndarray) -> float:
        """Figure of an admittance (f,)."""
        if self.kind == "power":
            gained = np.real(admittance) - at.resistance * np.abs(admittance) ** 2
            return float(self.weights(omega) @ (0.5 * self.density * np.abs(at.voltage) ** 2 * gained))
        return self._size(omega, np.abs(at.displacement + at.influence * admittance))

    def _size(self, omega: np.ndarray, displacement: np.ndarray) -> float:
        if self.kind == "peak":
            return float(np.sqrt(self.density) * np.max(displacement[self.inside(omega)]))
        return float(np.sqrt(self.weights(omega) @ (self.density * displacement**2)))


def least_displacement(at: PortValues) -> np.ndarray:
    """Least displacement (f,) with a passive shunt at each frequency alone, m.

    The admittance of the loop lies in a disc through zero, of centre and radius 1/(2 Re Z).
    """
    reach = at.influence / (2 * at.resistance)
    return np.maximum(np.abs(at.displacement + reach) - np.abs(reach), 0.0)
