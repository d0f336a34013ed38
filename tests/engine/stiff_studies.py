"""Random studies of the engine's stiff corner: time constants from 1e-9 of the period on, stops near zero or alike."""

import math

import numpy as np
from random_studies import log_uniform

KINDS = (
    "short", "open", "resistor", "series_rl", "parallel_rl", "series_rlc", "parallel_rlc", "rectifier", "parallel_sshi",
    "series_sshi", "sece", "ssds", "ssdi", "ssdv",
)  # fmt: skip
STACK = {"mass": 0.0158, "damping": 1250.0, "stiffness": 3.125e8, "coupling": 7.822, "capacitance": 3.2e-6}
STACK_STOPS = {"thresholds": [1e-7, 3e-7, 7e-7], "weights": [5e5, 1.5e6, 5e5]}


def stiff_study(seed):
    """Study of kind seed mod 14; a third of them drive the catalogue's stack far below its resonance."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    if rng.uniform() < 0.3:
        transducer, frequency, force = dict(STACK), log_uniform(rng, 0.5, 5e3), log_uniform(rng, 1.0, 3000.0)
        if rng.uniform() < 0.7:
            transducer["hysteresis"] = STACK_STOPS
    else:
        transducer, frequency, force = _device(rng)
    excitation = {"kind": "sine_force", "amplitude": force, "frequency": frequency}
    if rng.uniform() < 0.4:
        excitation["offset"] = force * log_uniform(rng, 1e-3, 3.0) * float(rng.choice([-1, 1]))
    capacitance = transducer["capacitance"]
    voltage = transducer["coupling"] * force / transducer["stiffness"] / capacitance
    shunt = {"kind": kind, **_keys(rng, kind, capacitance, 1.0 / frequency, voltage)}
    return {"transducer": transducer, "excitation": excitation, "shunts": [shunt]}


def _device(rng):
    """Resonance of 5 Hz to 5 kHz, quality to 1e4, k_e^2 of 1e-3 to 0.5, driven at it, near it and far from it."""
    mass, capacitance, w_sc = log_uniform(rng, 1e-3, 1.0), log_uniform(rng, 1e-9, 1e-5), log_uniform(rng, 30.0, 3e4)
    quality, squared, force = log_uniform(rng, 5.0, 1e4), log_uniform(rng, 1e-3, 0.5), log_uniform(rng, 1e-2, 10.0)
    stiffness, damping = mass * w_sc**2, mass * w_sc / quality
    coupling = math.sqrt(squared * stiffness * capacitance)
    anywhere = [log_uniform(rng, *between) for between in ((1e-3, 1.0), (0.8, 1.3), (1.0, 30.0))]
    omega = w_sc * float(rng.choice([1.0, math.sqrt(1 + squared), *anywhere]))
    device = {
        "mass": mass, "damping": damping, "stiffness": stiffness, "coupling": coupling, "capacitance": capacitance,
    }  # fmt: skip
    if rng.uniform() < 0.7:
        charge = coupling * force / abs(stiffness - mass * omega**2 + 1j * damping * omega)
        device["hysteresis"] = _stops(rng, charge, capacitance)
    return device, omega / (2 * math.pi), force


def _stops(rng, charge, capacitance):
    """One to five stops: spread over four decades, all but equal, all but zero, or multiples that slip in step."""
    count, how = int(rng.integers(1, 6)), int(rng.integers(0, 4))
    limits = np.sort(charge * 10 ** rng.uniform(-4.0, 0.5, count))
    if how == 0:
        limits = limits[0] * (1 + 1e-9 * np.arange(count))
    elif how == 1:
        limits = 1e-6 * limits
    elif how == 2:
        limits = limits[0] * np.arange(1, count + 1)
    weights = 10 ** rng.uniform(-3.0, 1.0, count) / count / capacitance
    return {"thresholds": limits.tolist(), "weights": weights.tolist()}


def _keys(rng, kind, capacitance, period, voltage):
    """Keys of a shunt, its time constants 1e-9 to 1 of the period and its resistances 1e-3 to 1e12 ohm."""

    def resistance():
        if rng.uniform() < 0.2:
            return float(rng.choice([1e-3, 0.1, 1e9, 1e12]))
        return log_uniform(rng, 1e-9, 1.0) * period / capacitance

    def resonant(longest):
        return (log_uniform(rng, 1e-6, longest) * period / math.pi) ** 2 / capacitance

    keys = {}
    if kind == "resistor":
        keys["resistance"] = resistance()
    if kind in ("series_rl", "parallel_rl", "series_rlc", "parallel_rlc"):
        keys |= {"resistance": resistance(), "inductance": resonant(3.0)}
    if kind in ("series_rlc", "parallel_rlc"):
        keys["capacitance"] = capacitance * log_uniform(rng, 1e-3, 1e3)
    if kind in ("rectifier", "parallel_sshi", "series_sshi"):
        if rng.uniform() < 0.6:
            keys["smoothing_capacitance"] = capacitance * log_uniform(rng, 1e-3, 1e5)
            keys["load_resistance"] = resistance()
        else:
            keys["dc_voltage"] = voltage * log_uniform(rng, 1e-4, 2.0) if rng.uniform() < 0.8 else 0.0
        if rng.uniform() < 0.5:
            keys["diode_drop"] = voltage * log_uniform(rng, 1e-6, 0.5)
    if kind in ("parallel_sshi", "series_sshi", "ssdi", "ssdv"):
        keys |= {"quality": log_uniform(rng, 0.6, 100.0), "inductance": resonant(0.2)}
        if rng.uniform() < 0.3:
            keys["on_time_error"] = float(rng.uniform(-0.3, 0.3))
    if kind == "ssdv":
        keys["source_voltage"] = 0.05 * voltage * float(rng.uniform())
    if kind in ("parallel_sshi", "series_sshi", "ssdi", "ssdv", "sece", "ssds") and rng.uniform() < 0.4:
        keys["phase_lag"] = float(rng.uniform(-0.3, 0.3))
    if kind == "sece":
        keys["efficiency"] = float(rng.uniform(0.5, 1.0))
    return keys
