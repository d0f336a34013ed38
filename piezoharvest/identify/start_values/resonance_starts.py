"""Transducers whose modes are at the resonances of measured frequency responses, as starts of a fit.

If a mode is off a sharp resonance by more than its width, the cost is flat there and falls towards minima without the
peak. So nominal values are moved to the resonances first. A free impedance gives more: in its charge over voltage,
C + sum T_i^2/(k_i + s b_i + s^2 m_i), every residue is that of a mode.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import Short
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.measured_responses import FrequencyData, sticking_rates
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.frequency.resonances import MeasuredResonances
from piezoharvest.predict.parameters import put, value_at
from piezoharvest.records.reading.channels import RATES

EXTRA_RESONANCES = 3  # resonances beyond the number of modes that are tried
MAX_STARTS = 6  # most starts from one record
SCALING_ROUNDS, MAX_SCALE = 3, 30.0  # rounds of scaling to the measured magnitude, and ratio beyond which it is left
# Rounds of moving a mode's pole, and relative tolerance to the measured pole.
POLE_ITERATIONS = 60
POLE_TOLERANCE = 1e-13
# Least share of a pole's damping that the mode itself has: by nominal values, the circuit may seem to cause all.
MIN_MODE_DAMPING = 0.1


def transducers_at_resonances(
    data: Sequence[FrequencyData], nominal: Transducer, order: Transducer
) -> Iterator[Transducer]:
    """Transducers with modes at the resonances of the records, the most likely of each record first.

    Parameters
    ----------
    data : sequence of FrequencyData
        Impedances are the most informative, and are used first.
    nominal : Transducer
        Values of all other parameters.
    order : Transducer
        Transducer whose modes have the required order over frequency.
    """
    for each in sorted(data, key=lambda one: (one.record.kind != "impedance", -len(one))):
        if each.reference is None or each.record.mechanical == "blocked":
            continue
        shown = each.reference.resonances
        for chosen in _assignments(shown.poles, order):
            for unchanged in ("stiffness", "mass"):
                try:
                    found = _with_poles(each, shown, nominal, chosen, unchanged)
                except (ParameterError, np.linalg.LinAlgError):
                    continue
                if found is not None:
                    yield found


def _assignments(poles: np.ndarray, nominal: Transducer) -> list[dict[int, int]]:
    """Assignments of modes to resonances, by index, the most likely first.

    Modes keep their order over frequency; if a record shows fewer resonances, the nearest nominal modes are assigned.
    """
    modes = nominal.all_modes
    near = list(range(min(len(poles), len(modes) + EXTRA_RESONANCES)))
    wanted = np.array([np.sqrt(mode.stiffness / mode.mass) for mode in modes])
    count = min(len(near), len(modes))
    found = []
    for some in combinations(range(len(near)), count):
        ordered = sorted((near[n] for n in some), key=lambda k: abs(poles[k]))
        for which in combinations(np.argsort(wanted, kind="stable").tolist(), count):
            far = sum(abs(np.log(abs(poles[k]) / wanted[mode])) for k, mode in zip(ordered, which, strict=True))
            found.append((sum(some), far, dict(zip(which, ordered, strict=True))))
    found.sort(key=lambda one: one[:2])
    return [chosen for *_, chosen in found[:MAX_STARTS]] if count else []


def _with_poles(
    data: FrequencyData, found: MeasuredResonances, nominal: Transducer, chosen: dict[int, int], unchanged: str
) -> Transducer | None:
    """Transducer with some modes at some resonances; `unchanged` says whether stiffness or mass is kept."""
    targets = {mode: complex(found.poles[k]) for mode, k in chosen.items()}
    if data.record.kind != "impedance":
        device = nominal
        for _ in range(SCALING_ROUNDS):
            device = _scaled_to_magnitude(
                data,
                _with_coupled_poles(data, device, targets, unchanged),
                list(targets),
                found.poles[list(chosen.values())],
            )
        return _with_coupled_poles(data, device, targets, unchanged)
    device = nominal
    for mode, pole in targets.items():
        device = _with_uncoupled_pole(device, mode, pole, unchanged)
        # The residue of T^2/m / (s^2 + ...) is T^2/m over twice the imaginary part of the pole.
        square = float(np.real(2j * pole.imag * found.residues[chosen[mode]])) * _value(device, mode, "mass")
        if square <= 0:
            return None
        device = _put(device, mode, coupling=float(np.copysign(np.sqrt(square), _value(nominal, mode, "coupling"))))
    return replace(device, capacitance=found.direct) if found.direct > 0 else device


def _with_uncoupled_pole(device: Transducer, mode: int, pole: complex, unchanged: str) -> Transducer:
    """Transducer with one mode moved to a pole, for shorted electrodes and without coupling to other modes."""
    square = abs(pole) ** 2
    stiffness, mass = _value(device, mode, "stiffness"), _value(device, mode, "mass")
    stiffness, mass = (stiffness, stiffness / square) if unchanged == "stiffness" else (mass * square, mass)
    return _put(device, mode, stiffness=stiffness, mass=mass, damping=-2.0 * pole.real * mass)


def _with_coupled_poles(
    data: FrequencyData, device: Transducer, targets: dict[int, complex], unchanged: str
) -> Transducer:
    """Transducer with some modes moved to poles, including the effect of the circuit of the measurement."""
    for mode, pole in targets.items():
        device = _with_uncoupled_pole(device, mode, pole, unchanged)
    if data.record.input == "voltage" or isinstance(data.record.shunt, Short):
        return device
    for _ in range(POLE_ITERATIONS):
        rates, states = sticking_rates(data, device)
        values, vectors = np.linalg.eig(rates)
        off = 0.0
        for mode, pole in targets.items():
            # States are scaled to the root of energy: the mode's eigenvector has most energy in its own states.
            own = np.abs(vectors[[states.index(f"x{mode + 1}"), states.index(f"u{mode + 1}")]]) ** 2
            here = values[np.argmax(np.where(np.imag(values) > 0, own.sum(axis=0), -1.0))]
            off = max(off, abs(here / pole - 1.0))
            device = _with_shifted_pole(device, mode, here, pole, unchanged)
        if off < POLE_TOLERANCE:
            break
    return device


def _scaled_to_magnitude(
    data: FrequencyData, device: Transducer, modes: Sequence[int], poles: np.ndarray
) -> Transducer:
    """Transducer scaled so that its response is about as large as the measured one at its resonances.

    Electrical responses grow with the coupling; a displacement by a force falls with mass, damping and stiffness.
    """
    record = data.record
    value, _ = data.response(Model(device, (), ()))
    near = [np.argmin(np.abs(2.0 * np.pi * record.frequency - abs(pole))) for pole in poles]
    ratio = float(np.exp(np.mean(np.log(np.abs(record.response[near]) / np.abs(value[near])))))
    if not 1.0 / MAX_SCALE < ratio < MAX_SCALE:
        return device
    for mode in modes:
        if record.output in ("displacement", *RATES) and record.input != "voltage":
            if record.input == "base_acceleration" and _value(device, mode, "effective_mass") is None:
                continue  # its inertial drive grows with the mass
            shares = {key: _value(device, mode, key) / ratio for key in ("mass", "damping", "stiffness")}
            device = _put(device, mode, **shares)
        else:
            # A current by a voltage is proportional to the square of the coupling.
            twice = record.input == "voltage" and record.output == "current"
            device = _put(device, mode, coupling=_value(device, mode, "coupling") * ratio ** (0.5 if twice else 1.0))
    return device


def _with_shifted_pole(device: Transducer, mode: int, here: complex, pole: complex, unchanged: str) -> Transducer:
    """Transducer with one mode shifted by the error of its pole."""
    ratio = float(abs(pole) / abs(here)) ** 2
    stiffness, mass, damping = (_value(device, mode, key) for key in ("stiffness", "mass", "damping"))
    stiffness, mass = (stiffness, mass / ratio) if unchanged == "stiffness" else (stiffness * ratio, mass)
    wanted = damping + 2.0 * mass * (here.real - pole.real)
    return _put(
        device, mode, stiffness=stiffness, mass=mass, damping=max(wanted, MIN_MODE_DAMPING * -2.0 * pole.real * mass)
    )


def _value(device: Transducer, mode: int, key: str) -> Any:
    return value_at(device, _path(mode, key))


def _put(device: Transducer, mode: int, **values: float) -> Transducer:
    for key, value in values.items():
        device = put(device, _path(mode, key), value)
    return device


def _path(mode: int, key: str) -> tuple[str | int, ...]:
    return (key,) if mode == 0 else ("modes", mode - 1, key)
