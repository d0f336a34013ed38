"""Joint between specimen and displacement target."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import described, quantity
from piezoharvest.description.protocol import CampaignSizes, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class ContactCompliance(Effect):
    """Hertzian joint: the sensor reads an extra c F^(2/3) under compression (F > 0); absent at c = 0.

    Under tension the joint opens and adds nothing, or, if it is held closed, reduces the reading by as much.
    """

    name: ClassVar[str] = "contact_compliance"
    of_specimen: ClassVar[bool] = False
    source: ClassVar[str] = "Johnson, Contact Mechanics, 1985, section 4.2"
    looks: ClassVar[str] = "extra displacement, steep at small force, that does not appear in the voltage"
    told_by: ClassVar[str] = "use a second displacement sensor on the specimen itself, or record under a larger preload"
    places: ClassVar[tuple[str, ...]] = ("reading.displacement",)

    coefficient: float = quantity("m/N^(2/3)", "coefficient c of the joint", at_least=0, null=0.0)
    tension: Literal["open", "closed"] = described(
        "behaviour under tension: the joint opens, or is held closed", default="open"
    )

    def act(self, specimen: EquationBuilder) -> None:
        if specimen.drive_name != "force":
            return
        force = specimen.drive
        specimen.read(self.coefficient * specimen.power(force, 2.0 / 3.0, positive=True))
        if self.tension == "closed":
            specimen.read(-self.coefficient * specimen.power(-1.0 * force, 2.0 / 3.0, positive=True))

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        if "force" in scales.drives and "displacement" in scales.channels:
            yield cls(coefficient=0.0)
            if scales.has_tension:
                yield cls(coefficient=0.0, tension="closed")
