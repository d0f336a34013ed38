"""Effects in the mechanics of the specimen, all in its first mode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.bench.effects.base import BenchEffect
from piezoharvest.description.parameters import quantity


@dataclass(frozen=True, kw_only=True)
class Creep(BenchEffect):
    """Kelvin-Voigt element in series with the spring: k (x - y) = F - ..., tau y' = c (x - y) - y.

    Under a constant force x ends at (1 + c) F/k, and the charge follows it. A preload has crept before the record.
    """

    name: ClassVar[str] = "creep"

    compliance_ratio: float = quantity(
        "", "compliance of the element, relative to that of the spring", at_least=0, null=0.0
    )
    time_constant: float = quantity("s", "retardation time", above=0)

    def act(self, model, duration):
        """Add the element's displacement as a state, and its force on the mode."""
        stiffness, ratio = model.transducer.stiffness, self.compliance_ratio

        def rate(m):
            return (ratio * (m.x[0] - m.y[row]) - m.y[row]) / self.time_constant

        row = model.add_state(stiffness, rate, lambda m: ratio / (1.0 + ratio) * m.x[0])
        model.forces.append(lambda m: stiffness * m.y[row])


@dataclass(frozen=True, kw_only=True)
class Stiffening(BenchEffect):
    """Spring force k x + k3 x^3."""

    name: ClassVar[str] = "stiffening"

    cubic_stiffness: float = quantity("N/m^3", "cubic stiffness k3", null=0.0)

    def act(self, model, duration):
        """Add the cubic force."""
        model.forces.append(lambda m: -self.cubic_stiffness * m.x[0] ** 3)
        model.smooth = model.smooth or self.cubic_stiffness != 0


@dataclass(frozen=True, kw_only=True)
class Friction(BenchEffect):
    """Stop operator on x beside the spring, relaxed under the preload."""

    name: ClassVar[str] = "friction"

    stiffness: float = quantity("N/m", "stiffness while sticking", at_least=0, null=0.0)
    threshold: float = quantity("m", "displacement at which it slips", above=0)

    def act(self, model, duration):
        """Add the stop operator."""
        model.add_friction(self.stiffness, self.threshold)
