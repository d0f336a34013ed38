"""Random studies for the comparison with the oracle: nF to uF, Hz to kHz, k_e^2 Q_m from 0.1 to 10."""

import math

import numpy as np
from studies import inversion

KINDS = ("rectifier", "parallel_sshi", "series_sshi", "sece", "ssds", "ssdi", "ssdv", "resistor")


def log_uniform(rng, low, high):
    return float(10 ** rng.uniform(math.log10(low), math.log10(high)))


def random_study(seed):
    """Study of kind seed mod 8, driven between its resonances; every second one has hysteresis."""
    rng = np.random.default_rng(seed)
    kind, hysteretic = KINDS[seed % len(KINDS)], bool(seed // len(KINDS) % 2)
    mass, capacitance = log_uniform(rng, 1e-3, 1.0), log_uniform(rng, 1e-9, 1e-5)
    w_sc, quality = 2 * math.pi * log_uniform(rng, 5.0, 5e3), log_uniform(rng, 5.0, 60.0)
    squared = log_uniform(rng, 0.1, 10.0) / quality
    stiffness = mass * w_sc**2
    omega = w_sc * math.sqrt(1 + rng.uniform() * squared)
    coupling = math.sqrt(squared * stiffness * capacitance)
    damping, force = mass * w_sc / quality, log_uniform(rng, 1e-2, 10.0)
    # Short-circuit displacement and the charge it makes: the sizes that thresholds are set against.
    charge = coupling * force / abs(stiffness - mass * omega**2 + 1j * damping * omega)
    transducer = {
        "mass": mass, "damping": damping, "stiffness": stiffness, "coupling": coupling, "capacitance": capacitance,
    }  # fmt: skip
    if hysteretic:
        share = rng.uniform(0.05, 0.3, 2) / capacitance
        limits = charge * np.array([0.02, 0.1]) * rng.uniform(0.5, 2.0)
        transducer["hysteresis"] = {"thresholds": limits.tolist(), "weights": share.tolist()}
    excitation = {"kind": "sine_force", "amplitude": force, "frequency": omega / (2 * math.pi)}
    shunt = {"kind": kind, **_keys(rng, kind, capacitance, omega, charge / capacitance)}
    return {"transducer": transducer, "excitation": excitation, "shunts": [shunt]}


def _keys(rng, kind, capacitance, omega, voltage):
    """Keys of a shunt, around its optimum."""
    keys, loop = {}, log_uniform(rng, 3.0, 20.0)
    q, factor = inversion(loop), log_uniform(rng, 0.3, 3.0)
    if kind == "resistor":
        return {"resistance": factor / (capacitance * omega)}
    if kind == "sece":
        keys["efficiency"] = float(rng.uniform(0.5, 1.0))
    if kind in ("parallel_sshi", "series_sshi", "ssdi", "ssdv"):
        flip = log_uniform(rng, 0.005, 0.03) * 2 * math.pi / omega
        keys |= {"quality": loop, "inductance": (flip / math.pi) ** 2 / capacitance}
        keys["on_time_error"] = float(rng.choice([0.0, rng.uniform(-0.2, 0.2)]))
    if kind == "ssdv":
        keys["source_voltage"] = 0.05 * voltage * float(rng.uniform())
    if kind != "rectifier":
        keys["phase_lag"] = float(rng.choice([0.0, rng.uniform(-0.2, 0.2)]))
    optimum = {
        "rectifier": math.pi / 2,
        "parallel_sshi": math.pi / (1 - q),
        "series_sshi": math.pi * (1 - q) / (2 * (1 + q)),
    }
    if kind in optimum:
        load = factor * optimum[kind] / (capacitance * omega)
        keys |= {"load_resistance": load, "smoothing_capacitance": log_uniform(rng, 5.0, 100.0) / (omega * load)}
        keys["diode_drop"] = float(rng.choice([0.0, 0.02 * voltage * rng.uniform()]))
    return keys
