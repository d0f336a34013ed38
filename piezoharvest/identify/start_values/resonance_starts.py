"""Transducers whose modes stand where measured frequency responses show resonances, as starts of a fit.

Off a sharp resonance by more than its width, a fit sees none of it: the cost is flat there and falls towards minima
that do without the peak. So nominal values are moved there first. An impedance of the free leads tells more: of its
charge over voltage, C + sum T_i^2/(k_i + s b_i + s^2 m_i), every residue is that of a mode.
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

STRONGEST = 3  # resonances more than there are modes, that a mode is tried at
STARTS = 6  # at most of a record
SIZINGS, WRONG = 3, 30.0  # rounds of making it as large as the response, and by how much more it is another one
TURNS, TUNED = 60, 1e-13  # rounds of moving a mode's values, and how near its pole comes to the one measured
# Of the damping of a pole, that the mode itself has: with nominal values the circuit may seem to have it all.
LEAST = 0.1


def tuned(data: Sequence[FrequencyData], nominal: Transducer, order: Transducer) -> Iterator[Transducer]:
    """Transducers with modes where the records show resonances, the likeliest of each record first.

    Parameters
    ----------
    data : sequence of FrequencyData
        Those of an impedance tell most, and come first.
    nominal : Transducer
        What else stays.
    order : Transducer
        Whose modes are in the order that they are to have over frequency.
    """
    for each in sorted(data, key=lambda one: (one.record.kind != "impedance", -len(one))):
        if each.reference is None or each.record.mechanical == "blocked":
            continue
        shown = each.reference.resonances
        for chosen in _assigned(shown.poles, order):
            for held in ("stiffness", "mass"):
                try:
                    found = _of_poles(each, shown, nominal, chosen, held)
                except (ParameterError, np.linalg.LinAlgError):
                    continue
                if found is not None:
                    yield found


def _assigned(poles: np.ndarray, nominal: Transducer) -> list[dict[int, int]]:
    """Which resonance a mode may be, by their numbers, the likeliest first.

    Modes keep their order over frequency; where a record shows fewer, the nearest ones of the nominal modes are meant.
    """
    modes = nominal.all_modes
    near = list(range(min(len(poles), len(modes) + STRONGEST)))
    wanted = np.array([np.sqrt(mode.stiffness / mode.mass) for mode in modes])
    count = min(len(near), len(modes))
    found = []
    for some in combinations(range(len(near)), count):
        ordered = sorted((near[n] for n in some), key=lambda k: abs(poles[k]))
        for which in combinations(np.argsort(wanted, kind="stable").tolist(), count):
            far = sum(abs(np.log(abs(poles[k]) / wanted[mode])) for k, mode in zip(ordered, which, strict=True))
            found.append((sum(some), far, dict(zip(which, ordered, strict=True))))
    found.sort(key=lambda one: one[:2])
    return [chosen for *_, chosen in found[:STARTS]] if count else []


def _of_poles(
    data: FrequencyData, found: MeasuredResonances, nominal: Transducer, chosen: dict[int, int], held: str
) -> Transducer | None:
    """Transducer with some modes at some resonances, one of stiffness and mass being kept."""
    targets = {mode: complex(found.poles[k]) for mode, k in chosen.items()}
    if data.record.kind != "impedance":
        device = nominal
        for _ in range(SIZINGS):
            device = _sized(
                data, _moved(data, device, targets, held), list(targets), found.poles[list(chosen.values())]
            )
        return _moved(data, device, targets, held)
    device = nominal
    for mode, pole in targets.items():
        device = _placed(device, mode, pole, held)
        # Of T^2/m / (s^2 + ...) the residue is T^2/m over twice the imaginary part of the pole.
        square = float(np.real(2j * pole.imag * found.residues[chosen[mode]])) * _value(device, mode, "mass")
        if square <= 0:
            return None
        device = _put(device, mode, coupling=float(np.copysign(np.sqrt(square), _value(nominal, mode, "coupling"))))
    return replace(device, capacitance=found.direct) if found.direct > 0 else device


def _placed(device: Transducer, mode: int, pole: complex, held: str) -> Transducer:
    """Transducer whose mode by itself, its electrodes shorted, has a pole."""
    square = abs(pole) ** 2
    stiffness, mass = _value(device, mode, "stiffness"), _value(device, mode, "mass")
    stiffness, mass = (stiffness, stiffness / square) if held == "stiffness" else (mass * square, mass)
    return _put(device, mode, stiffness=stiffness, mass=mass, damping=-2.0 * pole.real * mass)


def _moved(data: FrequencyData, device: Transducer, targets: dict[int, complex], held: str) -> Transducer:
    """Transducer some of whose modes have poles beside the circuit that they are measured with."""
    for mode, pole in targets.items():
        device = _placed(device, mode, pole, held)
    if data.record.input == "voltage" or isinstance(data.record.shunt, Short):
        return device
    for _ in range(TURNS):
        rates, states = sticking_rates(data, device)
        values, vectors = np.linalg.eig(rates)
        off = 0.0
        for mode, pole in targets.items():
            # States are scaled to the root of energy: the mode's own motion is where most of it is.
            own = np.abs(vectors[[states.index(f"x{mode + 1}"), states.index(f"u{mode + 1}")]]) ** 2
            here = values[np.argmax(np.where(np.imag(values) > 0, own.sum(axis=0), -1.0))]
            off = max(off, abs(here / pole - 1.0))
            device = _shifted(device, mode, here, pole, held)
        if off < TUNED:
            break
    return device


def _sized(data: FrequencyData, device: Transducer, modes: Sequence[int], poles: np.ndarray) -> Transducer:
    """Transducer whose response is about as large as the measured one at its resonances.

    What electrodes show grows with the coupling; a displacement by a force falls with mass, damping and stiffness.
    """
    record = data.record
    value, _ = data.response(Model(device, (), ()))
    near = [np.argmin(np.abs(2.0 * np.pi * record.frequency - abs(pole))) for pole in poles]
    ratio = float(np.exp(np.mean(np.log(np.abs(record.response[near]) / np.abs(value[near])))))
    if not 1.0 / WRONG < ratio < WRONG:
        return device
    for mode in modes:
        if record.output == "displacement" and record.input != "voltage":
            if record.input == "base_acceleration" and _value(device, mode, "effective_mass") is None:
                continue  # what drives it grows as it does
            shares = {key: _value(device, mode, key) / ratio for key in ("mass", "damping", "stiffness")}
            device = _put(device, mode, **shares)
        else:
            # The current of a voltage goes through the coupling twice.
            twice = record.input == "voltage" and record.output == "current"
            device = _put(device, mode, coupling=_value(device, mode, "coupling") * ratio ** (0.5 if twice else 1.0))
    return device


def _shifted(device: Transducer, mode: int, here: complex, pole: complex, held: str) -> Transducer:
    """Transducer whose mode is moved by as much as its pole is off."""
    ratio = float(abs(pole) / abs(here)) ** 2
    stiffness, mass, damping = (_value(device, mode, key) for key in ("stiffness", "mass", "damping"))
    stiffness, mass = (stiffness, mass / ratio) if held == "stiffness" else (stiffness * ratio, mass)
    wanted = damping + 2.0 * mass * (here.real - pole.real)
    return _put(device, mode, stiffness=stiffness, mass=mass, damping=max(wanted, LEAST * -2.0 * pole.real * mass))


def _value(device: Transducer, mode: int, key: str) -> Any:
    return value_at(device, _path(mode, key))


def _put(device: Transducer, mode: int, **values: float) -> Transducer:
    for key, value in values.items():
        device = put(device, _path(mode, key), value)
    return device


def _path(mode: int, key: str) -> tuple[str | int, ...]:
    return (key,) if mode == 0 else ("modes", mode - 1, key)
