"""The event-driven engine: exact propagation of piecewise linear models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezoharvest.engine.response import Response, Waveforms
    from piezoharvest.engine.simulation import simulate

__all__ = ["Response", "Waveforms", "simulate"]


def __getattr__(name: str) -> Any:
    # Lazy: the simulator brings numba, which readers of results do not need.
    from importlib import import_module

    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{'simulation' if name == 'simulate' else 'response'}"), name)
