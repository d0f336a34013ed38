"""Candidate explanations of the tables: which parameters each frees on top of Table V, and what it predicts.

All parameters are positive; one that is not free has the value at which what it describes is absent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from piezoharvest import Leakage, SineForce, StepForce, simulate
from reports.paper import closed_form as cf
from reports.paper.model import hysteresis, loaded, table_value, transducer
from reports.paper.tables import Row, experiment

Parameters = dict[str, float]
Predicted = tuple[np.ndarray, np.ndarray]  # energies as printed (J, summed) and peak powers (W)

# Absent, or as in Table V. Printed energies are summed over `record` (s) of a sine, and over `step_cycles` (Table I) or
# `stroke_cycles` (Table III) of the steps; `force_750` is the force at the 0.75 kN level over its label, `load_1` ... a
# load over its label, `peak_factor` what noise adds to mechanical peaks.
ABSENT: Parameters = {
    "charge": table_value("T") / table_value("k"),
    "capacitance": table_value("C") + table_value("T") ** 2 / table_value("k"),
    "stiffness": table_value("k"), "leak": 1e12, "slow_capacitance": 1e-18, "slow_time": 0.3,
    "rise_time": 1e-3, "step_cycles": 1.0, "stroke_cycles": 1.0, "record": 10.0, "peak_factor": 1.0, "force_750": 1.0,
    "load_1": 1.0, "load_2": 1.0, "load_3": 1.0, "hertz": 0.0, "seat": 0.0, "seat_force": 100.0, "cubic": 0.0,
    "beta_rising": 0.0, "beta_falling": 0.0, "creep": 0.0, "creep_time": 1.0, "friction": 0.0, "friction_force": 50.0,
    "quadratic_rising": 0.0, "quadratic_falling": 0.0, "drift": 0.0, "bias": 0.0, "lag": 0.0, "clip": 1e3,
    "hum_voltage": 0.0, "hum_current": 0.0, "hum_displacement": 0.0,
}  # fmt: skip
# Where searches begin for what is free.
START: Parameters = {
    **ABSENT, "leak": 3e5, "slow_capacitance": 1e-6, "rise_time": 0.03, "step_cycles": 8.0, "stroke_cycles": 12.0,
    "hertz": 1e-8, "seat": 1e-6, "seat_force": 200.0, "cubic": 1e-7,
    "beta_rising": 1e-3, "beta_falling": 1e-4, "creep": 0.1, "friction": 0.3, "friction_force": 50.0,
    "quadratic_rising": 1e-4, "quadratic_falling": 1e-4, "drift": 0.1, "bias": 1e-6, "lag": 5e-3, "clip": 10.0,
    "hum_voltage": 0.05, "hum_current": 1e-6, "hum_displacement": 1e-8,
}  # fmt: skip
# N/m: far below resonance only d and the free capacitance matter electrically; so soft, any pair of them is passive.
_SOFT = 1e7
_HELD = 2.0  # s: less than the five of the experiment, but the energy that is then left is below 1e-3 with every load


class Choice(NamedTuple):
    """What the paper leaves open: the sines' load (its number), and from which force (N) each excitation starts."""

    sine_load: int = 1
    sine_from: float = 100.0
    step_from: float = 0.0


PUBLISHED = Choice()  # Table V's load, and the starts of the forces that section III gives


@dataclass(frozen=True)
class Candidate:
    """An explanation.

    Attributes
    ----------
    name : str
    free : tuple of str
        Names of the free parameters.
    predict : callable
        Parameters, rows and choice to energies (J, summed as printed) and peak powers (W).
    choice : Choice
    """

    name: str
    free: tuple[str, ...]
    predict: Callable[[Parameters, Sequence[Row], Choice], Predicted]
    choice: Choice = PUBLISHED


def forces(p: Parameters, chosen: Sequence[Row]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Largest force (N) of each row, which rows are steps, and the frequencies (Hz) of the others."""
    force = np.array([row.force * (p["force_750"] if row.force == 750.0 else 1.0) for row in chosen])
    is_step = np.array([row.frequency is None for row in chosen])
    return force, is_step, np.array([row.frequency for row in chosen if row.frequency is not None])


def resistances(p: Parameters, chosen: Sequence[Row], choice: Choice) -> np.ndarray:
    """Resistance in the circuit of each row, ohm."""
    labels = experiment()["loads_ohm"]
    number = [choice.sine_load if row.load is None else labels.index(row.load) for row in chosen]
    return np.array([labels[n] * p[f"load_{n + 1}"] for n in number]) + experiment()["shunt_ohm"]


def _circuit(p: Parameters) -> cf.Circuit:
    return cf.Circuit(p["charge"], p["capacitance"], 1 / p["leak"], p["slow_capacitance"], p["slow_time"])


def linear(p: Parameters, chosen: Sequence[Row], choice: Choice) -> Predicted:
    """Rows of Tables I and II from the closed forms."""
    circuit, load = _circuit(p), resistances(p, chosen, choice)
    force, is_step, frequency = forces(p, chosen)
    result = np.empty((2, len(chosen)))
    height, amplitude = force[is_step] - choice.step_from, 0.5 * (force[~is_step] - choice.sine_from)
    result[:, is_step] = cf.step(circuit, height, load[is_step], p["rise_time"], experiment()["hold_s"])
    result[:, ~is_step] = cf.sine(circuit, amplitude, frequency, load[~is_step])
    result[0, is_step] *= p["step_cycles"]
    result[0, ~is_step] *= frequency * p["record"]
    return result[0], result[1]


def hysteretic(reading: str) -> Callable[[Parameters, Sequence[Row], Choice], Predicted]:
    """Rows of Tables I and II from the engine, with the published hysteresis in one of its readings."""

    def predict(p: Parameters, chosen: Sequence[Row], choice: Choice) -> Predicted:
        coupling = p["charge"] * _SOFT
        device = transducer(
            stiffness=_SOFT, coupling=coupling, capacitance=p["capacitance"] - coupling * p["charge"],
            hysteresis=hysteresis(reading), effects=(Leakage(resistance=p["leak"]),),
        )  # fmt: skip
        force, _, _ = forces(p, chosen)
        load = resistances(p, chosen, choice) - experiment()["shunt_ohm"]
        pairs = [_engine_row(device, p, *item, choice) for item in zip(chosen, force, load, strict=True)]
        return tuple(np.array(pairs).T)  # pyright: ignore[reportReturnType]

    return predict


def _engine_row(device, p: Parameters, row: Row, force: float, load: float, choice: Choice) -> tuple[float, float]:
    system = loaded(device, load)
    if row.frequency is None:
        height = force - choice.step_from
        pulse = StepForce(amplitude=height, duration=_HELD, rise_time=p["rise_time"], offset=choice.step_from)
        response, cycles = simulate(system, pulse, samples=1250), p["step_cycles"]
    else:
        amplitude, offset = 0.5 * (force - choice.sine_from), 0.5 * (force + choice.sine_from)
        wave = SineForce(amplitude=amplitude, offset=offset, frequency=row.frequency)
        response, cycles = simulate(system, wave, samples=128), p["record"] * row.frequency
    assert response.waveforms is not None
    peak = np.max(response.waveforms.voltage * response.waveforms.current)
    return cycles * response.energy["harvested"], float(peak)


def contact(p: Parameters) -> cf.Contact:
    """Specimen and joint as the displacement sensor sees them."""
    return cf.Contact(1 / p["stiffness"], p["hertz"], p["seat"], p["seat_force"], p["cubic"])


def mechanical(p: Parameters, chosen: Sequence[Row], choice: Choice) -> Predicted:
    """Rows of Tables III and IV, with mechanical power counted by magnitude."""
    both, load = (contact(p), _circuit(p)), resistances(p, chosen, choice)
    force, is_step, frequency = forces(p, chosen)
    result = np.empty((2, len(chosen)))
    low = np.full(len(frequency), choice.sine_from)
    result[:, is_step] = cf.step_by_magnitude(*both, force[is_step], load[is_step], p["rise_time"])
    result[:, ~is_step] = cf.sine_by_magnitude(*both, low, force[~is_step], frequency, load[~is_step])
    result[0, is_step] *= p["stroke_cycles"]
    result[0, ~is_step] *= frequency * p["record"]
    return result[0], result[1] * p["peak_factor"]


def everything(p: Parameters, chosen: Sequence[Row], choice: Choice) -> Predicted:
    """Rows of all four tables."""
    result = np.empty((2, len(chosen)))
    for predict, tables in ((linear, ("I", "II")), (mechanical, ("III", "IV"))):
        own = [n for n, row in enumerate(chosen) if row.table in tables]
        result[:, own] = predict(p, [chosen[n] for n in own], choice)
    return result[0], result[1]


_SUMS = ("step_cycles", "record")
_CIRCUIT = (*_SUMS, "charge", "capacitance")
_SETTING = (*_CIRCUIT, "rise_time", "force_750")

ELECTRICAL = (
    Candidate("Table V, energies summed", ("step_cycles",), linear),
    Candidate("+ coupling and capacitance", _CIRCUIT, linear),
    Candidate("+ rise time of the step", (*_CIRCUIT, "rise_time"), linear),
    Candidate("+ force at 0.75 kN", _SETTING, linear),
    *(Candidate(f"… + load R{n} wrong", (*_SETTING, f"load_{n}"), linear) for n in (1, 2, 3)),
    Candidate("… + leakage", (*_SETTING, "leak"), linear),
    Candidate("… + slow polarisation", (*_SETTING, "slow_capacitance", "slow_time"), linear),
)
HYSTERETIC = tuple(
    Candidate(f"… + leakage, hysteresis of Table V ({reading})", (*_SETTING, "leak"), hysteretic(reading))
    for reading in ("stop", "play")
)
_PEAKS = ("stroke_cycles", "rise_time", "peak_factor", "stiffness")
MECHANICAL = (
    Candidate("Table V, |F x'| summed", _PEAKS[:-1], mechanical),
    Candidate("+ stiffness (or a linear frame)", _PEAKS, mechanical),
    Candidate("+ force at 0.75 kN", (*_PEAKS, "force_750"), mechanical),
    Candidate("… + cubic stiffening of the specimen", (*_PEAKS, "force_750", "cubic"), mechanical),
    Candidate("… + Hertzian joint", (*_PEAKS, "force_750", "hertz"), mechanical),
    Candidate("… + joint that seats", (*_PEAKS, "force_750", "seat", "seat_force"), mechanical),
)
# One set of parameters for all four tables: the extended model of this page.
EXTENDED = Candidate(
    "leakage and joint, one set for all tables",
    (*_SETTING, "leak", "stroke_cycles", "peak_factor", "stiffness", "seat", "seat_force"), everything,
)  # fmt: skip


def with_choices(candidate: Candidate) -> tuple[Candidate, ...]:
    """A candidate with everything that the paper leaves open: three loads of the sines, two starts of either force."""
    return tuple(
        replace(candidate, choice=Choice(load, sine_from, step_from))
        for load in range(3)
        for sine_from in (100.0, 0.0)
        for step_from in (0.0, 100.0)
    )
