"""A transducer from material constants and geometry: a plate in its 31 mode."""

from __future__ import annotations

from dataclasses import dataclass

from piezoharvest.description.figures.base import Lumped, StaticFigures
from piezoharvest.description.figures.material import VACUUM_PERMITTIVITY, conversion
from piezoharvest.description.parameters import quantity


@dataclass(frozen=True, kw_only=True)
class Plate(StaticFigures):
    """A plate with electrodes on its faces, pulled along its length, free across (IEEE Std 176-1987).

    k = w t/(s11 l), T = d31 w/s11, C = l w eps33 (1 - k31^2)/t. Displacement is the change of the length.
    """

    d31: float = quantity("C/N", "charge constant d31")
    s11: float = quantity("m^2/N", "compliance s11 at constant field", above=0)
    relative_permittivity: float = quantity("", "relative permittivity at constant stress", above=0)
    length: float = quantity("m", "length of the electrodes along the force", above=0)
    width: float = quantity("m", "width of the electrodes", above=0)
    thickness: float = quantity("m", "thickness between the electrodes", above=0)

    def lumped(self) -> Lumped:
        """Values of the transducer, see `Figures.lumped`."""
        permittivity = self.relative_permittivity * VACUUM_PERMITTIVITY
        k31 = conversion(self.d31, self.s11, permittivity, "d31")
        stiffness = self.width * self.thickness / (self.s11 * self.length)
        coupling = self.d31 * self.width / self.s11
        capacitance = self.length * self.width * permittivity * (1 - k31) / self.thickness
        return self.with_mass(
            stiffness, coupling, capacitance, "field and stress are uniform: far below the plate's own resonances",
            "the plate is free to deform across its length",
        )  # fmt: skip
