"""Load that is not what its label says."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import altered, quantity
from piezoharvest.description.protocol import CampaignSizes
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.linear.resistor import Resistor


@dataclass(frozen=True, kw_only=True)
class LoadError(Effect):
    """The load resistor is R (1 + e): all of them, or those of nominal value `resistance`; absent at e = 0."""

    name: ClassVar[str] = "load_error"
    of_specimen: ClassVar[bool] = False
    source: ClassVar[str] = "IEC 60062"
    looks: ClassVar[str] = (
        "the ratio of voltage to current differs from the nominal load, in the records of one load or of all"
    )
    told_by: ClassVar[str] = (
        "measure the load with an ohmmeter; voltage and current together distinguish it from a leakage"
    )
    places: ClassVar[tuple[str, ...]] = ("load",)

    relative_error: float = quantity("", "relative error e of the load", above=-1, null=0.0)
    resistance: float | None = quantity(
        "ohm", "nominal value of the load concerned; default: all loads", default=None, above=0
    )

    def connect(self, shunt: Shunt) -> Shunt:
        if not isinstance(shunt, Resistor):
            return shunt
        meant = self.resistance is None or np.equal(self.resistance, shunt.resistance)
        if not np.any(meant):
            return shunt
        return altered(shunt, resistance=shunt.resistance * (1.0 + meant * self.relative_error))

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        if len(scales.loads) > 1:
            for resistance in scales.loads:
                yield cls(relative_error=0.0, resistance=resistance)
        if scales.loads:
            yield cls(relative_error=0.0)
