"""Voltage that falls back after an inversion."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.circuit import Product
from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EnergyRows, EquationBuilder
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.switching import SynchronisedShunt


@dataclass(frozen=True, kw_only=True)
class VoltageReversion(Effect):
    """After a sudden voltage change V, open clamped electrodes fall back by `share` times V; absent at zero share.

    Dielectric loss: a part of the polarisation follows through a resistance, and a fast inversion leaves its charge
    unchanged. A series R-C branch in parallel with C, with a capacitance C_r = C share/(1 - share) that shares its
    charge with C in the time constant R C C_r/(C + C_r). It is a `dielectric_relaxation` expressed by its influence on
    an inversion. It acts behind every circuit, but only behind a switch is it recognised as such.
    """

    name: ClassVar[str] = "voltage_reversion"
    source: ClassVar[str] = "Jonscher, Dielectric Relaxation in Solids, 1983 (a series R-C branch)"
    looks: ClassVar[str] = (
        "right after an inversion the voltage falls back by a fraction of it, then continues as before"
    )
    told_by: ClassVar[str] = (
        "sample the voltage right after an inversion: with a lossy loop it is inverted less from the start and does "
        "not fall back"
    )

    same_law: ClassVar[str] = "dielectric_relaxation"
    places: ClassVar[tuple[str, ...]] = ("capacitor", "electrodes")

    share: float = quantity("", "fraction of a sudden voltage change that is lost", above=0, below=1, null=0.0)
    time_constant: float = quantity("s", "time constant with which it is lost, electrodes open", above=0)

    def act(self, specimen: EquationBuilder) -> None:
        charge, rate = specimen.state("reversion", 1.0 / specimen.transducer.capacitance)
        capacitance = self._capacitance(specimen.transducer.capacitance)
        specimen.equation(self.time_constant / (1.0 - self.share) * rate + charge - capacitance * specimen.v_t)
        specimen.charge(charge)

    def stores(self, terms: EnergyRows) -> Sequence[Product]:
        charge, _ = terms.own("reversion")
        return [Product(0.5 / self._capacitance(terms.transducer.capacitance), charge, charge)]

    def losses(self, terms: EnergyRows) -> Sequence[Product]:
        _, rate = terms.own("reversion")
        resistance = self.time_constant / (self.share * terms.transducer.capacitance)
        return [Product(resistance, rate, rate)]

    def _capacitance(self, clamped: float) -> float:
        """Capacitance of the branch, F."""
        return clamped * self.share / (1.0 - self.share)

    @classmethod
    def acts_on(cls, shunt: Shunt | None) -> bool:
        return isinstance(shunt, SynchronisedShunt)

    def shown(self, scales: CampaignSizes) -> bool:
        return scales.resolves_time(self.time_constant)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        for time_constant in scales.times:
            # Almost zero: at zero there is no branch.
            yield cls(share=1e-6, time_constant=time_constant)
