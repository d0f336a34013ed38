"""Control-systems toolbox for piezoelectric shunt damping and energy harvesting.

>>> from piezoharvest import ParallelSSHI, SineForce, System, Transducer, simulate
>>> transducer = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
>>> shunt = ParallelSSHI(inductance=0.1, quality=5.0, smoothing_capacitance=1e-6, load_resistance=1e6)
>>> simulate(System(transducer, shunt), SineForce(amplitude=0.02, frequency=50.6)).converged
True
"""

from __future__ import annotations

import importlib as _importlib
import typing as _typing

from piezoharvest import former_names as _former_names

__version__ = "0.1.0"

# Where each public name lives: loaded when first used, so that importing the package costs nothing.
_HOMES = {
    "description.transducer": ("Electrode", "Mode", "Transducer"),
    "description.hysteresis": ("Hysteresis",),
    "description.system": ("System",),
    "description.circuit": ("Port", "Product", "State"),
    "description.diode": ("DiodeLine", "exponential_curve", "exponential_diode", "measured_diode"),
    "description.parameters": ("Component", "ParameterError", "quantity"),
    "description.excitation": (
        "Excitation", "Multisine", "RandomBase", "RandomForce", "Record", "SineBase", "SineForce", "StepForce",
    ),
    "description.shunts": (
        "AdaptiveRL", "Battery", "BiasFlip", "CurrentBlocking", "CurrentFlowing", "DSSH", "Digital", "Doubler", "ESSH",
        "HalfWave", "LinearShunt", "MPPT", "NegativeCapacitance", "Network", "OpAmpNegativeCapacitance", "Open",
        "ParallelBranches", "ParallelRL", "ParallelRLC", "ParallelSSHI", "Rectifier", "Resistor", "SCSECE",
        "SECE", "SICE", "SSDI", "SSDS", "SSDV", "SSHC", "SelfPoweredSECE", "SelfPoweredSSDI", "SelfPoweredSSHI",
        "SelfPoweredSeriesSSHI", "SeriesRL", "SeriesRLC", "SeriesSSHI", "Short", "Shunt", "SpiceCircuit",
    ),
    "description.shunts.storage": ("Storage",),
    "description.shunts.duty_cycle": ("LoadPhase",),
    "description.shunts.efficiency_curve": ("EfficiencyCurve",),
    "description.effects": (
        "BiasCurrent", "ChannelSkew", "Clipping", "ContactCompliance", "CouplingDrift", "Creep",
        "DielectricRelaxation", "DiodeDropError", "DisplacementLag", "Effect", "Friction", "InversionLoss", "Leakage",
        "LoadError", "MainsHum", "MissedSwitching", "NonlinearCoupling", "OnTimeOffset", "ProbeLoading",
        "ReverseLeakage", "Stiffening", "SwitchDelay", "VoltageDependentCapacitance", "VoltageReversion",
    ),
    "engine": (
        "Gradient", "NoGradientError", "Response", "Waveforms", "gradient", "simulate", "simulate_many",
    ),
    "linear": (
        "TwoPort", "admittance", "anticipating", "closed_loop", "coupling_factor", "frequency_response", "linearize",
        "linearize_shunt", "resonances", "sampled_loop", "stability_limit",
    ),
    "exchange": (
        "response_record", "shunt_from", "to_frd", "to_network", "transducer_from", "two_port_from", "write_touchstone",
    ),
    "study": ("DesignOptions", "Study", "StudyError", "from_catalogue", "load_study"),
    "design": ("DesignResult", "design"),
    "specimen": ("Specimen", "load_specimen"),
    "sweep": ("sweep",),
    "fleet": ("diagnose_fleet",),
    "bench": ("measure",),
    "records": ("Campaign", "CampaignError", "load_campaign"),
    "identify": ("Identification", "identify"),
    "diagnose": ("Diagnosis", "diagnose"),
    "report": ("write_diagnosis", "write_identification", "write_report"),
}  # fmt: skip
_HOME = {name: home for home, names in _HOMES.items() for name in names}
__all__ = sorted(_HOME)  # type: ignore[reportUnsupportedDunderAll]


_former_names.install()


def __getattr__(name: str) -> _typing.Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
