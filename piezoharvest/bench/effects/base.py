"""What the bench may have that its labels do not tell: the vocabulary of INTERFACE section 5, written for the bench.

These are not the effects that models are extended by (`piezoharvest.description.effects`): they share names and
parameters with them and nothing else, so that what a diagnosis finds was put there by other equations.
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
    """One effect; subclasses give `name` and override the places where it acts."""

    name: ClassVar[str]

    def act(self, model: Model, duration: float) -> None:
        """Change the specimen's equations for a record of `duration` (s)."""

    def connect(self, shunt: Shunt) -> Shunt:
        """What is really connected where a label says `shunt`."""
        return shunt

    def lateness(self, channel: str) -> float:
        """Seconds by which a channel comes late."""
        return 0.0

    def disturbance(self, channel: str, time: np.ndarray, rng: np.random.Generator) -> np.ndarray | float:
        """What is added to a channel, in its SI unit."""
        return 0.0

    def span(self, channel: str) -> float:
        """Largest value that a channel passes, in its SI unit."""
        return np.inf
