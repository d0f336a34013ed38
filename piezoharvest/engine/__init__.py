"""Event-driven simulation: exact propagation of piecewise linear models, with smooth nonlinear elements."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezoharvest.engine.batch import simulate_many
    from piezoharvest.engine.response import Response, Waveforms
    from piezoharvest.engine.sensitivity.gradient import Gradient, NoGradientError, gradient
    from piezoharvest.engine.simulation import simulate

__all__ = ["Gradient", "NoGradientError", "Response", "Waveforms", "gradient", "simulate", "simulate_many"]

_HOMES = {
    "Response": "response", "Waveforms": "response", "simulate": "simulation", "simulate_many": "batch",
    "gradient": "sensitivity.gradient", "Gradient": "sensitivity.gradient",
    "NoGradientError": "sensitivity.gradient",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    # Imported lazily: the simulator needs numba, readers of results do not.
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
