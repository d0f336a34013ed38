"""The extended model: what the fit to all four tables adds to Table V, as a specimen for the engine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from piezoharvest import Leakage, Transducer
from reports.paper.candidates import EXTENDED, Parameters
from reports.paper.fitting import Fit, fit
from reports.paper.model import transducer
from reports.paper.rows import Bench
from reports.paper.tables import all_rows


@cache
def extended_fit() -> Fit:
    """The fit of one set of parameters to Tables I to IV."""
    return fit(EXTENDED, all_rows())


@dataclass(frozen=True)
class Joint:
    """What the displacement sensor reads of the joint, m, from the force in N."""

    seat: float
    seat_force: float

    def __call__(self, force: np.ndarray) -> np.ndarray:
        """Displacement of the joint."""
        return -self.seat * np.expm1(-np.maximum(force, 0.0) / self.seat_force)


def device(p: Parameters, leak: bool = True) -> Transducer:
    """The transducer of a set of parameters, linear, with the leak beside it or without."""
    coupling = p["charge"] * p["stiffness"]
    effects = (Leakage(resistance=p["leak"]),) if leak else ()
    clamped = p["capacitance"] - coupling * p["charge"]
    return transducer("none", stiffness=p["stiffness"], coupling=coupling, capacitance=clamped, effects=effects)


def bench(p: Parameters) -> Bench:
    """The extended model on the testing machine."""
    return Bench(device(p), p["rise_time"], Joint(p["seat"], p["seat_force"]))
