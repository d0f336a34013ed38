"""Harvesting circuits of the bench against the engine: written twice, integrated in two ways."""

import numpy as np
import pytest
from bench_runs import error, waves
from studies import BENCH, DRIVE, STOPS, bench, solve

LOAD = {"smoothing_capacitance": 2e-7, "load_resistance": 2e5}
REAL = {"diode_drop": 0.2, "diode_resistance": 3e3, "diode_leakage": 1e-7, "diode_saturation": 3e-7}
LOOP = {"inductance": 0.1, "quality": 5.0}
BRIDGE = """* bridge with a filter
.model d D(Ron={} Roff=1g Vfwd={})
D1 p plus d
D2 0 plus d
D3 minus p d
D4 minus 0 d
C1 plus minus 0.1u
L1 plus out 10
Rload out minus 160k
"""
# Coupled coils, a loop of capacitors, a switch with a threshold, and sources that leave a charge and a current at rest.
SOURCES = """* all elements
.model d D(Ron=10 Roff=1g Vfwd=0.1)
.model s SW(Ron=100 Roff=100meg Vt=1.5 Vh=0.5)
L1 p 0 100
L2 s 0 25
K1 L1 L2 0.95
D1 s dc d
C1 dc a 100n
C2 a 0 400n
C3 dc 0 50n
S1 dc out dc 0 s
Rout out 0 20k
V1 bat 0 0.3
C4 bat 0 10n
C5 bat p 1n
R1 bat dc 1meg
L3 p b 300
L4 b 0 200
I1 0 b 1u
R2 0 p 1meg
"""
CIRCUITS = {
    "spice": {"kind": "spice", "netlist": BRIDGE.format(10, 0.1), "load": ["Rload"]},
    "spice stiff": {"kind": "spice", "netlist": BRIDGE.format(0.03, 0)},
    "spice all elements": {"kind": "spice", "netlist": SOURCES, "load": ["Rout"]},
    "rectifier": {"kind": "rectifier", **LOAD, **REAL},
    "half_wave": {"kind": "half_wave", **LOAD, "diode_drop": 0.1, "diode_saturation": 1e-6, "dc_leakage": 1e-7},
    "half_wave real": {"kind": "half_wave", "dc_voltage": 1.0, **REAL},
    "doubler": {"kind": "doubler", **LOAD, "diode_drop": 0.1, "diode_leakage": 1e-7, "dc_leakage": 1e-7},
    "doubler real": {"kind": "doubler", **LOAD, **REAL},
    "mppt": {"kind": "mppt", "fraction": 0.4, **REAL},
    "mppt without a drop": {"kind": "mppt", "fraction": 0.6, "sampling_duty": 0.1},
    "doubler dc": {"kind": "doubler", "dc_voltage": 2.0, "diode_drop": 0.1},
    "battery": {"kind": "battery", "dc_voltage": 1.0, "internal_resistance": 2e3, **REAL},
    "parallel_sshi": {"kind": "parallel_sshi", "inductance": 0.1, "quality": 5.0, **LOAD, **REAL},
    "series_sshi": {"kind": "series_sshi", "inductance": 0.1, "quality": 5.0, **LOAD, **REAL, "on_time_error": 0.4},
    "sshc": {"kind": "sshc", "flip_capacitances": [40e-9, 60e-9], "switch_resistance": 300.0, **LOAD},
    "sshc late": {
        "kind": "sshc", "flip_capacitances": [30e-9] * 3, "switch_resistance": 300.0, **LOAD, **REAL, "phase_lag": 0.2,
        "on_time_error": -0.5,
    },
    "bias_flip": {"kind": "bias_flip", "steps": 3, **LOOP, **LOAD, "bias_capacitance": 1e-6},
    "bias_flip late": {
        "kind": "bias_flip", "steps": 4, **LOOP, **LOAD, **REAL, "bias_capacitance": 1e-6, "phase_lag": 0.2,
        "on_time_error": 0.1,
    },
    "sece": {"kind": "sece", **LOOP},
    "sece late": {
        "kind": "sece", **LOOP, "diode_drop": 0.2, "diode_resistance": 1e3, "phase_lag": 0.2, "on_time_error": 0.9,
    },
    "sece closed long": {"kind": "sece", **LOOP, "diode_drop": 0.1, "on_time_error": 0.9},
    "sice": {"kind": "sice", **LOOP, "diode_drop": 0.1},
    "sice early": {"kind": "sice", **LOOP, "phase_lag": -0.2, "on_time_error": -0.2},
    # Still closed at the next extremum, which then changes nothing.
    "sice closed long": {"kind": "sice", **LOOP, "on_time_error": 60.0},
    "sc_sece": {"kind": "sc_sece", **LOOP, "short_time": 2e-3, "phase_lag": 0.1},
    "dssh": {"kind": "dssh", **LOOP, "intermediate_capacitance": 120e-9, "diode_drop": 0.1, "diode_resistance": 1e2},
    "essh": {"kind": "essh", **LOOP, "intermediate_capacitance": 120e-9, "second_inductance": 0.02,
             "second_quality": 8.0, "residual": 0.5, "diode_drop": 0.1},
    "ssds": {"kind": "ssds", **LOOP},
    "dssh short": {"kind": "dssh", **LOOP, "intermediate_capacitance": 120e-9, "on_time_error": -0.6},
}  # fmt: skip


@pytest.mark.parametrize("name", CIRCUITS)
def test_the_engine_and_the_bench_say_the_same(name):
    device = {**BENCH, "hysteresis": STOPS}
    wanted = solve(bench(CIRCUITS[name], **{"hysteresis": STOPS}), transient=0.1, samples=64).waveforms
    found = waves(DRIVE, CIRCUITS[name], device, times=wanted.time)
    for signal in ("displacement", "voltage", "dc_voltage"):
        if np.isnan(getattr(found, signal)).all():
            continue  # no dc side
        assert error(getattr(found, signal), getattr(wanted, signal)) < 1e-6, signal


# Its damper carries the force: its voltage is a tiny share of that of a static deflection. Under the preload the charge
# is a hundred million times as large as the part of it that moves.
SLUGGISH = {"mass": 360.0, "damping": 8.1e5, "stiffness": 28.0, "coupling": 4.4e-8, "capacitance": 2.8e-13}
BREAKER = {"kind": "self_powered_sece", "inductance": 1e6, "quality": 5.0, "envelope_capacitance": 2.8e-14}
WITHOUT_DROP = {
    "half_wave": ({"kind": "half_wave", "dc_voltage": 1.0}, 0.0),
    "breaker": ({**BREAKER, "threshold": 1e-5}, 0.0),
    "breaker that never closes, preload": ({**BREAKER, "threshold": 1.0}, -6.9),
}


@pytest.mark.parametrize("name", WITHOUT_DROP)
def test_diodes_without_a_drop_at_a_voltage_far_below_that_of_a_static_force(name):
    shunt, offset = WITHOUT_DROP[name]
    drive = {"kind": "sine_force", "amplitude": 2.3, "frequency": 123.0, "offset": offset}
    study = {"transducer": SLUGGISH, "excitation": drive, "shunts": [shunt]}
    wanted = solve(study, transient=8 / 123.0, samples=64).waveforms
    found = waves(drive, shunt, SLUGGISH, times=wanted.time)
    for signal in ("displacement", "voltage"):
        assert error(getattr(found, signal), getattr(wanted, signal)) < 1e-4, signal
