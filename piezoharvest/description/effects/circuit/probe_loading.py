"""Meter that loads what it measures."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

from piezoharvest.description.circuit import Product
from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import altered, described, quantity
from piezoharvest.description.protocol import CampaignSizes, EnergyRows, EquationBuilder
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.switching import SynchronisedShunt


@dataclass(frozen=True, kw_only=True)
class ProbeLoading(Effect):
    """Resistance and capacitance of a meter across the leads, or across the dc side.

    It is absent at infinite resistance without a capacitance. Across the leads its current bypasses the load. Its
    capacitance, small compared with the clamped one, is in parallel with that, across v_t: the part of its charge that
    the hysteresis would see is neglected. On the dc side it adds to the smoothing capacitor, and the power in its
    resistance is not harvested; it does not affect a constant dc voltage.
    """

    name: ClassVar[str] = "probe_loading"
    source: ClassVar[str] = "Horowitz & Hill, The Art of Electronics, 2015, appendix O"
    looks: ClassVar[str] = (
        "less voltage with the meter connected than without it, mostly with large load resistances and at low frequency"
    )
    told_by: ClassVar[str] = "measure through a buffer, or connect a second meter of the same kind in parallel"

    resistance: float = quantity("ohm", "input resistance of the meter", above=0, null=float("inf"))
    capacitance: float = quantity(
        "F", "input capacitance of the meter and its cable", default=0.0, at_least=0, null=0.0
    )
    place: Literal["leads", "dc"] = described("across the electrodes, or across the dc side", default="leads")

    def act(self, specimen: EquationBuilder) -> None:
        if self.place == "leads":
            specimen.draw(specimen.v / self.resistance)
            specimen.charge(self.capacitance * specimen.v_t)

    def stores(self, terms: EnergyRows) -> Sequence[Product]:
        return [Product(0.5 * self.capacitance, terms.v_t, terms.v_t)] if self.place == "leads" else []

    def losses(self, terms: EnergyRows) -> Sequence[Product]:
        return [Product(1.0 / self.resistance, terms.v, terms.v)] if self.place == "leads" else []

    def connect(self, shunt: Shunt) -> Shunt:
        if self.place == "leads" or not isinstance(shunt, Bridge):
            return shunt
        leakage, smoothing = shunt.dc_leakage + 1.0 / self.resistance, shunt.smoothing_capacitance
        larger = None if smoothing is None else smoothing * (1.0 + self.capacitance / shunt.dc_capacitance)
        return altered(shunt, dc_leakage=leakage, smoothing_capacitance=larger)

    @classmethod
    def acts_on(cls, shunt: Shunt | None) -> bool:
        # Elsewhere it is a `leakage`, with a capacitance that is part of the specimen's.
        return isinstance(shunt, Bridge | SynchronisedShunt)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        yield cls(resistance=1e15)
        if any(isinstance(shunt, Bridge) for shunt in scales.shunts):
            yield cls(resistance=1e15, place="dc")
