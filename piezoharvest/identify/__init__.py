"""Parameters from measured records: output-error fit, hysteresis loops, frequency responses."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezoharvest.identify.frequency import fit_modes, select_modes
    from piezoharvest.identify.identification import Estimate, Identification, identify
    from piezoharvest.identify.loop_fit import Loop, LoopError, LoopFit
    from piezoharvest.identify.loops import identify_loop
    from piezoharvest.identify.modes import ModalFit, Modes
    from piezoharvest.identify.multisine import FrequencyError, MultisineResponse, multisine_response

__all__ = [
    "Estimate", "FrequencyError", "Identification", "Loop", "LoopError", "LoopFit", "ModalFit", "Modes",
    "MultisineResponse", "fit_modes", "identify", "identify_loop", "multisine_response", "select_modes",
]  # fmt: skip

_PLACES = {
    "frequency": ("fit_modes", "select_modes"),
    "identification": ("Estimate", "Identification", "identify"),
    "loop_fit": ("Loop", "LoopError", "LoopFit"),
    "loops": ("identify_loop",),
    "modes": ("ModalFit", "Modes"),
    "multisine": ("FrequencyError", "MultisineResponse", "multisine_response"),
}


def __getattr__(name: str) -> Any:
    # Lazy: fits bring numba and scipy.
    for module, names in _PLACES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
