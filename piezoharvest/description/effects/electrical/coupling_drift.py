"""Coupling that changes slowly during a record."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity
from piezoharvest.description.protocol import CampaignSizes, EquationBuilder


@dataclass(frozen=True, kw_only=True)
class CouplingDrift(Effect):
    """T (1 + d t/duration): over each record the coupling changes by the fraction d; absent at d = 0."""

    name: ClassVar[str] = "coupling_drift"
    source: ClassVar[str] = "Zhang, Lim, Lee & Bae, J. Appl. Phys. 119, 034101, 2016"
    looks: ClassVar[str] = (
        "the amplitudes of voltage and current drift over every record while those of displacement and force stay "
        "constant"
    )
    told_by: ClassVar[str] = (
        "make a long record at constant amplitude: a leakage or a load error does not change with time"
    )
    places: ClassVar[tuple[str, ...]] = ("parameter.coupling",)

    relative_drift: float = quantity("", "relative change over a record", above=-1, null=0.0)

    def act(self, specimen: EquationBuilder) -> None:
        for n, mode in enumerate(specimen.transducer.all_modes):
            specimen.push(self.relative_drift * mode.coupling * specimen.product(specimen.time, specimen.v_t), n)
        specimen.charge(self.relative_drift * specimen.product(specimen.time, specimen.strain_charge))

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        yield cls(relative_drift=0.0)
