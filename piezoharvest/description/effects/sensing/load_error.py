"""Load that is not what its label says."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import quantity


@dataclass(frozen=True, kw_only=True)
class LoadError(Effect):
    """The load resistor is R (1 + e): every one, or those whose label is `resistance`; absent at e = 0."""

    name: ClassVar[str] = "load_error"
    source: ClassVar[str] = "IEC 60062"
    looks: ClassVar[str] = (
        "voltage over current is not the load that is written on it, in the records of one load or in all"
    )
    told_by: ClassVar[str] = "measure the load with an ohmmeter; voltage and current together tell it from a leakage"

    relative_error: float = quantity("", "e", above=-1, null=0.0)
    resistance: float | None = quantity("ohm", "which label", default=None, above=0)

    def connect(self, shunt):
        if shunt is None or shunt.kind != "resistor":
            return shunt
        meant = self.resistance is None or np.equal(self.resistance, shunt.resistance)
        if not np.any(meant):
            return shunt
        # Unchecked: the error may have a complex step.
        wrong = object.__new__(type(shunt))
        wrong.__dict__.update(vars(shunt), resistance=shunt.resistance * (1.0 + meant * self.relative_error))
        return wrong

    @classmethod
    def starts(cls, scene):
        if len(scene.loads) > 1:
            for resistance in scene.loads:
                yield cls(relative_error=0.0, resistance=resistance)
        if scene.loads:
            yield cls(relative_error=0.0)
