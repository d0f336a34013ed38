"""A transducer from stiffness, capacitance and coupling factor."""

from __future__ import annotations

import math
from dataclasses import dataclass

from piezoharvest.description.figures.base import POSITIVE_COUPLING, Condition, Lumped, StaticFigures, clamped
from piezoharvest.description.parameters import described, quantity


@dataclass(frozen=True, kw_only=True)
class CouplingFactor(StaticFigures):
    """Short-circuit stiffness, capacitance and coupling factor k (k33 of a stack, k31 of a plate, k_eff of a mode).

    k^2 is the share of the energy converted: T^2 = k^2 C_free * stiffness and C = C_free (1 - k^2) (IEEE Std 176-1987).
    """

    coupling_factor: float = quantity("", "coupling factor k", above=0, below=1)
    stiffness: float = quantity("N/m", "stiffness with shorted electrodes", above=0)
    capacitance: float = quantity("F", "capacitance, free or clamped", above=0)
    capacitance_is: Condition = described("whether the capacitance is free or clamped", default="free")

    def lumped(self) -> Lumped:
        """Values of the transducer, see `Figures.lumped`."""
        squared = self.coupling_factor**2 / (1 - self.coupling_factor**2)
        capacitance, assumptions = clamped(self.capacitance, self.capacitance_is, squared)
        coupling = math.sqrt(squared * self.stiffness * capacitance)
        return self.with_mass(self.stiffness, coupling, capacitance, *assumptions, POSITIVE_COUPLING)
