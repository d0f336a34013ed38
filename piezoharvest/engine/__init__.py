"""The event-driven engine: exact propagation of piecewise linear models, and of what bends in them."""

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
    # Lazy: the simulator brings numba, which readers of results do not need.
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
