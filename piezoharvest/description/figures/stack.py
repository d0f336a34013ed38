"""A transducer from material constants and geometry: a stack in its 33 mode."""

from __future__ import annotations

from dataclasses import dataclass

from piezoharvest.description.figures.base import Lumped, StaticFigures
from piezoharvest.description.figures.material import VACUUM_PERMITTIVITY, stack_values
from piezoharvest.description.parameters import quantity


@dataclass(frozen=True, kw_only=True)
class Stack(StaticFigures):
    """Layers mechanically in series and electrically in parallel, field along the force (IEEE Std 176-1987).

    k = A/(s33 n t), T = d33 A/(s33 t), C = n A eps33 (1 - k33^2)/t.
    """

    d33: float = quantity("C/N", "charge constant d33")
    s33: float = quantity("m^2/N", "compliance s33 at constant field", above=0)
    relative_permittivity: float = quantity("", "relative permittivity at constant stress", above=0)
    area: float = quantity("m^2", "electrode area of a layer", above=0)
    thickness: float = quantity("m", "thickness of a layer", above=0)
    layers: int = quantity("", "number of layers", default=1, at_least=1)

    def lumped(self) -> Lumped:
        """Values of the transducer, see `Figures.lumped`."""
        values = stack_values(
            self.d33, self.s33, self.relative_permittivity * VACUUM_PERMITTIVITY,
            area=self.area, thickness=self.thickness, layers=self.layers, key="d33",
        )  # fmt: skip
        return self.with_mass(
            *values, "field and stress are uniform: far below the stack's own resonances",
            "glue, electrodes and inactive ends are neglected",
        )  # fmt: skip
