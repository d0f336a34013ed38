"""Lag of the displacement sensor."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class DisplacementLag(Effect):
    """First-order lag of the displacement sensor, settled before the record; absent at zero."""

    name: ClassVar[str] = "displacement_lag"
    of_specimen: ClassVar[bool] = False
    source: ClassVar[str] = "Doebelin, Measurement Systems, 2003, section 3.3"
    looks: ClassVar[str] = (
        "the force-displacement loop opens in proportion to the frequency, while the voltage is not affected"
    )
    told_by: ClassVar[str] = (
        "record at higher frequency: a loop due to friction keeps its width, damping shifts the phase of the voltage "
        "too"
    )
    places: ClassVar[tuple[str, ...]] = ("reading.displacement",)

    time_constant: float = quantity("s", "time constant", at_least=0, null=0.0)

    def act(self, specimen: EquationBuilder) -> None:
        specimen.lag(self.time_constant)

    def shown(self, scales: CampaignSizes) -> bool:
        return self.time_constant < scales.longest

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        if "displacement" in scales.channels:
            yield cls(time_constant=0.0)
