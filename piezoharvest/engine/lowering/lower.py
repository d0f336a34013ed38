"""Linear modes of a system under an excitation: the components' equations, evaluated on unit vectors."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.circuit import Guard, Product, Switch
from piezoharvest.description.excitation import Excitation, Ramps, Tones
from piezoharvest.description.limits import check_size
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.cold_start import with_start
from piezoharvest.description.shunts.curves.curved import with_curves
from piezoharvest.description.shunts.saturation import with_saturation
from piezoharvest.description.shunts.stored import with_supply
from piezoharvest.description.system import System
from piezoharvest.engine.lowering.element_scales import influences
from piezoharvest.engine.lowering.equilibrium import equilibrium
from piezoharvest.engine.lowering.groups import Groups
from piezoharvest.engine.lowering.layout import Layout, Physics, rows_of, scalar, stack
from piezoharvest.engine.lowering.open_voltage import open_voltage
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.work_limit import PERIOD_WORK, SAMPLE_WORK, Budget
from piezoharvest.equations.circuits import circuit_equations, circuit_powers
from piezoharvest.equations.pieces import Pieces
from piezoharvest.equations.rows import connected
from piezoharvest.equations.terms import Terms

IDLE_SCALE = 1e30  # scale of a smooth element without influence


class Lowered(NamedTuple):
    """A program with the names of its indices, the signal, the effects without influence, and the work limit."""

    program: pg.Program
    states: tuple[str, ...]
    configurations: tuple[str, ...]
    categories: tuple[str, ...]
    signal: Tones | Ramps
    unfelt: tuple[str, ...]
    budget: Budget


def lower(system: System, excitation: Excitation, record: float | None = None) -> Lowered:
    """Matrices of all modes of a system under an excitation.

    Components with array-valued fields of shape (designs, 1) give arrays with the designs as leading axis.

    Parameters
    ----------
    system : System
    excitation : Excitation
    record : float, optional
        Length of the run in s, for effects that change during a record and for its work limit; without it they keep
        their initial values.

    Raises
    ------
    ParameterError
        An effect takes a power that is no whole number, or acts on a shunt with which it cannot be simulated, or there
        is too much of something.
    """
    check_size(system.transducer, excitation, system.shunt)
    signal = excitation.signal()
    system = settled(connected(system), excitation)
    whole = with_saturation(with_supply(with_curves(system.shunt)), system.shunt)
    system = System(system.transducer, with_start(whole, system.shunt))
    drive = "displacement" if excitation.imposed else "base_acceleration" if excitation.base else "force"
    if excitation.imposed and system.transducer.modes:
        message = "found further modes, but only one is allowed where the displacement is imposed"
        raise ParameterError("transducer.modes", message)
    terms = Terms(system.transducer, drive, record=record, size=excitation.size, loaded=system.shunt.loaded)
    layout = Layout(system, terms, signal, preloaded=bool(np.any(excitation.rest)))
    physics = Physics(system, excitation, layout, signal)
    shunt, capacitance = system.shunt, system.electrode.capacitance
    z, dz = physics.circuit_rows()
    groups, always = Groups(shunt), physics.products()
    tables = SimpleNamespace(equations=[], guards=[], products=[], outputs=[], assignments=[])
    for name in groups.names:
        of_ports, own = circuit_equations(shunt, name, physics.ports, z, dz)
        tables.equations.append(rows_of([*physics.equations(of_ports), *own], layout.width))
        tables.guards.append(list(shunt.guards(name, physics.port, z)))
        tables.assignments.append(list(shunt.assignments(name, physics.port, z)))
        powers = circuit_powers(shunt, name, physics.ports, z)
        dc = shunt.dc_side(physics.port, z)
        mean_dc = (len(pg.CATEGORIES) + len(layout.effects), Product(1.0, layout.one, dc))
        own_powers = [(pg.CATEGORIES.index(key), product) for key in powers for product in powers[key]]
        tables.products.append([*always, *own_powers, mean_dc])
        motion, port = physics.motion, physics.port
        outputs = (
            physics.drive, motion.displacement, motion.velocity, port.v, port.i, layout.z["q"], physics.v_h, dc,
            motion.acceleration,
        )  # fmt: skip
        tables.outputs.append(rows_of(outputs, layout.width))
    switch = shunt.switch(capacitance, excitation.period)
    terms.check(shunt, switch)
    try:
        with np.errstate(all="ignore"):  # non-finite values are detected by the inversion or by the engine
            program = _without_unused_constant(
                _assemble(layout, physics, tables, groups, shunt, switch, signal, excitation, record)
            )
    except np.linalg.LinAlgError:
        message = "its values are so many decades apart that its equations cannot be solved"
        raise ParameterError("transducer", message) from None
    categories = (*pg.CATEGORIES, *layout.effects, pg.MEAN_DC)
    budget = Budget()
    budget.left += SAMPLE_WORK * int(excitation.samples)
    if record is not None and isinstance(signal, Tones) and len(signal.frequencies):
        budget.left += PERIOD_WORK * int(record * np.max(signal.frequencies))
    return Lowered(program, tuple(layout.names), tuple(groups.index), categories, signal, terms.unfelt, budget)


def settled(system: System, excitation: Excitation) -> System:
    """The system whose tracker, if it has one, has found its voltage.

    Raises
    ------
    ParameterError
        There is a tracker, and the excitation is not one sine, or drives what has no damping at its resonance.
    """
    if not system.shunt.tracks:
        return system
    if excitation.size is None:
        found = f"found {system.shunt.kind} under {excitation.kind}"
        raise ParameterError("kind", f"{found}, but a tracker of the open-circuit voltage needs one sine")
    opened = lower(system.opened, excitation)
    try:
        return System(system.transducer, system.shunt.tracked(open_voltage(opened.program)))
    except np.linalg.LinAlgError:
        found = "found none at the resonance of the open electrodes, whose voltage grows without end"
        raise ParameterError("transducer.damping", f"{found}, but a tracker needs one that settles") from None


def symmetric(lowered: Lowered, excitation: Excitation) -> bool:
    """True if the system has half-wave symmetry: the signal, and every configuration with its mirror image."""
    program = lowered.program
    if not excitation.antisymmetric or np.any(program.mirror < 0):
        return False
    signs = np.concatenate([program.odd, -np.ones(program.exosystem.shape[-1])])
    n, end = len(program.odd), len(program.odd) + pg.DERIVATIVES * len(program.element_power)
    signs[end + 2 * len(program.phase) :] = 1.0  # the constant
    if not np.all(program.element_parity):
        return False
    signs[n:end] = np.repeat(program.element_parity, pg.DERIVATIVES)
    image, mirror = program.odd[:, None] * program.rate * signs, np.take(program.rate, program.mirror, axis=-3)
    inputs = np.allclose(program.element_z * signs, -program.element_z, rtol=1e-12, atol=0)
    return bool(inputs and np.allclose(image, mirror, rtol=1e-12, atol=0))


def _join(*parts: np.ndarray) -> np.ndarray:
    """Arrays concatenated along the last axis, with or without a batch axis."""
    batch = np.broadcast_shapes(*(p.shape[:-1] for p in parts))
    return np.concatenate([np.broadcast_to(p, batch + p.shape[-1:]) for p in parts], axis=-1)


class _Columns:
    """Scaling of the columns of rows, and their parts over the augmented state and over the derivative."""

    def __init__(self, n: int, scale: np.ndarray, exo_scale: np.ndarray):
        self.n, self.factors = n, _join(scale, scale, exo_scale)

    def split(self, rows: np.ndarray, between: int) -> tuple[np.ndarray, np.ndarray]:
        """Scaled parts of rows that have `between` axes between those of the batch and the columns."""
        n, factors = self.n, self.factors
        rows = rows * factors.reshape(factors.shape[:-1] + (1,) * between + factors.shape[-1:])
        return np.concatenate([rows[..., :n], rows[..., 2 * n :]], axis=-1), rows[..., n : 2 * n]


def _assemble(layout, physics, tables, groups, shunt, switch, signal, excitation, record) -> pg.Program:
    storage, scale = physics.storage()
    equations = groups.spread(tables.equations, 2)
    exo_scale = _exo_scale(layout, equations, scale, signal, physics)
    columns, sizes = _Columns(layout.n, scale, exo_scale), _join(scale, exo_scale[..., : layout.signal])
    outputs = columns.split(groups.spread(tables.outputs, 2), 2)
    harmonic = isinstance(signal, Tones)
    omega = 2 * np.pi * np.asarray(signal.frequencies) if isinstance(signal, Tones) else np.zeros(0)
    fields: dict[str, Any] = {
        **_motion(layout, columns.split(equations, 2)),
        **_stops(layout, scale),
        **_guards(layout, tables.guards, groups, columns),
        **_switching(shunt, switch, groups, layout, physics.port.capacitance),
        **_products(layout, tables.products, groups, columns),
        **_assignments(layout, groups.each(tables.assignments), columns, scale),
        "exosystem": _exosystem(layout, omega, exo_scale),
        "equilibrium": equilibrium(layout, physics, excitation, scale),
        "period": np.inf if excitation.period is None else scalar(excitation.period),
        "signal_kind": pg.TONES if harmonic else pg.RAMPS,
        "omega": omega,
        "phase": np.asarray(signal.phases, float) if harmonic else np.zeros(0),
        "exo_scale": exo_scale,
        "scale": scale,
        "odd": _parity(layout),
        "storage": storage * sizes[..., :, None] * sizes[..., None, :],
        "charge": layout.charge,
        "voltage_row": columns.split(physics.port.v, 0)[0],
        "trigger_row": columns.split(physics.strain_current, 0)[0],
        "output_z": outputs[0],
        "output_d": outputs[1],
        "categories": len(pg.CATEGORIES) + len(layout.effects) + 1,
        "step": _largest_step(excitation, signal),
        **_elements(layout, physics, columns, record),
    }
    return pg.Program(**{name: _plain_types(value) for name, value in fields.items()})


def _without_unused_constant(program: pg.Program) -> pg.Program:
    """Leave the constant out if nothing is constant: it may need one more register in every row.

    A power counts if neither of its factors vanishes.
    """
    rows = (
        program.rate, program.guard_z, program.output_z, program.voltage_row, program.trigger_row, program.element_z,
        program.assigned_row,
    )  # fmt: skip
    alive = np.any(program.product_z, axis=-1) | np.any(program.product_d, axis=-1)
    powers = program.product_z * np.all(alive, axis=-1)[..., None, None]
    if any(np.any(row[..., -1]) for row in (*rows, powers)):
        return program
    forms = ("rate", "guard_z", "output_z", "voltage_row", "trigger_row", "product_z", "exo_scale", "element_z",
             "assigned_row")  # fmt: skip
    changes = {name: np.ascontiguousarray(getattr(program, name)[..., :-1]) for name in forms}
    return program._replace(**changes, exosystem=np.ascontiguousarray(program.exosystem[..., :-1, :-1]))


def _plain_types(value: Any) -> Any:
    """Plain numbers and contiguous arrays, so that all systems have the same types and share one compilation."""
    value = np.asarray(value)
    kind = {"i": np.int64, "u": np.int64, "c": np.complex128}.get(value.dtype.kind, np.float64)
    return kind(value) if value.ndim == 0 else np.ascontiguousarray(value, kind)


def _motion(layout: Layout, equations) -> dict[str, Any]:
    """Solve the equations of every configuration for the derivatives, all stops slipping."""
    rate, mass = equations
    size = np.max(np.abs(np.real(mass)), axis=-1, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    inverse, stops = np.linalg.inv(mass / size), layout.stop_states
    own = (mass / size)[..., stops, stops]  # 1, except for the complex step of a scale
    return {"rate": inverse @ (-rate / size), "stop_response": inverse[..., stops] * own[..., None, :]}


def _stops(layout: Layout, scale: np.ndarray) -> dict[str, Any]:
    """Tables of the stop operators; those of effects record their own energy, as their weight is part of a force."""
    count, own, added = len(layout.stop_states), scale[..., layout.stop_states], layout.terms.stops
    inputs = rows_of([into[..., : layout.n] for into in layout.stop_inputs], layout.n)
    thresholds = [*(r for r, _ in layout.operators), *(stop.threshold for stop in added)]
    weights = [*(w for _, w in layout.operators), *[0.0] * len(added)]
    return {
        "stop_state": layout.stop_states,
        "stop_input": inputs * scale[..., None, :] / own[..., :, None],
        "stop_limit": (stack(thresholds) if count else np.zeros(0)) / own,
        "stop_weight": (stack(weights) if count else np.zeros(0)) * own**2,
    }


def _guards(layout: Layout, guards: list[list[Guard]], groups: Groups, columns: _Columns) -> dict[str, Any]:
    """Guards of all configurations as padded arrays, each row of about unit size."""
    rows = groups.spread([rows_of([g.rises for g in own], layout.width) for own in guards], 2)
    guard_z, guard_d = columns.split(rows, 2)
    largest = sum(np.max(np.abs(np.real(part)), axis=-1, keepdims=True) for part in (guard_z, guard_d))
    largest = np.where(largest > 0, largest, 1.0)
    return {
        "guard_z": guard_z / largest,
        "guard_d": guard_d / largest,
        "guard_target": groups.integers(guards, lambda g: groups.targets(g.target)),
        "guard_cut": groups.integers(guards, lambda g: -1 if g.cut is None else layout.names.index(g.cut)),
        "guard_code": groups.integers(guards, _code_of),
    }


def _code_of(guard: Guard) -> int:
    """Code of a guard's event, `pg.NONE` where it is not told."""
    if guard.event is None:
        return pg.CONDUCT if guard.begins_to_conduct else pg.BLOCK
    return pg.EVENT_NAMES.index(guard.event) if guard.event else pg.NONE


def _switching(
    shunt: Shunt, switch: Switch | None, groups: Groups, layout: Layout, capacitance: float
) -> dict[str, Any]:
    """Tables of the synchronised switch: its timing, and the configuration it leads to from each."""
    timing = switch or Switch(0.0, 0.0, 0.0)
    recovered = {s.name: s.recovered for s in layout.shunt_states if s.recovered is not None}

    def following(after: Callable[[str], str]) -> np.ndarray:
        return groups.integers([[name] for name in groups.names], lambda name: groups.targets(after(name)))[:, 0]

    return {
        "switched": _kind_of(switch),
        "lag": scalar(timing.lag),
        "on_time": scalar(timing.on_time),
        "stage": stack(groups.each(shunt.stage(name, capacitance) for name in groups.names)),
        "recovered": stack([recovered.get(name, 0.0) for name in layout.names]),
        "hold_off": scalar(timing.hold_off),
        "early": scalar(np.asarray(timing.early, float)),
        "efficiency": scalar(timing.efficiency),
        "drop": scalar(timing.drop),
        "threshold": scalar(timing.threshold),
        "gate_energy": scalar(timing.gate_energy),
        "closed": np.array([following(lambda name, to=to: shunt.closed(name, to)) for to in (-1, 1)]),
        "opened": following(shunt.opened),
        "cut": np.array([name in {"current", *recovered} for name in layout.names]),
        "mirror": following(shunt.mirrored) if shunt.mirrors else np.full(len(groups.index), -1),
        "shorted": shunt.shorts,
    }


def _kind_of(switch: Switch | None) -> int:
    """Number by which the engine knows a kind of switch."""
    if switch is None:
        return 0
    return pg.CLOCKED if switch.clocked else 1 if np.all(np.real(switch.on_time) > 0) else 2


def _assignments(layout: Layout, assignments, columns: _Columns, scale: np.ndarray) -> dict[str, Any]:
    """Tables of what a controller sets: values as rows over the scaled state, in the scale of their states."""
    own = [each for of_configuration in assignments for each in of_configuration]
    states = [layout.names.index(each.state) for each in own]
    rows, of_rates = columns.split(rows_of([each.value for each in own], layout.width), 1)
    assert not np.any(of_rates)  # a controller knows no rates
    size = scale[..., states]

    def scaled(values) -> np.ndarray:
        return (stack(values) if own else np.zeros(0)) / size

    return {
        "assigned_row": rows / size[..., None], "assigned_step": scaled([each.resolution for each in own]),
        "assigned_limit": scaled([each.limit for each in own]), "assigned_state": np.array(states, int),
        "assigned_first": np.cumsum([0, *(len(of_configuration) for of_configuration in assignments)]),
    }  # fmt: skip


def _products(layout: Layout, products, groups: Groups, columns: _Columns) -> dict[str, Any]:
    """Products of all configurations as padded arrays."""
    blocks = [rows_of([row for _, p in own for row in (p.first, p.second)], layout.width) for own in products]
    rows = groups.spread(blocks, 2)
    rows = rows.reshape(*rows.shape[:-2], rows.shape[-2] // 2, 2, layout.width)
    product_z, product_d = columns.split(rows, 3)
    coefficients = [stack([product.coefficient for _, product in own]) for own in products]
    return {
        "product_coefficient": groups.spread(coefficients, 1),
        "product_category": groups.integers(products, lambda each: each[0]),
        "product_z": product_z, "product_d": product_d,
    }  # fmt: skip


def _elements(layout: Layout, physics: Physics, columns: _Columns, record: float | None) -> dict[str, Any]:
    """Tables of the smooth elements: their inputs as rows over the state, and their kinds."""
    elements = layout.elements
    over_state, over_rate = columns.split(physics.inputs(), 1)
    if np.any(over_rate):
        raise ParameterError("transducer.effects", "found a power of a current, allowed are powers of states and v_t")
    shape = (*over_state.shape[:-2], len(elements), 2, over_state.shape[-1])
    pieces = [each.pieces or Pieces(np.zeros(0), np.zeros((1, 3))) for each in elements]
    counts = [len(each.corners) for each in pieces]
    return {
        "element_z": over_state.reshape(shape), "element_power": np.array([each.power for each in elements], int),
        "element_parity": np.array([each.parity for each in elements], int),
        "corners": np.concatenate([np.zeros(0), *(each.corners for each in pieces)]),
        "pieces": _one_after_another([each.coefficients for each in pieces]),
        "first_corner": np.cumsum([0, *counts]),
        "drift": 1.0 / record if record else 0.0,
    }  # fmt: skip


def _one_after_another(coefficients: list[np.ndarray]) -> np.ndarray:
    """Coefficients (..., k, 3) of several elements in one array; those without the axes of a batch hold for all."""
    batch = np.broadcast_shapes(*(each.shape[:-2] for each in coefficients))
    each = [np.broadcast_to(part, (*batch, *part.shape[-2:])) for part in coefficients]
    return np.concatenate([np.zeros((*batch, 0, 3)), *each], axis=-2)


def _parity(layout: Layout) -> np.ndarray:
    """Sign of each state under mirroring: -1 for most."""
    signs = np.full(layout.n, -1.0)
    for k, state in enumerate(layout.added_states, layout.n - len(layout.added_states)):
        signs[k] = -1.0 if state.odd else 1.0
    return signs


def _exosystem(layout: Layout, omega: np.ndarray, exo_scale: np.ndarray) -> np.ndarray:
    """Generator of the exogenous states: pairs (sine, cosine), or (value, slope), and the constant."""
    matrix = np.zeros((*omega.shape[:-1], layout.exogenous, layout.exogenous), np.result_type(omega, float))
    at = layout.signal
    for k in range(at):
        if (k + 1) % pg.DERIVATIVES:
            matrix[..., k, k + 1] = 1.0
    if not omega.size:
        matrix[..., at, at + 1] = 1.0
    for k in range(omega.shape[-1]):
        sine, cosine = at + 2 * k, at + 2 * k + 1
        matrix[..., sine, cosine], matrix[..., cosine, sine] = omega[..., k], -omega[..., k]
    return matrix * exo_scale[..., None, :] / exo_scale[..., :, None]


def _exo_scale(layout: Layout, equations, scale, signal: Tones | Ramps, physics: Physics) -> np.ndarray:
    """Scales with which every exogenous column has entries of the size of the resonance frequency.

    Always real: a complex step of a quantity must not change the exogenous states.
    """
    n, tr = layout.n, physics.transducer
    mass = np.max(np.abs(np.real(equations[..., n : 2 * n] * scale[..., None, None, :])), axis=-1)
    columns = np.abs(np.real(equations[..., 2 * n :])) / np.where(mass > 0, mass, 1.0)[..., None]
    size = np.max(columns, axis=(-3, -2))
    resonance = np.real(np.sqrt(scalar(tr.stiffness) / scalar(tr.mass)))[..., None]
    found = np.where(size > 0, resonance / np.where(size > 0, size, 1.0), 1.0)
    at = layout.signal
    if isinstance(signal, Tones):
        for k in range(at, at + 2 * signal.frequencies.shape[-1], 2):
            found[..., k + 1] = found[..., k]
    else:
        found[..., at + 1] = found[..., at] * resonance[..., 0]
    # The constant also represents diode drops and limits. If it were scaled smaller than the drive, a tiny offset of
    # the drive would enlarge these; where it acts on nothing it is not scaled larger, as rounding is judged by it.
    drive = np.max(found[..., at:-1:2], axis=-1)
    found[..., -1] = np.where(size[..., -1] > 0, np.minimum(found[..., -1], drive), drive)
    # An element may act by its rate alone; one that does not act in this design must not mask those that do.
    direct = np.maximum(size[..., 0 : at : pg.DERIVATIVES], size[..., 1 : at : pg.DERIVATIVES] * resonance)
    if np.any(direct == 0.0):
        level = _drive_level(found, at, signal)[..., None]
        direct = influences(layout.elements, direct, *_input_sizes(layout, physics, np.real(scale) * level))
    values = np.where(direct > 0, resonance / np.where(direct > 0, direct, 1.0), IDLE_SCALE)
    for j in range(direct.shape[-1]):
        k = pg.DERIVATIVES * j
        found[..., k : k + pg.DERIVATIVES] = values[..., j, None] * resonance ** np.arange(pg.DERIVATIVES)
    return found


def _drive_level(exo_scale: np.ndarray, at: int, signal: Tones | Ramps) -> np.ndarray:
    """Size of a scaled state under the drive, without resonance."""
    if isinstance(signal, Tones):
        return np.max(1.0 / exo_scale[..., at:-1:2], axis=-1)
    return np.max(np.abs(signal.starts), initial=0.0) / exo_scale[..., at]


def _input_sizes(layout: Layout, physics: Physics, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sizes of the inputs of smooth elements at states of these sizes (..., n), and their coefficients of outputs."""
    rows, n = np.abs(np.real(physics.inputs())), layout.n
    rows = rows.reshape(*rows.shape[:-2], -1, 2, layout.width)
    outputs = rows[..., 2 * n : 2 * n + layout.signal : pg.DERIVATIVES]
    known = np.sum(rows[..., :n] * states[..., None, None, :], axis=-1) + rows[..., 2 * n + layout.signal :].sum(
        axis=-1
    )
    return known, outputs


def _largest_step(excitation: Excitation, signal: Tones | Ramps) -> np.ndarray | float:
    """Largest step: an eighth of the shortest period of the drive, or its longest linear piece."""
    if isinstance(signal, Tones):
        return 0.125 / np.max(signal.frequencies, axis=-1)
    return float(np.max(np.diff(signal.times)))
