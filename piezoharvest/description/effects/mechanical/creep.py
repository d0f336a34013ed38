"""Creep of the ceramic."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from piezoharvest.description.circuit import Product
from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EnergyRows, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class Creep(Effect):
    """Kelvin-Voigt element in series with the spring: k (x - y), tau y' = c (x - y) - y; absent at c = 0."""

    name: ClassVar[str] = "creep"
    source: ClassVar[str] = "Ge & Jouaneh, Precis. Eng. 17(3), 211-221, 1995"
    looks: ClassVar[str] = "displacement and charge keep growing under a constant force, and recover slowly"
    told_by: ClassVar[str] = (
        "apply a long step: leakage changes the voltage only, creep changes displacement and charge together"
    )
    places: ClassVar[tuple[str, ...]] = ("spring",)

    compliance_ratio: float = quantity(
        "", "compliance of the element, relative to that of the spring", at_least=0, null=0.0
    )
    time_constant: float = quantity("s", "retardation time", above=0)

    def act(self, specimen: EquationBuilder) -> None:
        # A preload has crept before the record starts.
        y, dy = specimen.state("creep", specimen.transducer.stiffness)
        specimen.equation(self.time_constant * dy + y - self.compliance_ratio * (specimen.x - y))
        specimen.push(specimen.transducer.stiffness * y)

    def stores(self, terms: EnergyRows) -> Sequence[Product]:
        # k (x - y)^2/2 + (k/c) y^2/2, of which k x^2/2 is in the spring already.
        (y, _), k = terms.own("creep"), terms.transducer.stiffness
        return [Product(-k, terms.x, y), Product(0.5 * k, y, y), Product(0.5 * k / self._ratio, y, y)]

    def losses(self, terms: EnergyRows) -> Sequence[Product]:
        _, dy = terms.own("creep")
        return [Product(terms.transducer.stiffness * self.time_constant / self._ratio, dy, dy)]

    @property
    def _ratio(self):
        """The creep ratio; an arbitrary one in designs of a batch without creep, where y is zero."""
        return np.where(np.equal(self.compliance_ratio, 0), 1.0, self.compliance_ratio)

    def shown(self, scales: CampaignSizes) -> bool:
        return scales.resolves_time(self.time_constant)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        for time_constant in scales.times:
            yield cls(compliance_ratio=0.0, time_constant=time_constant)
