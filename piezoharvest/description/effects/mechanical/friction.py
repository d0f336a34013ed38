"""Rate-independent mechanical hysteresis."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.circuit import Product
from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EnergyRows, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class Friction(Effect):
    """Stop operator on the displacement, in parallel with the spring (Jenkins element); absent at zero stiffness."""

    name: ClassVar[str] = "friction"
    source: ClassVar[str] = "Iwan, J. Appl. Mech. 33(4), 893-900, 1966"
    looks: ClassVar[str] = "the force-displacement loop has the same width at every frequency, and contains minor loops"
    told_by: ClassVar[str] = (
        "make a slow record with small reversals at several levels, electrodes shorted: the loop of viscous damping "
        "narrows as the frequency falls, that of friction does not"
    )
    places: ClassVar[tuple[str, ...]] = ("spring",)

    stiffness: float = quantity("N/m", "stiffness while sticking", at_least=0, null=0.0)
    threshold: float = quantity("m", "displacement at which it slips", above=0)

    def act(self, specimen: EquationBuilder) -> None:
        specimen.push(-self.stiffness * specimen.stop(specimen.x, self.threshold))

    def stores(self, terms: EnergyRows) -> Sequence[Product]:
        s, _ = terms.own("stop")
        return [Product(0.5 * self.stiffness, s, s)]

    def losses(self, terms: EnergyRows) -> Sequence[Product]:
        # The stop follows the displacement while it sticks, and dissipates force times velocity while it slips.
        s, ds = terms.own("stop")
        return [Product(self.stiffness, s, terms.u - ds)]

    def shown(self, scales: CampaignSizes) -> bool:
        # With a threshold above twice the amplitude it never slips and is a spring; below the noise it never sticks.
        return scales.jitter < self.threshold < 2.0 * scales.displacement

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        for share in (0.01, 0.03, 0.07, 0.15, 0.3):
            yield cls(stiffness=0.0, threshold=share * scales.displacement)
