"""Gradient of power and amplitude to all parameters at the steady state, against the cost of the steady state."""

from __future__ import annotations

from piezoharvest import engine, simulate
from reports.speed.studies import sshi
from reports.speed.timing import repeat


def measure(repeats: int = 5) -> dict:
    """Times of the steady state and of its gradient, s; or why there are none."""
    if not hasattr(engine, "gradient"):
        return {"skipped": "this version has no gradient"}
    system, excitation = sshi().objects()
    engine.gradient(system, excitation)
    steady = repeat(lambda: simulate(system, excitation, samples=1), repeats).median
    seconds = repeat(lambda: engine.gradient(system, excitation), repeats).median
    return {"seconds": seconds, "steady_seconds": steady, "ratio": seconds / steady}
