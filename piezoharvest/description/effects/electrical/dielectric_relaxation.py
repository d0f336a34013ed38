"""Slow polarisation of the ceramic."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.circuit import Product
from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EnergyRows, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class DielectricRelaxation(Effect):
    """A series R-C branch in parallel with C, R = time_constant / capacitance; absent at zero capacitance."""

    name: ClassVar[str] = "dielectric_relaxation"
    source: ClassVar[str] = "Debye, Polar Molecules, 1929; Jonscher, Dielectric Relaxation in Solids, 1983"
    looks: ClassVar[str] = (
        "after a step the voltage falls quickly at first and then slowly; the phase of the voltage shifts at low "
        "frequency"
    )
    told_by: ClassVar[str] = (
        "sweep the impedance from 10 mHz upwards: a leakage appears as a slope, a relaxation as a step"
    )
    places: ClassVar[tuple[str, ...]] = ("capacitor", "electrodes")

    capacitance: float = quantity("F", "capacitance of the relaxing branch", above=0, null=0.0)
    time_constant: float = quantity("s", "time constant of the branch", above=0)

    def act(self, specimen: EquationBuilder) -> None:
        charge, rate = specimen.state("relaxation", 1.0 / specimen.transducer.capacitance)
        specimen.equation(self.time_constant * rate + charge - self.capacitance * specimen.v_t)
        specimen.charge(charge)

    def stores(self, terms: EnergyRows) -> Sequence[Product]:
        charge, _ = terms.own("relaxation")
        return [Product(0.5 / self.capacitance, charge, charge)]

    def losses(self, terms: EnergyRows) -> Sequence[Product]:
        _, rate = terms.own("relaxation")
        return [Product(self.time_constant / self.capacitance, rate, rate)]

    def shown(self, scales: CampaignSizes) -> bool:
        return scales.resolves_time(self.time_constant)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        for time_constant in scales.times:
            # Almost zero: at zero there is no branch.
            yield cls(capacitance=1e-6 * scales.capacitance, time_constant=time_constant)
