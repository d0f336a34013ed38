"""Every effect of the vocabulary on the four tables: alone, and beside the leak and the joint of the extended model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from reports.paper import quasi_static as qs
from reports.paper.candidates import (
    ABSENT,
    EXTENDED,
    Candidate,
    Choice,
    Parameters,
    Predicted,
    contact,
    forces,
    resistances,
)
from reports.paper.tables import Row, experiment

_HUM = 2 * np.pi * 50.0  # rad/s
_PHASES = np.sin(2 * np.pi * np.arange(16) / 16)


class Effect(NamedTuple):
    """An effect of the vocabulary: the parameters that it frees, in each form that it may take here."""

    name: str
    forms: tuple[tuple[str, ...], ...]


# What can be seen in two numbers a row. `bias_current` and the falling drift raise or lower energies, not their sign.
EFFECTS = (
    Effect("leakage", (("leak",),)),
    Effect("dielectric_relaxation", (("slow_capacitance", "slow_time"),)),
    Effect("voltage_dependent_capacitance", (("beta_rising",), ("beta_falling",))),
    Effect("creep", (("creep", "creep_time"),)),
    Effect("stiffening", (("cubic",),)),
    Effect("contact_compliance", (("hertz",),)),
    Effect("friction", (("friction", "friction_force"),)),
    Effect("nonlinear_coupling", (("quadratic_rising",), ("quadratic_falling",))),
    Effect("coupling_drift", (("drift",),)),
    Effect("bias_current", (("bias",),)),
    Effect("displacement_lag", (("lag",),)),
    Effect("clipping", (("clip",),)),
    Effect("mains_hum", (("hum_voltage",), ("hum_current",), ("hum_displacement",))),
    Effect("load_error", (("load_1",), ("load_2",), ("load_3",))),
)
# On which no printed number depends, whatever its size.
UNSEEN = ("channel_skew",)
JOINT = ("seat", "seat_force")
BASE = tuple(name for name in EXTENDED.free if name not in (*JOINT, "leak"))


def candidate(base: Sequence[str], effect: Effect | None = None, form: int = 0) -> Candidate:
    """Parameters to be fitted to all four tables: those of a base, and an effect in one of its forms."""
    added = effect.forms[form] if effect else ()
    return Candidate(effect.name if effect else "none", (*base, *(n for n in added if n not in base)), predict)


def predict(p: Parameters, chosen: Sequence[Row], choice: Choice) -> Predicted:
    """Rows of all four tables under every effect of `p`."""
    p = {**ABSENT, **p}
    high, is_step, _ = forces(p, chosen)
    frequency = np.array([row.frequency or 0.0 for row in chosen])
    low = np.where(is_step, choice.step_from, choice.sine_from)
    driven = qs.drive(low, high, frequency, p["rise_time"], experiment()["hold_s"])
    load = resistances(p, chosen, choice)
    beta = p["beta_rising"] - p["beta_falling"]
    node = qs.Node(1 / load + 1 / p["leak"], p["capacitance"], beta, p["slow_capacitance"], p["slow_time"])
    strain = _strain(p, driven)
    bend = p["quadratic_rising"] - p["quadratic_falling"]
    v = qs.voltage(driven, p["charge"] * strain * (1 + bend * strain), node)
    electrical = np.array([row.table in ("I", "II") for row in chosen])
    powers = np.where(electrical, _electrical(p, driven, v, load), _mechanical(p, driven, strain, v))
    cycles = np.where(is_step, np.where(electrical, p["step_cycles"], p["stroke_cycles"]), frequency * p["record"])
    return cycles * powers[0], powers[1]


def _strain(p: Parameters, driven: qs.Drive) -> np.ndarray:
    """Displacement of the specimen times k: the force, less what stiffening and friction hold, and what creeps (N)."""
    own = driven.force * (1 - p["cubic"] * driven.force**2)
    if p["friction"]:
        stuck = p["friction"] / (1 + p["friction"])
        own = own - stuck * (driven.force - qs.play(driven.force, p["friction_force"]))
    return own + p["creep"] * qs.delayed(driven, own, p["creep_time"]) if p["creep"] else own


def _electrical(p: Parameters, driven: qs.Drive, v: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Energy of a cycle (J) and peak power (W), (2, rows), as the channels of voltage and current show them."""
    current = v / load[:, None]
    read = np.clip(v, -p["clip"], p["clip"])
    bias = p["bias"] / (1 / load + 1 / p["leak"])
    energy = np.trapezoid(read * current, driven.time, axis=1) + bias**2 / load * np.ptp(driven.time, axis=1)
    # T falls in proportion to time: its square, and with it the power, has this mean.
    energy *= 1 - p["drift"] + p["drift"] ** 2 / 3
    largest = (np.max(np.abs(read), axis=1) + bias) * (np.max(np.abs(current), axis=1) + bias / load)
    largest += p["hum_voltage"] * np.max(np.abs(current), axis=1) + p["hum_current"] * np.max(np.abs(v), axis=1)
    return np.stack((energy, largest))


def _mechanical(p: Parameters, driven: qs.Drive, strain: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Integral of |F x'| over a cycle (J) and peak of F x' (W), (2, rows), as the displacement sensor shows them."""
    joint = contact({**p, "cubic": 0.0}).displacement(driven.force) - driven.force / p["stiffness"]
    reading = strain / p["stiffness"] + joint - p["charge"] * v
    if p["lag"]:
        reading = qs.delayed(driven, reading, p["lag"])
    step, force = np.diff(driven.time, axis=1), 0.5 * (driven.force[:, 1:] + driven.force[:, :-1])
    velocity = np.diff(reading, axis=1) / step
    hum = _HUM * p["hum_displacement"]
    swept = np.mean(np.abs(velocity[..., None] + hum * _PHASES), axis=-1) if hum else np.abs(velocity)
    power = np.max(force * velocity, axis=1) + hum * np.max(force, axis=1)
    return np.stack((np.sum(force * swept * step, axis=1), p["peak_factor"] * power))
