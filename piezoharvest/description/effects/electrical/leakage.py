"""Leakage resistance across the electrodes."""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.circuit import Product
from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity


@dataclass(frozen=True, kw_only=True)
class Leakage(Effect):
    """A resistance across the electrodes: a meter's input, moisture; absent when infinite."""

    name: ClassVar[str] = "leakage"
    source: ClassVar[str] = "IEEE Std 176-1987"
    looks: ClassVar[str] = (
        "the voltage decays faster than the load alone lets it, most with the largest load resistance"
    )
    told_by: ClassVar[str] = "a step with open electrodes: the decay is the leakage's alone"

    resistance: float = quantity("ohm", "leakage resistance", above=0, null=float("inf"))

    def act(self, specimen):
        specimen.draw(specimen.v / self.resistance)

    def losses(self, terms):
        return [Product(1.0 / self.resistance, terms.v, terms.v)]

    @classmethod
    def starts(cls, scene):
        if scene.loaded:
            yield cls(resistance=1e15)
