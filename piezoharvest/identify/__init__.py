"""Parameters from measured records: output-error fit, hysteresis loops, frequency responses."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezoharvest.identify.identification import Estimate, Identification, identify

__all__ = ["Estimate", "Identification", "identify"]


def __getattr__(name: str) -> Any:
    # Lazy: fits bring numba and scipy.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.identification"), name)
