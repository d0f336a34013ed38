"""Leakage resistance across the electrodes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.circuit import Product
from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EnergyRows, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class Leakage(Effect):
    """A resistance across the electrodes, such as a meter's input or moisture; absent when infinite."""

    name: ClassVar[str] = "leakage"
    source: ClassVar[str] = "IEEE Std 176-1987"
    looks: ClassVar[str] = (
        "the voltage decays faster than through the load alone, most with the largest load resistance"
    )
    told_by: ClassVar[str] = "apply a step with open electrodes: the voltage then decays through the leakage alone"
    places: ClassVar[tuple[str, ...]] = ("electrodes",)

    resistance: float = quantity("ohm", "leakage resistance", above=0, null=float("inf"))

    def act(self, specimen: EquationBuilder) -> None:
        specimen.draw(specimen.v / self.resistance)

    def losses(self, terms: EnergyRows) -> Sequence[Product]:
        return [Product(1.0 / self.resistance, terms.v, terms.v)]

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        if scales.loaded:
            yield cls(resistance=1e15)
