"""Coupling that changes with the strain."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class NonlinearCoupling(Effect):
    """q_t = T x + T2 x^2 and its reciprocal F_t = (T + 2 T2 x) v_t in the first mode; absent at T2 = 0."""

    name: ClassVar[str] = "nonlinear_coupling"
    source: ClassVar[str] = "Maugin, Nonlinear Electromechanical Effects and Applications, 1985"
    looks: ClassVar[str] = (
        "the voltage has a second harmonic and is not proportional to the force, while the displacement is"
    )
    told_by: ClassVar[str] = (
        "record at two preloads: this coupling changes with the preload, a voltage-dependent capacitance does not"
    )
    places: ClassVar[tuple[str, ...]] = ("coupling",)

    quadratic_coupling: float = quantity("C/m^2", "quadratic coupling T2", null=0.0)

    def act(self, specimen: EquationBuilder) -> None:
        specimen.charge(self.quadratic_coupling * specimen.power(specimen.x, 2))
        specimen.push(2.0 * self.quadratic_coupling * specimen.product(specimen.x, specimen.v_t))

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        yield cls(quadratic_coupling=0.0)
