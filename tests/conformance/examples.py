"""An example of every component, made from the units of its fields: a new component needs nothing here to be tested."""

import dataclasses
import itertools
from typing import Literal, get_args, get_origin, get_type_hints

from studies import BENCH, DRIVE

from piezoharvest.description.effects import Effect
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt
from piezoharvest.description.shunts.curves.loop_sections import LoopSections
from piezoharvest.description.shunts.storage import Storage

OMEGA = 2 * 3.141592653589793 * DRIVE["frequency"]
IMPEDANCE = 1 / (OMEGA * BENCH["capacitance"])
# Of the size that suits the bench, by unit: an inductance resonates with the electrodes, a pure number is a quality.
TYPICAL = {
    "ohm": IMPEDANCE,
    "F": 0.6 * BENCH["capacitance"],
    "H": IMPEDANCE / OMEGA,
    "V": 1.0,
    "s": 2e-4,
    "C": 1e-7,
    "A": 1e-8,
    "": 6.0,
    "Hz": DRIVE["frequency"],
    "m": 2e-5,
    "N/m": 0.05 * BENCH["stiffness"],
    "N/m^3": 1e9,
    "m/N^(2/3)": 1e-6,
    "1/V^2": 1e-2,
    "C/m^2": 1.0,
    "S": 0.1 / IMPEDANCE,
}
RELATIVE = 0.1  # a pure number of an effect
SWITCHED_INDUCTANCE = 0.01
# Fields that have no unit.
BRANCHES = {"inductances": (300.0, 40.0), "resistances": (3e4, 2e4)}
SPICE = """* bridge with a filter
.model d D(Ron=10 Roff=1g Vfwd=0.1)
D1 p plus d
D2 0 plus d
D3 minus p d
D4 minus 0 d
C1 plus minus 0.1u
L1 plus out 10
Rload out minus 160k
"""
BREAKER = {"envelope_capacitance": 1e-9, "threshold": 0.6, "inductance": 0.01}
GIVEN = {
    "sshc": {"flip_capacitances": (40e-9, 60e-9), "switch_resistance": 100.0},
    "probe_loading": {"capacitance": 4e-9},
    **{f"self_powered_{kind}": BREAKER for kind in ("sshi", "series_sshi", "sece", "ssdi")},
    "mppt": {"fraction": 0.4, "sampling_duty": 0.1},
    "network": {"netlist": "L1 1 2 150\nC1 2 0 30n\nR1 2 0 100k load"},
    "spice": {"netlist": SPICE, "load": ("Rload",)},
    # Begins off the electrical resonance; of currents of 0.1 mA.
    "adaptive_rl": {
        "inductance": 1.1 * IMPEDANCE / OMEGA,
        "resistance": 0.3 * IMPEDANCE,
        "adaptation_rate": 0.003 * OMEGA / 1e-8,
        "averaging_time": 3 / DRIVE["frequency"],
    },
    # A series RL circuit at 200 samples a period.
    "digital": {
        "numerator": (1.0,),
        "denominator": (IMPEDANCE / OMEGA, 0.2 * IMPEDANCE),
        "sample_time": 0.005 / DRIVE["frequency"],
    },
    "op_amp_negative_capacitance": {"gain_bandwidth": 1e5, "saturation": 2.0},
    "essh": {"residual": 0.5, "second_quality": 6.0},
    "current_flowing": {**BRANCHES, "capacitances": (5e-8, 4e-8)},
    "parallel_branches": {**BRANCHES, "capacitances": (4e-8,)},
    "current_blocking": {**BRANCHES, "blocking_inductances": (25.0, 3.0), "blocking_capacitances": (4e-7, 5e-7)},
}
COIL = {"inductance": 0.01, "quality": 6.0}
WOUND = {"switch_resistance": 30.0, "self_resonance": 4e4}
# Of a coil that swings with sqrt(L C) = 2e-5 s and has 80 ohm.
SECTIONS = LoopSections(resistances=(60.0, 90.0), time_constants=(1e-5, 2e-5), beside=("inductance", "capacitance"))
LEAKING = {"diode_leakage": 1e-6, "diode_saturation": 1e-6, "dc_leakage": 1e-6}
ESR = {
    "dc_voltage": None,
    "smoothing_capacitance": 24e-9,
    "load_resistance": IMPEDANCE,
    "smoothing_resistance": 3e4,
}
STORAGE = Storage(turn_on=0.5, turn_off=0.3, power=1e-6, efficiency=0.9, max_voltage=1.2)
# Combinations beside the plainest ones that are worth a run.
VARIANTS = {
    "rectifier": [
        {"dc_voltage": None, "smoothing_capacitance": 24e-9, "storage": STORAGE},
        {"dc_voltage": 1.0, "diode_drop": 0.2, **LEAKING},
        {
            "dc_voltage": None,
            "smoothing_capacitance": 24e-9,
            "load_resistance": IMPEDANCE,
            "diode_drop": 0.2,
            "diode_resistance": 3e3,
            "smoothing_resistance": 3e3,
        },
    ],
    "doubler": [
        {"diode_drop": 0.2, **LEAKING},
        {"diode_drop": 0.2, "diode_resistance": 3e3},
        {**ESR, "diode_drop": 0.2},
    ],
    "half_wave": [
        {"diode_drop": 0.2, **LEAKING},
        {"diode_drop": 0.2, "diode_resistance": 3e3},
        {**ESR, **LEAKING, "diode_drop": 0.2},
    ],
    "battery": [{"diode_drop": 0.2, "internal_resistance": 3e3, **LEAKING}],
    "self_powered_sshi": [
        {"diode_drop": 0.05, "diode_resistance": 3e3, "core_resistance": 3e3, **LEAKING},
        {"diode_drop": 0.05, **WOUND},
        {"dc_voltage": 1.0, "diode_drop": 0.05, "base_resistance": 2e5},
    ],
    "self_powered_series_sshi": [
        {**ESR, "diode_drop": 0.05},
        {"dc_voltage": 0.3, "diode_drop": 0.05, "diode_resistance": 50.0, **WOUND},
        {"diode_drop": 0.05, "dc_voltage": 0.3, "diode_resistance": 50.0, "core_resistance": 3e3},
    ],
    "self_powered_sece": [
        {"diode_drop": 0.05, "base_resistance": 2e5},
        {"diode_drop": 0.05, "efficiency": 0.7, "core_resistance": 3e3},
        {"diode_drop": 0.05, **WOUND},
    ],
    "self_powered_ssdi": [
        {"diode_drop": 0.05, "base_resistance": 2e5},
        {"diode_drop": 0.05, "core_resistance": 3e3},
        {"diode_drop": 0.05, "core_resistance": 3e3, **WOUND},
    ],
    "mppt": [{"diode_drop": 0.2, "diode_resistance": 3e3}],
    "parallel_sshi": [
        {"phase_lag": 0.2, "on_time_error": 0.2, "diode_resistance": 3e3},
        {"phase_lag": -0.2, "on_time_error": -0.2, "core_resistance": 3e3, **LEAKING},
        {"phase_lag": -0.2, "on_time_error": -0.2, **WOUND},
        {"phase_lag": -0.2, "on_time_error": -0.2, "loop_sections": SECTIONS},
    ],
    "series_sshi": [
        {"phase_lag": 0.2, "on_time_error": 0.4, **LEAKING},
        {"phase_lag": -0.2, "on_time_error": -0.2, "diode_resistance": 200.0, "core_resistance": 3e3},
        {"on_time_error": 0.4, "diode_drop": 0.1, **WOUND},
        {"on_time_error": 0.4, "diode_drop": 0.1, "loop_sections": SECTIONS},
    ],
    "sshc": [
        {"phase_lag": 0.2, "diode_resistance": 3e3, "on_time_error": -0.2, **LEAKING},
        {"phase_lag": -0.2, "flip_capacitances": (30e-9,) * 4, "gate_energy": 1e-9, "control_power": 1e-8},
    ],
    "bias_flip": [
        {"steps": 4, "phase_lag": 0.2, "on_time_error": 0.1, "loop_sections": SECTIONS},
        {"steps": 2, "bias_capacitance": 1e-6, "core_resistance": 3e3, **WOUND},
    ],
    "sice": [
        {"phase_lag": 0.2, "on_time_error": -0.3, "diode_drop": 0.1, "loop_sections": SECTIONS},
        {"phase_lag": -0.2, "efficiency": 0.7, "core_resistance": 3e3},
        {"on_time_error": 0.4, "diode_drop": 0.1, **WOUND},
    ],
    "sc_sece": [
        {"phase_lag": 0.2, "short_time": 3e-3, "diode_resistance": 50.0, "core_resistance": 3e3},
        {"phase_lag": -0.2, "short_time": 3e-3, "on_time_error": 1.4, "core_resistance": 3e3, **WOUND},
    ],
    "dssh": [
        {"phase_lag": 0.2, "on_time_error": -0.5, "loop_sections": SECTIONS},
        {"phase_lag": -0.2, "diode_drop": 0.1, "efficiency": 0.7, "core_resistance": 3e3},
        {"on_time_error": 0.3, **WOUND},
    ],
    "essh": [
        {
            "second_core_resistance": 3e3,
            "second_switch_resistance": 30.0,
            "second_self_resonance": 4e4,
            "core_resistance": 3e3,
            **WOUND,
        }
    ],
    "sece": [
        {"efficiency": 0.7, "phase_lag": -0.2, "gate_energy": 1e-9},
        {"diode_drop": 0.3},
        {**COIL, "phase_lag": 0.2, "diode_drop": 0.1},
        {**COIL, "on_time_error": -0.3, "phase_lag": -0.2, "core_resistance": 3e3},
        {**COIL, "on_time_error": 1.4, "diode_drop": 0.05, **WOUND},
    ],
    "ssds": [
        {"phase_lag": 0.2, "detector_threshold": 1.0},
        {**COIL, "phase_lag": 0.2, "on_time_error": 0.1, "core_resistance": 3e3},
        {**COIL, "on_time_error": -0.2, **WOUND},
    ],
    "ssdi": [
        {"phase_lag": 0.2, "on_time_error": 0.4, "loop_sections": SECTIONS},
        {"phase_lag": 0.2, "on_time_error": 0.4, "switch_resistance": 30.0, "core_resistance": 3e3},
        {"on_time_error": -0.3, **WOUND},
    ],
    "ssdv": [{"phase_lag": -0.1, "on_time_error": -0.2, "loop_sections": SECTIONS}, {"core_resistance": 3e3}, WOUND],
    "current_blocking": [{"coil_quality": 20.0}],
    "series_rl": [
        {"winding_resistance": 0.1 * IMPEDANCE, "core_resistance": 20 * IMPEDANCE},
        {"winding_resistance": 0.1 * IMPEDANCE, "self_resonance": 4 * DRIVE["frequency"]},
    ],
    "parallel_rl": [
        {
            "winding_resistance": 0.1 * IMPEDANCE,
            "core_resistance": 20 * IMPEDANCE,
            "self_resonance": 4 * DRIVE["frequency"],
        }
    ],
    "digital": [{"delay": 0.0065 / DRIVE["frequency"]}],
    "adaptive_rl": [{"topology": "parallel", "resistance": 3 * IMPEDANCE}],
    "negative_capacitance": [{"topology": "series", "capacitance": 3 * BENCH["capacitance"]}],
}


def typical(cls, field):
    """Value of a quantity field, within its bounds."""
    value = TYPICAL[field.metadata["unit"]]
    if field.metadata["unit"] == "" and issubclass(cls, Effect):
        # A quality has a bound above zero, half of what loses half of an inversion.
        value = max(RELATIVE, 6.0 * (field.metadata.get("above") or 0.0))
    if field.metadata["unit"] == "H" and not issubclass(cls, LinearShunt):
        value = SWITCHED_INDUCTANCE
    if field.metadata.get("at_most") is not None:
        value = min(value, field.metadata["at_most"])
    return value


def plain_examples(cls, given):
    """Every smallest set of keys with which a component can be built; of words that are allowed the first."""
    words = {name: get_args(hint)[0] for name, hint in get_type_hints(cls).items() if get_origin(hint) is Literal}
    given = {**{f.name: words[f.name] for f in dataclasses.fields(cls) if f.name in words}, **given}
    fields = [f for f in dataclasses.fields(cls) if "unit" in f.metadata and f.name not in given]
    needed = {f.name: typical(cls, f) for f in fields if f.default is dataclasses.MISSING}
    optional = [f for f in fields if f.default is None]
    found = []
    for count in range(len(optional) + 1):
        for chosen in itertools.combinations(optional, count):
            names = {f.name for f in chosen}
            if any(set(smaller) <= names for smaller, _ in found):
                continue
            try:
                found.append((names, cls(**given, **needed, **{f.name: typical(cls, f) for f in chosen})))
            except ParameterError:
                continue
    return [example for _, example in found]


def examples(registered):
    """Every component's examples by a readable name."""
    named = {}
    for name, cls in registered.items():
        plain = plain_examples(cls, GIVEN.get(name, {}))
        assert plain, f"{name}: no example could be made of the units of its fields; give one in {__file__}"
        for n, example in enumerate(plain):
            named[f"{name} {n}" if len(plain) > 1 else name] = example
        for variant in VARIANTS.get(name, []):
            named[f"{name} {variant}"] = dataclasses.replace(plain[0], **variant)
    return named
