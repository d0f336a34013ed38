"""Simulation of many designs at once: components with array-valued fields in, columns of results out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import Component
from piezoharvest.description.system import System
from piezoharvest.engine.lowering.lower import Lowered, lower, symmetric
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory.state import QUEUE_LENGTH
from piezoharvest.engine.plausibility import Bounds, bounds, closure, faults, harvest
from piezoharvest.engine.response import figure_of_merit
from piezoharvest.engine.run import Machine
from piezoharvest.engine.simulation import simulate
from piezoharvest.engine.steady_state import many_designs
from piezoharvest.engine.steady_state import section as sc
from piezoharvest.engine.work_limit import MAX_WORK, Budget
from piezoharvest.progress import Stage, silent, watched

DESIGNS_AT_ONCE = 128  # designs whose programs are laid out at one time, so that they fit into the cache
LOG_LENGTH = 512  # events of a span whose times are kept
NAMES = (
    "harvested_power", "mechanical_power", "efficiency", "displacement_amplitude", "voltage_amplitude", "dc_voltage",
    "attenuation_db", "events_per_period", "figure_of_merit",
)  # fmt: skip


def simulate_many(
    system: System,
    excitation: Excitation,
    designs: int,
    *,
    attenuation: bool = True,
    budget: Budget | None = None,
    thorough: bool = True,
    progress: Callable[[str], object] = silent,
) -> Mapping[str, np.ndarray]:
    """Periodic steady states of many designs.

    Parameters
    ----------
    system : System
    excitation : Excitation
        Quantities that differ from design to design are arrays of shape (designs, 1).
    designs : int
    attenuation : bool
        Compare the displacement with that of the short circuit, which is also simulated if the designs differ in more
        than their shunt.
    budget : Budget, optional
        Work limit of all designs together, from which the work done is subtracted; default that of one simulation for
        each. Designs that it does not suffice for are without a solution.
    thorough : bool
        Simulate each design for which the quick search finds no steady state by itself; without, it is left without a
        solution.
    progress : callable, optional
        Takes messages on how far long work is.

    Returns
    -------
    dict of (designs,) array
        `converged` and, as in `Response`, harvested_power and mechanical_power in W, efficiency, displacement_amplitude
        in m, voltage_amplitude and dc_voltage in V, attenuation_db, events_per_period, figure_of_merit,
        periods_evaluated, closure, and the energies of a period in J under names such as "energy.damping". NaN for a
        design without a solution.

    Raises
    ------
    ParameterError
        A component does not allow a value.

    Notes
    -----
    All designs are lowered in one pass and searched one after the other in compiled code. It is not checked that a
    motion from rest with an empty smoothing capacitor reaches the same steady state; `simulate` does, and is used for
    designs for which the search finds none.
    """
    # Whether a supply is on depends on how its store was charged, which a search does not see.
    alone = (_differs(excitation) and not excitation.batched) or getattr(system.shunt, "storage", None) is not None
    budget = budget or Budget(2 * designs * MAX_WORK)  # a design may be searched for twice
    if alone or excitation.period is None or _clocked(system, excitation):
        return _one_by_one(system, excitation, range(designs), designs, budget, progress)
    lowered = lower(system, excitation)._replace(budget=budget)
    kept = _steady_states(lowered, system, symmetric(lowered, excitation), designs, progress)
    found = _columns(lowered, kept, designs, bounds(system.transducer, excitation, lowered))
    left = np.flatnonzero(~found["converged"] & thorough)
    slow = _one_by_one(system, excitation, left, designs, budget, progress)
    for name, column in slow.items():
        found.setdefault(name, np.full(designs, np.nan))[left] = column[left]
    power, moved = found["harvested_power"], found["displacement_amplitude"]
    found["figure_of_merit"] = figure_of_merit(power, moved, system, excitation)
    if attenuation:
        _attenuate(found, system, excitation, designs, progress)
    return found


def _steady_states(
    lowered: Lowered, system: System, mirrored: bool, designs: int, progress: Callable[[str], object]
) -> np.ndarray:
    """Results of the compiled search, one row per design, in the columns defined in `many_designs`."""
    machine = Machine(lowered, ledger=True)
    trial = machine.state(sensitivities=int(machine.L[pg.N]) + QUEUE_LENGTH + 1, ledger=False)
    followed, recorder = machine.state(log=LOG_LENGTH, ledger=False), machine.state(track=True)
    reals, integers = sc.room(machine.L)
    memory = np.zeros(reals), np.zeros(integers, np.int64)
    out = np.zeros((designs, many_designs.ENERGIES + int(machine.L[pg.CATEGORY_COUNT])))
    name, done = f"{system.shunt.kind}: steady states", out[:, many_designs.EVALUATED]
    with watched(progress, name, lambda: np.count_nonzero(done) / designs):
        for begin in range(0, designs, DESIGNS_AT_ONCE):
            rows = out[begin : begin + DESIGNS_AT_ONCE]
            numbers = pg.numbers(pg.part(lowered.program, slice(begin, begin + DESIGNS_AT_ONCE)))
            # C-contiguous and writable: anything else would be another type for numba, and cause another compilation.
            programs = np.array(np.broadcast_to(numbers, (len(rows), numbers.shape[-1])), order="C")
            machine.search_many(trial, followed, recorder, memory, (programs, rows), mirrored)
    return out


def _columns(lowered: Lowered, out: np.ndarray, designs: int, most: Bounds) -> dict[str, np.ndarray]:
    """Results by name from the rows of the compiled search."""
    settled = out[:, many_designs.SETTLED] > 0
    period = np.broadcast_to(lowered.program.period, designs)
    energy = dict(zip(lowered.categories, out[:, many_designs.ENERGIES :].T, strict=True))
    mean_dc = energy.pop(pg.MEAN_DC) / period
    wrong = faults(energy, out[:, many_designs.STORED], 0.0, out[:, many_designs.DISPLACEMENT], most, periodic=True)
    right = settled & ~np.any([*wrong.values()], axis=0)
    harvested, taken = harvest(energy), energy["mechanical_in"]
    energy["harvested"] = harvested
    columns = {
        "harvested_power": harvested / period,
        "mechanical_power": taken / period,
        "efficiency": np.divide(harvested, taken, out=np.full(designs, np.nan), where=taken > 0),
        "displacement_amplitude": out[:, many_designs.DISPLACEMENT],
        "voltage_amplitude": out[:, many_designs.VOLTAGE],
        "dc_voltage": mean_dc,
        "events_per_period": out[:, many_designs.EVENTS],
        "periods_evaluated": out[:, many_designs.EVALUATED],
        "closure": closure(energy, out[:, many_designs.STORED])[0],
        **{f"energy.{name}": value for name, value in energy.items()},
    }
    columns = {name: np.where(settled, column, np.nan) for name, column in columns.items()}
    return {"converged": right, **columns}


def _attenuate(
    found: dict[str, np.ndarray], system: System, excitation: Excitation, designs: int,
    progress: Callable[[str], object],
) -> None:  # fmt: skip
    """Add the attenuation relative to the displacement of the short circuit."""
    shorted = system.shorted
    if _differs(system.transducer) or _differs(excitation):
        several = simulate_many(shorted, excitation, designs, attenuation=False, progress=progress)
        reference = several["displacement_amplitude"]
    else:
        reference = simulate(shorted, excitation, samples=1).displacement_amplitude
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = found["displacement_amplitude"] / reference
        found["attenuation_db"] = np.where(ratio > 0, 20 * np.log10(ratio), np.nan)


def _one_by_one(
    system: System, excitation: Excitation, which: Any, designs: int, budget: Budget,
    progress: Callable[[str], object],
) -> dict[str, np.ndarray]:  # fmt: skip
    """Results of the designs `which`, each found by `simulate`."""
    columns: dict[str, np.ndarray] = {}
    for n in Stage(progress, f"{system.shunt.kind}: steady states one by one", "designs").over(which):
        allowed = max(min(MAX_WORK, budget.left), 0)
        own = Budget(allowed)
        response = simulate(one_of(system, n), one_of(excitation, n), samples=1, budget=own)
        budget.left -= allowed - own.left
        values = {name: getattr(response, name) for name in (*NAMES, "periods_evaluated")}
        values |= {name if name == "closure" else f"energy.{name}": e for name, e in response.energy.items()}
        if response.waveforms is None:
            values = dict.fromkeys(values, np.nan)
        for name, value in {**values, "converged": response.converged}.items():
            empty = np.zeros(designs, bool) if name == "converged" else np.full(designs, np.nan)
            columns.setdefault(name, empty)[n] = value
    return columns


def _clocked(system: System, excitation: Excitation) -> bool:
    """True if the shunt has a clock, of whose samples a period need not have a whole number."""
    switch = system.shunt.switch(system.electrode.capacitance, excitation.period)
    return switch is not None and switch.clocked


def _differs(part: Any) -> bool:
    """True if a component has a field that differs from design to design."""
    if isinstance(part, tuple):
        return any(map(_differs, part))
    if isinstance(part, Component):
        return any(_differs(getattr(part, field.name)) for field in dataclasses.fields(part) if field.init)
    return isinstance(part, np.ndarray) and part.ndim == 2


def one_of(part: Any, n: int) -> Any:
    """One design of components with array-valued fields.

    Parameters
    ----------
    part : System or Component
    n : int
        Which design.
    """
    if isinstance(part, np.ndarray) and part.ndim == 2:
        return float(part[n, 0])
    if isinstance(part, tuple):
        return tuple(one_of(inner, n) for inner in part)
    if isinstance(part, Component | System):
        fields = {field.name: getattr(part, field.name) for field in dataclasses.fields(part) if field.init}
        return dataclasses.replace(part, **{name: one_of(value, n) for name, value in fields.items()})
    return part
