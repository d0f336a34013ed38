"""Constant current into the positive lead."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.circuit import Product
from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EnergyRows, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class BiasCurrent(Effect):
    """A constant current into the positive lead, such as the input bias current of an amplifier; absent at zero."""

    name: ClassVar[str] = "bias_current"
    source: ClassVar[str] = "Horowitz & Hill, The Art of Electronics, 2015, section 4.4"
    looks: ClassVar[str] = (
        "voltage and current have an offset; that of the voltage is proportional to the load resistance"
    )
    told_by: ClassVar[str] = "record with two load resistances: the offset of a sensor does not depend on them"
    places: ClassVar[tuple[str, ...]] = ("electrodes",)

    current: float = quantity("A", "current into the positive lead", null=0.0)

    def act(self, specimen: EquationBuilder) -> None:
        specimen.draw(-self.current * specimen.one)

    def losses(self, terms: EnergyRows) -> Sequence[Product]:
        return [Product(-self.current, terms.v, terms.one)]

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        if scales.loaded:
            yield cls(current=0.0)
