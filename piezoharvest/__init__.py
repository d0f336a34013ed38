"""Control-systems toolbox for piezoelectric shunt damping and energy harvesting.

>>> from piezoharvest import ParallelSSHI, SineForce, System, Transducer, simulate
>>> transducer = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
>>> shunt = ParallelSSHI(inductance=0.1, quality=5.0, smoothing_capacitance=1e-6, load_resistance=1e6)
>>> simulate(System(transducer, shunt), SineForce(amplitude=0.02, frequency=50.6)).converged
True
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# Where each public name lives: loaded when first used, so that importing the package costs nothing.
_HOMES = {
    "piezoharvest.transducer": ("Mode", "Transducer"),
    "piezoharvest.hysteresis": ("Hysteresis",),
    "piezoharvest.system": ("System",),
    "piezoharvest.parameters": ("Component", "ParameterError", "quantity"),
    "piezoharvest.excitation": (
        "Excitation", "Multisine", "RandomBase", "RandomForce", "Record", "SineBase", "SineForce", "StepForce",
    ),
    "piezoharvest.shunts": (
        "LinearShunt", "NegativeCapacitance", "Network", "Open", "ParallelRL", "ParallelRLC", "ParallelSSHI",
        "Rectifier", "Resistor", "SECE", "SSDI", "SSDS", "SSDV", "SeriesRL", "SeriesRLC", "SeriesSSHI", "Short",
        "Shunt",
    ),
    "piezoharvest.effects": ("DielectricRelaxation", "Effect", "Leakage"),
    "piezoharvest.engine": (
        "Gradient", "NoGradientError", "Response", "Waveforms", "gradient", "simulate", "simulate_many",
    ),
    "piezoharvest.linear": (
        "TwoPort", "admittance", "closed_loop", "coupling_factor", "frequency_response", "linearize", "resonances",
    ),
    "piezoharvest.study": ("Study", "StudyError", "load_study"),
    "piezoharvest.report": ("write_report",),
}  # fmt: skip
_HOME = {name: home for home, names in _HOMES.items() for name in names}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
