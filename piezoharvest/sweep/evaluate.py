"""From the values of a chunk of designs to their answers."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from piezoharvest.excitation import Excitation
from piezoharvest.parameters import Component, ParameterError
from piezoharvest.study import Study
from piezoharvest.sweep.place import place
from piezoharvest.sweep.table import paths, wanted_outputs
from piezoharvest.system import System

Answers = dict[str, np.ndarray]


def evaluate(study: Study, values: np.ndarray) -> Answers:
    """Simulate a chunk of designs with every shunt of the study.

    Parameters
    ----------
    study : Study
    values : (n, p) array
        Values of the swept parameters, a row for each design.

    Returns
    -------
    dict of (n, shunts) array
        "converged" (bool) and the outputs that the study wants; NaN where there is no answer.
    """
    found = [_answers(study, shunt, values) for shunt in range(len(study.shunts))]
    return {name: np.column_stack([answers[name] for answers in found]) for name in found[0]}


def _answers(study: Study, shunt: int, values: np.ndarray) -> Answers:
    """Answers with one shunt.

    A batch that cannot be made is halved down to single designs: those that physics does not allow have no answer, and
    some components can only be made one at a time.
    """
    designs = len(values)
    parts = [*values.T[:, :, np.newaxis]] if designs > 1 else values[0].tolist()
    try:
        found = _simulate_many(*place(study, shunt, paths(study), parts), designs)
    except ValueError as error:
        if designs > 1:
            halves = [_answers(study, shunt, half) for half in (values[: designs // 2], values[designs // 2 :])]
            return {name: np.concatenate([half[name] for half in halves]) for name in halves[0]}
        if not isinstance(error, ParameterError | np.linalg.LinAlgError):
            raise
        found = {"converged": np.zeros(1, bool)}
    converged = np.asarray(found["converged"], bool)
    return {"converged": converged, **{name: _output(found, name) for name in wanted_outputs(study)}}


def _output(found: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """An output; an energy that does not occur is zero wherever there is an answer."""
    if name in found:
        return np.asarray(found[name], float)
    answered = np.isfinite(found.get("energy.mechanical_in", np.full(len(found["converged"]), np.nan)))
    return np.where(answered & name.startswith("energy."), 0.0, np.nan)


# STAND-IN for `piezoharvest.engine.simulate_many`, from here to the end of the file: one design at a time.


def _simulate_many(system: System, excitation: Excitation, designs: int) -> Mapping[str, np.ndarray]:
    rows = [_simulate_one(_design(system, n), _design(excitation, n)) for n in range(designs)]
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}


def _simulate_one(system: System, excitation: Excitation) -> dict[str, Any]:
    from piezoharvest.engine import simulate

    try:
        response = simulate(system, excitation, samples=1)
    except (ParameterError, np.linalg.LinAlgError):
        return {"converged": False}
    if response.waveforms is None:
        return {"converged": False}
    names = (
        "converged", "harvested_power", "mechanical_power", "efficiency", "displacement_amplitude",
        "voltage_amplitude", "dc_voltage", "attenuation_db", "events_per_period",
    )  # fmt: skip
    energy = {"closure" if name == "closure" else f"energy.{name}": value for name, value in response.energy.items()}
    return {**{name: getattr(response, name) for name in names}, **energy}


def _design(part: Any, n: int) -> Any:
    """One design of a batch of components."""
    if isinstance(part, np.ndarray) and part.ndim == 2:
        return float(part[n, 0])
    if isinstance(part, tuple):
        return tuple(_design(inner, n) for inner in part)
    if isinstance(part, Component | System):
        fields = {field.name: getattr(part, field.name) for field in dataclasses.fields(part) if field.init}
        return dataclasses.replace(part, **{name: _design(value, n) for name, value in fields.items()})
    return part
