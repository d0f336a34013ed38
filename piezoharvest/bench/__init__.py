"""Virtual test bench: a study measured as in section III of the reference paper, and written as a campaign."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezoharvest.bench.measuring import BenchCampaign, BenchRecord, measure
    from piezoharvest.bench.settings import Bench
    from piezoharvest.bench.solver import SolverError
    from piezoharvest.bench.writing import write_campaign

__all__ = ["Bench", "BenchCampaign", "BenchRecord", "SolverError", "measure", "write_campaign"]

_HOMES = {
    "measuring": ("BenchCampaign", "BenchRecord", "measure"),
    "settings": ("Bench",),
    "solver": ("SolverError",),
    "writing": ("write_campaign",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    # Imported lazily: the bench needs pydantic and scipy.
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
