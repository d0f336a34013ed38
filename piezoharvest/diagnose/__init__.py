"""Diagnosis of a campaign: structure in the residuals of a fitted model, its likely cause, and what adding it gains."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from piezoharvest.callable_package import make_callable

if TYPE_CHECKING:
    from piezoharvest.diagnose.diagnosis import diagnose
    from piezoharvest.diagnose.result import Diagnosis, Named

__all__ = ["Diagnosis", "Named", "diagnose"]


def __getattr__(name: str) -> Any:
    # Lazy: fits bring numba and scipy.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{'diagnosis' if name == 'diagnose' else 'result'}"), name)


make_callable(__name__)
