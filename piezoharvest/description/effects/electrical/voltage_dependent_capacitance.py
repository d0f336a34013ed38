"""Capacitance that changes with the voltage."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class VoltageDependentCapacitance(Effect):
    """Charge q_c = C v_t (1 + beta v_t^2); absent at beta = 0."""

    name: ClassVar[str] = "voltage_dependent_capacitance"
    source: ClassVar[str] = "Hall, J. Mater. Sci. 36, 4575-4601, 2001"
    looks: ClassVar[str] = (
        "the peaks of the voltage are flattened or sharpened, with a third harmonic that grows with the cube of the "
        "force"
    )
    told_by: ClassVar[str] = (
        "record two force levels at one frequency with a large load resistance: stiffening shows in the displacement "
        "too"
    )
    places: ClassVar[tuple[str, ...]] = ("capacitor",)

    beta: float = quantity("1/V^2", "relative change of the charge, per squared volt", null=0.0)

    def act(self, specimen: EquationBuilder) -> None:
        specimen.charge(specimen.transducer.capacitance * self.beta * specimen.power(specimen.v_t, 3))

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        yield cls(beta=0.0)
