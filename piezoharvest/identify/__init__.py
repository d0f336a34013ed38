"""Parameters from measured records: output-error fit, hysteresis loops, frequency responses."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from piezoharvest.callable_package import make_callable

if TYPE_CHECKING:
    from piezoharvest.identify.frequency.modal_fit import fit_modes, select_modes
    from piezoharvest.identify.frequency.modes import ModalFit, Modes
    from piezoharvest.identify.frequency.multisine import FrequencyError, MultisineResponse, multisine_response
    from piezoharvest.identify.hysteresis.loop_fit import Loop, LoopError, LoopFit
    from piezoharvest.identify.hysteresis.loops import identify_loop
    from piezoharvest.identify.identification import identify
    from piezoharvest.identify.result import Estimate, Identification

__all__ = [
    "Estimate", "FrequencyError", "Identification", "Loop", "LoopError", "LoopFit", "ModalFit", "Modes",
    "MultisineResponse", "fit_modes", "identify", "identify_loop", "multisine_response", "select_modes",
]  # fmt: skip

_PLACES = {
    "frequency.modal_fit": ("fit_modes", "select_modes"),
    "identification": ("identify",),
    "result": ("Estimate", "Identification"),
    "hysteresis.loop_fit": ("Loop", "LoopError", "LoopFit"),
    "hysteresis.loops": ("identify_loop",),
    "frequency.modes": ("ModalFit", "Modes"),
    "frequency.multisine": ("FrequencyError", "MultisineResponse", "multisine_response"),
}


def __getattr__(name: str) -> Any:
    # Lazy: fits import numba and scipy.
    for module, names in _PLACES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


make_callable(__name__)
