"""Several specimens of one kind: parameters of each, their mean and spread, and the form of law that they share."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezoharvest.population.diagnosis import SpecimensDiagnosis, diagnose_specimens
    from piezoharvest.population.identification import SpecimensIdentification, identify_specimens

_HOMES = {
    "diagnosis": ("SpecimensDiagnosis", "diagnose_specimens"),
    "identification": ("SpecimensIdentification", "identify_specimens"),
}
__all__ = ["SpecimensDiagnosis", "SpecimensIdentification", "diagnose_specimens", "identify_specimens"]


def __getattr__(name: str) -> Any:
    # Lazy: fits bring numba and scipy.
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
