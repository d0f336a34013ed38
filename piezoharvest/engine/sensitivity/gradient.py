"""Gradient of power and amplitudes at the periodic steady state with respect to every quantity of the model.

The orbit is followed from event to event. Within a mode the derivative of the matrix exponential is exact; at an event
the derivatives jump, as its time depends on the quantities (saltation); the derivative of the orbit's initial state
follows from the monodromy matrix. The derivatives of the matrices come from a complex step through the lowering, so
that no difference of two simulations is used. Sources: Leine & Nijmeijer, Dynamics and Bifurcations of Non-Smooth
Mechanical Systems, 2004 (saltation); Hiskens & Pai, IEEE Trans. Circuits Syst. I 47(2), 204-220, 2000 (trajectory
sensitivities of hybrid systems); Squire & Trapp, SIAM Review 40(1), 1998 (complex step).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import COMPLEX_STEP, Component
from piezoharvest.description.system import System
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.sensitivity.dual_modes import nominal
from piezoharvest.engine.sensitivity.orbit import record_span
from piezoharvest.engine.sensitivity.variation import Variation
from piezoharvest.engine.simulation import search
from piezoharvest.engine.steady_search import EngineError
from piezoharvest.engine.work_limit import Budget
from piezoharvest.equations.terms import Terms


@dataclass(frozen=True)
class Gradient:
    """Power and amplitudes of a periodic steady state with their derivatives.

    Attributes
    ----------
    quantities : tuple of str
        Quantities of the derivatives, as paths: "transducer.mass", "shunt.load_resistance", "excitation.frequency".
    values : (p,) array
        Their values, SI.
    harvested_power, displacement_amplitude, voltage_amplitude : float
        W, m, V.
    by : dict of (p,) array
        Derivatives of the three, by their names: W, m or V per unit of each quantity.
    """

    quantities: tuple[str, ...]
    values: np.ndarray
    harvested_power: float
    displacement_amplitude: float
    voltage_amplitude: float
    by: dict[str, np.ndarray]


class NoGradientError(ArithmeticError):
    """There is no periodic steady state to take a gradient at."""


def gradient(system: System, excitation: Excitation, budget: Budget | None = None) -> Gradient:
    """Gradient at the periodic steady state that `simulate` finds.

    Parameters
    ----------
    system : System
    excitation : Excitation
        Periodic. The gradient includes its own quantities if it is one sine.
    budget : Budget, optional
        Work limit, from which the work done is subtracted; default that of one simulation.

    Returns
    -------
    Gradient

    Raises
    ------
    NoGradientError
        There is no periodic steady state, or a motion in it cannot be resolved.
    """
    if excitation.period is None:
        raise NoGradientError(f"{excitation.kind} has no period")
    if Terms(system.transducer).elements:
        raise NoGradientError("the transducer has effects that are nonlinear between events")
    if system.shunt.multiplied:
        raise NoGradientError(f"{system.shunt.kind} is nonlinear between events")
    switch = system.shunt.switch(system.electrode.capacitance, excitation.period)
    if switch is not None and switch.clocked:
        raise NoGradientError(f"{system.shunt.kind} has its own clock")
    batch = lower(*stepped(system, excitation))
    # One lowering is used for both: the real parts of the complex steps are the design itself.
    lowered = batch._replace(program=nominal(batch.program), budget=budget or batch.budget)
    try:
        orbit, mirrored, _, _, settles = search(lowered, excitation)
        if not settles:
            raise NoGradientError("no periodic steady state was found")
        tape = record_span(lowered, orbit, mirrored)
        names, values = zip(*quantities(system, excitation), strict=True)
        variation = Variation(tape, batch.program, len(names))
        found = {
            "harvested_power": variation.power(),
            "displacement_amplitude": variation.amplitude(pg.DISPLACEMENT),
            "voltage_amplitude": variation.amplitude(pg.VOLTAGE),
        }
    except EngineError as error:
        raise NoGradientError(str(error)) from None
    by = {name: result.change for name, result in found.items()}
    if mirrored and "excitation.offset" in names:
        # An offset breaks the symmetry that the search used; for the same reason neither power nor amplitudes depend on
        # it to first order.
        for change in by.values():
            change[names.index("excitation.offset")] = 0.0
    return Gradient(names, np.array(values), **{name: float(result.value) for name, result in found.items()}, by=by)


def quantities(system: System, excitation: Excitation) -> list[tuple[str, float]]:
    """Paths and values of the quantities of a system and an excitation, in the order of `stepped`."""
    parts: list[tuple[str, Component]] = [("transducer", system.transducer), ("shunt", system.shunt)]
    if excitation.batched:
        parts.append(("excitation", excitation))
    return [pair for name, part in parts for pair in _within(part, name)]


def _within(part: Component, prefix: str) -> list[tuple[str, float]]:
    found = []
    for field in dataclasses.fields(part):
        value, path = getattr(part, field.name), f"{prefix}.{field.name}"
        if isinstance(value, Component):
            found += _within(value, path)
        elif isinstance(value, tuple):
            for n, item in enumerate(value):
                inner = f"{path}.{getattr(item, 'name', n)}"
                found += _within(item, inner) if isinstance(item, Component) else _number(field, inner, item)
        else:
            found += _number(field, path, value)
    return found


def _number(field: dataclasses.Field, path: str, value: Any) -> list[tuple[str, float]]:
    numeric = "unit" in field.metadata and isinstance(value, int | float | np.number) and not isinstance(value, bool)
    other_law = numeric and field.metadata.get("other_law_at_zero") and value == 0
    return [(path, float(value))] if numeric and not other_law else []


def stepped(system: System, excitation: Excitation) -> tuple[System, Excitation]:
    """Batch of designs, each with a complex step of one quantity."""
    count = len(quantities(system, excitation))
    columns = iter(np.eye(count)[:, :, None])

    def step(part: Any) -> Any:
        changes = {}
        for field in dataclasses.fields(part):
            value = getattr(part, field.name)
            if isinstance(value, Component):
                changes[field.name] = step(value)
            elif isinstance(value, tuple):
                changes[field.name] = tuple(
                    step(item) if isinstance(item, Component) else moved(field, item) for item in value
                )
            else:
                changes[field.name] = moved(field, value)
        return dataclasses.replace(part, **changes)

    def moved(field: dataclasses.Field, value: Any) -> Any:
        return value + 1j * COMPLEX_STEP * next(columns) if _number(field, "", value) else value

    transducer, shunt = step(system.transducer), step(system.shunt)
    return System(transducer, shunt), step(excitation) if excitation.batched else excitation
