"""Spring that hardens or softens."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class Stiffening(Effect):
    """Spring force k x + k3 x^3; absent at k3 = 0."""

    name: ClassVar[str] = "stiffening"
    source: ClassVar[str] = "Nayfeh & Mook, Nonlinear Oscillations, 1979"
    looks: ClassVar[str] = "the force-displacement curve bends, and the voltage bends like the displacement"
    told_by: ClassVar[str] = (
        "record two force levels: a contact compliance bends the displacement only, and most at small force"
    )
    places: ClassVar[tuple[str, ...]] = ("spring",)

    cubic_stiffness: float = quantity("N/m^3", "cubic stiffness k3", null=0.0)

    def act(self, specimen: EquationBuilder) -> None:
        specimen.push(-self.cubic_stiffness * specimen.power(specimen.x, 3))

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        yield cls(cubic_stiffness=0.0)
