"""Base class of the bench's effects: deviations from its labels, in the vocabulary of docs/equations.md.

They are independent of the effects of models (`piezoharvest.description.effects`): they have the same names and
parameters but separate equations, so that a diagnosis is tested against other code than its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from piezoharvest.bench.solver import Model
from piezoharvest.description.parameters import Component
from piezoharvest.description.shunts import Shunt


@dataclass(frozen=True, kw_only=True)
class BenchEffect(Component):
    """One effect; subclasses set `name` and override the methods of the places where it acts."""

    name: ClassVar[str]

    def act(self, model: Model, duration: float) -> None:
        """Change the specimen's equations for a record of `duration` (s)."""

    def connect(self, shunt: Shunt) -> Shunt:
        """Circuit that is actually connected for the label `shunt`."""
        return shunt

    def lateness(self, channel: str) -> float:
        """Delay of a channel, s."""
        return 0.0

    def disturbance(self, channel: str, time: np.ndarray, rng: np.random.Generator) -> np.ndarray | float:
        """Disturbance of a channel, in its SI unit."""
        return 0.0

    def span(self, channel: str) -> float:
        """Largest value that a channel transmits, in its SI unit."""
        return np.inf
