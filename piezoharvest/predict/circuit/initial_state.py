"""Initial state of a record behind a circuit, and its derivatives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.state import EngineState
from piezoharvest.engine.sensitivity.dual_modes import Dual, dual
from piezoharvest.engine.transient.sampled_system import SampledSystem
from piezoharvest.equations.pieces import Pieces
from piezoharvest.equations.terms import PIECEWISE, SmoothElement
from piezoharvest.predict.discrete_model import Setting
from piezoharvest.predict.parameters import STEP

ITERATIONS = 30  # of elements that depend on each other: they are small beside what is linear
ROUNDING = 1e-9  # of the terms of a rate: far above their rounding, far below what diodes with a resistance let it be
MARGIN = 1e-9  # of the largest charge: far below what a sensor resolves


def initial_state(
    system: SampledSystem, setting: Setting, shunt: Shunt, nuisance: np.ndarray, begun: Sequence[str] = ()
) -> tuple[EngineState, np.ndarray]:
    """State at the first sample: rest under the first value of the drive, or what is known, and deviations from it.

    Parameters
    ----------
    system : SampledSystem
        Lowered from complex steps of the parameters.
    setting : Setting
    shunt : Shunt
        With which the system was lowered, in numbers.
    nuisance : (n,) array
        Deviations of `setting.free` in units of `setting.sizes`, those of the states `begun` (SI units), then outputs
        of the stops as fractions of their limits.
    begun : sequence of str
        States of effects that may be under way as the record begins.

    Returns
    -------
    EngineState
    (states, parameters + n) array
        Derivatives of its scaled states with respect to the parameters and these numbers.
    """
    lowered, plain, count = system.lowered, system.plain, system.count
    program = lowered.program
    scale, rest = (_of(program, name, count) for name in ("scale", "equilibrium"))
    z, d = rest.value.copy(), np.zeros((len(rest.value), count + len(nuisance)))
    d[:, :count] = rest.change.T
    for name, value in setting.fixed:
        row = lowered.states.index(name)
        z[row] += value / scale.value[row]
        d[row, :count] -= value / scale.value[row] ** 2 * scale.change[:, row]
    free = [*zip(setting.free, setting.sizes, strict=True), *((name, 1.0) for name in begun)]
    for k, (name, size) in enumerate(free):
        if name not in lowered.states:
            continue  # of an effect at its null value, which no motion feels
        row = lowered.states.index(name)
        slope = size / scale.value[row]
        z[row] += slope * nuisance[k]
        d[row, :count] -= slope * nuisance[k] / scale.value[row] * scale.change[:, row]
        d[row, count + k] = slope
    limits = _of(program, "stop_limit", count)
    for j in range(len(nuisance) - len(free)):
        row, k = program.stop_state[j], len(free) + j
        z[row] = nuisance[k] * limits.value[j]
        d[row, :count], d[row, count + k] = nuisance[k] * limits.change[:, j], limits.value[j]
    state = system.machine().state()
    charge = next((size for name, size in free if name == "q"), 0.0)
    margin = MARGIN * charge / scale.value[program.charge]
    state.D[st.CONFIGURATION] = _within_limits(system, shunt, z, d, margin)
    state.z[: len(z)] = z
    _discharge(plain.program, state, len(z), margin)
    if setting.acted:
        state.clock[st.ACTED] = setting.acted - float(plain.program.hold_off)
    return state, d


def _of(program: pg.Program, name: str, count: int) -> Dual:
    """A vector of the program with its derivatives (count, n)."""
    found = dual(getattr(program, name), 1)
    return Dual(found.value, np.broadcast_to(found.change, (count, len(found.value))))


def _within_limits(system: SampledSystem, shunt: Shunt, z: np.ndarray, d: np.ndarray, margin: float) -> int:
    """Keep states of a circuit within what its parts leave at the electrode voltage; configuration that they are in.

    Like the electrodes in `_discharge`, they keep a bit away from where diodes conduct, and their derivatives where the
    voltage has no influence.
    """
    program, plain, names, count = system.lowered.program, system.plain.program, system.lowered.states, system.count
    # The nominal system has no elements of effects at their null values.
    scale, row, n = _of(program, "scale", count), np.real(plain.voltage_row), len(z)
    whole = np.concatenate([z, _resting_signal(plain)])
    _set_elements(plain, whole)
    voltage, changes = float(row @ whole), row[:n] @ d
    changes[:count] += _of(program, "voltage_row", count).change[:, :n] @ z
    begun, moved = dict[str, float](), margin * abs(row[plain.charge])
    for name, limits in shunt.possible_states(voltage + 1j * STEP).items():
        k = names.index(name)
        unit, value = scale.value[k], float(scale.value[k] * z[k])
        low, high = (float(np.real(limit)) for limit in limits)
        begun[name] = float(np.clip(value, low, high))
        z[k] = np.clip(value, low + moved, high - moved) / unit
        slope = np.imag(limits[0 if value < low else 1]) / STEP
        if not low <= value <= high and slope != 0.0:
            d[k] = slope * changes / unit
            d[k, :count] -= z[k] / unit * scale.change[:, k]
    # A supply or a cold start, with a state of its own, stands before the circuit's name.
    before = system.lowered.configurations[0].removesuffix(shunt.configurations()[0])
    return system.lowered.configurations.index(before + shunt.begun(voltage, begun))


def _discharge(program: pg.Program, state: EngineState, n: int, margin: float) -> None:
    """Take from the electrodes the charge by which their voltage would exceed what the diodes allow, and a bit more.

    Noise and start values may put it there; diodes without resistance have conducted until it was gone. Without the
    margin, a scaled charge, diodes at rest would be neither conducting nor blocking.

    Derivatives stay those of the given charge: with those of what is left, which are zero, a fit that once has too
    much charge would never find back.
    """
    charge, begun = program.charge, int(state.D[st.CONFIGURATION])
    z = np.concatenate([state.z[:n], _resting_signal(program)])
    for g in np.flatnonzero((program.guard_code[begun] == pg.CONDUCT) & (program.guard_target[begun] >= 0)):
        form = dual(program.guard_z[..., begun, g, :], 1)
        if not _holds(program, int(program.guard_target[begun, g]), form.value):
            continue
        slope, moved = form.value[charge], 0.0
        for _ in range(ITERATIONS if slope != 0.0 else 0):
            _set_elements(program, z)
            excess = float(form.value @ z) + margin * abs(slope)
            if excess <= 0.0 and not moved:
                break
            z[charge] -= excess / slope
            moved += excess / slope
    # Events that are due are looked for before the engine sets the outputs of smooth elements.
    _set_elements(program, z)
    elements = slice(n, n + pg.DERIVATIVES * len(program.element_power))
    state.z[charge], state.z[elements] = z[charge], z[elements]


def _holds(program: pg.Program, configuration: int, form: np.ndarray) -> bool:
    """True if a linear form of the state keeps its value in a configuration, as a voltage that diodes hold."""
    n = program.rate.shape[-2]
    rate = dual(program.rate[..., configuration, :, :], 2).value
    change, terms = form[:n] @ rate, np.abs(form[:n]) @ np.abs(rate)
    scale = np.real(np.reshape(program.exo_scale, (-1, len(form) - n))[0])
    for k in range(0, pg.DERIVATIVES * len(program.element_power), pg.DERIVATIVES):
        # An element's slope over time stands behind its value.
        change[n + k + 1] += form[n + k] * scale[k + 1] / scale[k]
    return bool(np.all(np.abs(change) <= ROUNDING * terms.max()))


def _set_elements(program: pg.Program, z: np.ndarray) -> None:
    """Set the outputs of smooth elements, which depend on the state and, by way of a voltage, on each other."""
    n = program.rate.shape[-2]
    if not len(program.element_power):
        return
    scale = np.real(np.reshape(program.exo_scale, (-1, len(z) - n))[0])
    inputs = np.real(np.reshape(program.element_z, (-1, *program.element_z.shape[-3:]))[0])
    elements = [_element(program, k) for k in range(len(program.element_power))]
    with np.errstate(over="ignore", invalid="ignore"):  # of a law that a fit tried; then the engine finds no solution
        for _ in range(ITERATIONS):
            for k, element in enumerate(elements):
                z[n + pg.DERIVATIVES * k] = element.at_start(*(inputs[k] @ z)) / scale[pg.DERIVATIVES * k]


def _element(program: pg.Program, k: int) -> SmoothElement:
    """The k-th element of a program; its inputs are rows of that."""
    begin, end = program.first_corner[k : k + 2]
    pieces = np.reshape(np.real(program.pieces), (-1, *program.pieces.shape[-2:]))[0, begin + k : end + k + 1]
    corners = program.corners[begin:end]
    power, none = int(program.element_power[k]), np.zeros(0)
    return SmoothElement("", none, none, power, Pieces(corners, pieces) if power == PIECEWISE else None)


def _resting_signal(program: pg.Program) -> np.ndarray:
    """Exogenous states while the signal is zero: its value and slope, and the constant, if the program has one."""
    found = np.zeros(program.rate.shape[-1] - program.rate.shape[-2])
    if len(found) > 2 + pg.DERIVATIVES * len(program.element_power):
        found[-1] = 1.0 / np.real(np.reshape(program.exo_scale, (-1, len(found)))[0, -1])
    return found
