"""Diodes that drop another voltage than their label says."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Protocol, Self, runtime_checkable

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import AS_LABELLED, altered, quantity
from piezoharvest.description.protocol import CampaignSizes
from piezoharvest.description.shunts.base import Shunt


@runtime_checkable
class WithDiodes(Protocol):
    """Any circuit whose label says what its diodes drop: in a bridge, before a coil, in a breaker."""

    diode_drop: float


@dataclass(frozen=True, kw_only=True)
class DiodeDropError(Effect):
    """Every diode has the forward drop `diode_drop` instead of its nominal one; absent where the two are equal."""

    name: ClassVar[str] = "diode_drop_error"
    source: ClassVar[str] = "Sze & Ng, Physics of Semiconductor Devices, 2007, section 2.3"
    looks: ClassVar[str] = (
        "while the bridge conducts, the voltage exceeds the dc voltage by a constant, whatever the amplitude"
    )
    told_by: ClassVar[str] = "record the dc voltage as well as the electrode voltage, or measure at two amplitudes"
    places: ClassVar[tuple[str, ...]] = ("diode",)

    diode_drop: float = quantity("V", "forward drop of one diode", at_least=0, null=AS_LABELLED)

    def connect(self, shunt: Shunt) -> Shunt:
        return altered(shunt, diode_drop=self.diode_drop) if isinstance(shunt, WithDiodes) else shunt

    @classmethod
    def acts_on(cls, shunt: Shunt | None) -> bool:
        return isinstance(shunt, WithDiodes)

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        for drop in dict.fromkeys(s.diode_drop for s in scales.shunts if isinstance(s, WithDiodes)):
            yield cls(diode_drop=drop)
