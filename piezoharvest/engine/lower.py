"""System and excitation to linear modes: the components' equations, evaluated on unit vectors."""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from piezoharvest.circuit import Guard, Port, Product, Switch
from piezoharvest.engine import program as pg
from piezoharvest.excitation import Excitation, Ramps, Tones
from piezoharvest.system import System


class Lowered(NamedTuple):
    """A program with the names that its indices stand for, and the signal that drives it.

    `equilibrium` is the (scaled) state in which a unit of static excitation leaves the structure, electrodes relaxed.
    """

    program: pg.Program
    equilibrium: np.ndarray
    states: tuple[str, ...]
    configurations: tuple[str, ...]
    categories: tuple[str, ...]
    signal: Tones | Ramps


class _Layout:
    """Columns of the rows: [states | derivatives | exogenous], and named access to them."""

    def __init__(self, system: System, signal: Tones | Ramps):
        transducer, shunt = system.transducer, system.shunt
        self.modes = transducer.all_modes
        hysteresis = transducer.hysteresis
        self.stops = () if hysteresis is None else tuple(zip(hysteresis.thresholds, hysteresis.weights, strict=True))
        self.effect_states = [effect.states() for effect in transducer.effects]
        self.shunt_states = shunt.states(transducer.capacitance)
        self.names = [f"{s}{i + 1}" for i in range(len(self.modes)) for s in "xu"] + ["q"]
        self.names += [f"stop{j + 1}" for j in range(len(self.stops))]
        for k, states in enumerate(self.effect_states):
            self.names += [f"effect{k}.{state.name}" for state in states]
        self.names += [state.name for state in self.shunt_states]
        self.n = len(self.names)
        self.exogenous = 2 * len(signal.frequencies) + 1 if isinstance(signal, Tones) else 3
        self.width = 2 * self.n + self.exogenous
        self.charge = 2 * len(self.modes)

    def row(self, column: int) -> np.ndarray:
        unit = np.zeros(self.width)
        unit[column] = 1.0
        return unit

    def z(self, name: str) -> np.ndarray:
        return self.row(self.names.index(name))

    def dz(self, name: str) -> np.ndarray:
        return self.row(self.n + self.names.index(name))

    @property
    def one(self) -> np.ndarray:
        return self.row(-1)

    def group(self, prefix: str, states) -> tuple[SimpleNamespace, SimpleNamespace]:
        pairs = [(s.name, prefix + s.name) for s in states]
        return (
            SimpleNamespace(**{short: self.z(name) for short, name in pairs}),
            SimpleNamespace(**{short: self.dz(name) for short, name in pairs}),
        )


class _Physics:
    """The transducer's rows: what every configuration of the shunt has in common."""

    def __init__(self, system: System, excitation: Excitation, layout: _Layout, signal: Tones | Ramps):
        tr, lay = system.transducer, layout
        self.layout, self.system = layout, system
        x = [lay.z(f"x{i + 1}") for i in range(len(lay.modes))]
        u = [lay.z(f"u{i + 1}") for i in range(len(lay.modes))]
        self.drive = self._drive(signal)
        self.forces = [
            (-mode.base_mass if excitation.base else mode.force_participation) * self.drive for mode in lay.modes
        ]
        q, dq = lay.z("q"), lay.dz("q")
        v_t = (q - sum(mode.coupling * xi for mode, xi in zip(lay.modes, x, strict=True))) / tr.capacitance
        dv_t = (dq - sum(mode.coupling * ui for mode, ui in zip(lay.modes, u, strict=True))) / tr.capacitance
        zero = np.zeros(lay.width)
        self.v_h = sum((w * lay.z(f"stop{j + 1}") for j, (_, w) in enumerate(lay.stops)), zero)
        dv_h = sum((w * lay.dz(f"stop{j + 1}") for j, (_, w) in enumerate(lay.stops)), zero)
        self.v_t, self.v, self.dv = v_t, v_t + self.v_h, dv_t + dv_h
        self.trigger = sum((mode.coupling * ui for mode, ui in zip(lay.modes, u, strict=True)), zero)
        self.effects = []
        drawn = zero
        for k, effect in enumerate(tr.effects):
            rows = lay.group(f"effect{k}.", lay.effect_states[k])
            # An effect must not depend on the load current, which its own current decides.
            leads = Port(self.v, self.dv, np.full(lay.width, np.nan), lay.one, tr.capacitance)
            drawn = drawn + effect.current(leads, *rows)
            self.effects.append((effect, leads, rows))
        self.port = Port(self.v, self.dv, -dq - drawn, lay.one, tr.capacitance)
        self.displacement = sum((m.force_participation * xi for m, xi in zip(lay.modes, x, strict=True)), zero)
        self.velocity = sum((m.force_participation * ui for m, ui in zip(lay.modes, u, strict=True)), zero)
        self.x, self.u = x, u

    def _drive(self, signal) -> np.ndarray:
        lay = self.layout
        if isinstance(signal, Ramps):
            return lay.row(2 * lay.n)
        tones = range(len(signal.frequencies))
        sines = [lay.row(2 * lay.n + 2 * k) for k in tones]
        return sum((signal.amplitudes[..., k] * sines[k] for k in tones), signal.offset * lay.one)

    def equations(self) -> list[np.ndarray]:
        """Residuals of mechanics and effects; the stops' rows are placeholders that each mode completes."""
        lay, rows = self.layout, []
        for i, mode in enumerate(lay.modes):
            x, u, force = self.x[i], self.u[i], self.forces[i]
            rows.append(lay.dz(f"x{i + 1}") - u)
            inertia = mode.mass * lay.dz(f"u{i + 1}") + mode.damping * u + mode.stiffness * x
            rows.append(inertia - force - mode.coupling * self.v_t)
        rows += [lay.dz(f"stop{j + 1}") for j in range(len(lay.stops))]
        for effect, leads, (z, dz) in self.effects:
            rows += list(effect.equations(leads, z, dz))
        return rows

    def products(self) -> list[tuple[int, Product]]:
        """Powers that do not depend on the configuration, with their categories."""
        modes = self.layout.modes
        powers = [(pg.MECHANICAL_IN, Product(1.0, f, u)) for f, u in zip(self.forces, self.u, strict=True)]
        powers += [(pg.DAMPING, Product(m.damping, u, u)) for m, u in zip(modes, self.u, strict=True)]
        for k, (effect, leads, (z, dz)) in enumerate(self.effects):
            powers += [(len(pg.CATEGORIES) + k, product) for product in effect.losses(leads, z, dz)]
        return powers

    def storage(self) -> tuple[np.ndarray, np.ndarray]:
        """Stored energy as a matrix over the states (J = z storage z / 2), and the scale of every state."""
        lay, tr = self.layout, self.system.transducer
        diagonal, scale = [], []
        for mode in lay.modes:
            diagonal += [mode.stiffness, mode.mass]
            scale += [mode.stiffness**-0.5, mode.mass**-0.5]
        diagonal += [0.0] + [w for _, w in lay.stops]
        scale += [tr.capacitance**0.5] * (1 + len(lay.stops))
        for state in [s for states in lay.effect_states for s in states] + list(lay.shunt_states):
            diagonal.append(state.storage)
            scale.append(np.abs(state.storage) ** -0.5)
        v_t = self.v_t[..., : lay.n]
        matrix = _stack(diagonal)[..., None] * np.eye(lay.n)
        matrix = matrix + _scalar(tr.capacitance)[..., None, None] * v_t[..., :, None] * v_t[..., None, :]
        return matrix, _stack(scale)


def _scalar(value) -> np.ndarray:
    """A coefficient without the trailing axis that batches carry for the sake of rows."""
    value = np.asarray(value, float)
    return value[..., 0] if value.ndim else value


def _stack(values) -> np.ndarray:
    """Coefficients as the last axis of one array."""
    return np.stack(np.broadcast_arrays(*[_scalar(v) for v in values]), axis=-1)


def _rows(rows, width: int) -> np.ndarray:
    """Rows as the second axis from the end of one array; an empty list gives none."""
    if not len(rows):
        return np.zeros((0, width))
    return np.stack(np.broadcast_arrays(*rows), axis=-2)


def _join(*parts: np.ndarray) -> np.ndarray:
    """Arrays side by side along the last axis, whichever of them carry the batch axis."""
    batch = np.broadcast_shapes(*(p.shape[:-1] for p in parts))
    return np.concatenate([np.broadcast_to(p, batch + p.shape[-1:]) for p in parts], axis=-1)


def _pad(blocks, axis: int) -> np.ndarray:
    """Blocks of one configuration each, zero-padded to the same length and stacked along `axis` from the end."""
    longest = max(1, *(b.shape[-2] for b in blocks))

    def pad(block):
        return np.concatenate([block, np.zeros((*block.shape[:-2], longest - block.shape[-2], block.shape[-1]))], axis=-2)

    padded = [pad(block) for block in blocks]
    return np.stack(np.broadcast_arrays(*padded), axis=axis)


def lower(system: System, excitation: Excitation) -> Lowered:
    """Matrices of all modes of a system under an excitation.

    Components with array-valued fields of shape (designs, 1) give arrays with the designs as leading axis.
    """
    signal = excitation.signal()
    layout = _Layout(system, signal)
    physics = _Physics(system, excitation, layout, signal)
    shunt, capacitance = system.shunt, system.transducer.capacitance
    z, dz = layout.group("", layout.shunt_states)
    names = shunt.configurations()
    common = physics.equations()
    before = 2 * len(layout.modes)
    tables = SimpleNamespace(equations=[], guards=[], products=[], outputs=[])
    for name in names:
        own = list(shunt.equations(name, physics.port, z, dz))
        # The port's equation stands in the row of the charge.
        rows = common[:before] + own[:1] + common[before:] + own[1:]
        tables.equations.append(_rows(rows, layout.width))
        tables.guards.append(list(shunt.guards(name, physics.port, z)))
        powers = shunt.powers(name, physics.port, z)
        dc = shunt.dc_side(physics.port, z)
        mean_dc = (len(pg.CATEGORIES) + len(physics.effects), Product(1.0, layout.one, dc))
        own_powers = [(pg.CATEGORIES.index(key), product) for key in powers for product in powers[key]]
        tables.products.append([*physics.products(), *own_powers, mean_dc])
        outputs = (physics.drive, physics.displacement, physics.velocity, physics.v, physics.port.i, layout.z("q"),
                   physics.v_h, dc)  # fmt: skip
        tables.outputs.append(_rows(outputs, layout.width))
    switch = shunt.switch(capacitance, excitation.period)
    program = _assemble(layout, physics, tables, names, shunt, switch, signal, excitation)
    categories = (*pg.CATEGORIES, *(effect.name for effect in system.transducer.effects), pg.MEAN_DC)
    equilibrium = _equilibrium(layout, excitation) / program.scale
    return Lowered(program, equilibrium, tuple(layout.names), names, categories, signal)


def _equilibrium(layout, excitation) -> np.ndarray:
    """Displacements under a unit of static excitation, and the charge that leaves the electrodes without voltage."""
    state = np.zeros(layout.n)
    for i, mode in enumerate(layout.modes):
        force = -mode.base_mass if excitation.base else mode.force_participation
        state[2 * i] = force / mode.stiffness
        state[layout.charge] += mode.coupling * state[2 * i]
    return state


def _assemble(layout, physics, tables, names, shunt, switch, signal, excitation) -> pg.Program:
    n, tr = layout.n, physics.system.transducer
    storage, scale = physics.storage()
    equations = np.stack(np.broadcast_arrays(*tables.equations), axis=-3)
    exo_scale = _exo_scale(layout, equations, scale, signal, tr)
    columns = _join(scale, scale, exo_scale)

    def split(rows):
        """Scaled parts over the augmented state and over the derivative."""
        rows = rows * columns.reshape(columns.shape[:-1] + (1,) * (rows.ndim - columns.ndim) + columns.shape[-1:])
        return np.concatenate([rows[..., :n], rows[..., 2 * n :]], axis=-1), rows[..., n : 2 * n]

    rate, mass = split(equations)
    size = np.max(np.abs(mass), axis=-1, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    stop_state = np.arange(layout.charge + 1, layout.charge + 1 + len(layout.stops))
    inverse = np.linalg.inv(mass / size)
    guards = _pad([_rows([g.rises for g in guards], layout.width) for guards in tables.guards], -3)
    guard_z, guard_d = split(guards)
    largest = np.max(np.abs(guard_z), axis=-1, keepdims=True) + np.max(np.abs(guard_d), axis=-1, keepdims=True)
    largest = np.where(largest > 0, largest, 1.0)
    index = {name: c for c, name in enumerate(names)}
    count = guards.shape[-2]
    products = _products(layout, tables.products, split)
    output_z, output_d = split(np.stack(np.broadcast_arrays(*tables.outputs), axis=-3))
    voltage_row, _ = split(physics.v)
    trigger_row, _ = split(physics.trigger)
    switch_on = Switch(0.0, 0.0, 0.0) if switch is None else switch
    current = layout.names.index("current") if "current" in layout.names else -1
    thresholds = _stack([r for r, _ in layout.stops]) if layout.stops else np.zeros(0)
    weights = _stack([w for _, w in layout.stops]) if layout.stops else np.zeros(0)
    stop_input = np.zeros((len(layout.stops), n))
    stop_input[:, layout.charge] = 1.0  # stop and charge have the same scale
    root = _scalar(tr.capacitance)[..., None] ** 0.5
    omega = 2 * np.pi * np.asarray(signal.frequencies, float) if isinstance(signal, Tones) else np.zeros(0)
    return _compact(pg.Program(
        rate=inverse @ (-rate / size), stop_response=inverse[..., stop_state],
        exosystem=_exosystem(layout, omega, exo_scale),
        signal_kind=pg.TONES if isinstance(signal, Tones) else pg.RAMPS,
        omega=omega, phase=np.asarray(signal.phases, float) if isinstance(signal, Tones) else np.zeros(0),
        exo_scale=exo_scale, scale=scale, odd=_parity(layout, physics.system),
        storage=storage * scale[..., :, None] * scale[..., None, :],
        stop_state=stop_state, stop_input=stop_input, stop_limit=thresholds / root, stop_weight=weights * root**2,
        charge=layout.charge, voltage_row=voltage_row,
        guard_z=guard_z / largest, guard_d=guard_d / largest,
        guard_target=_integers(tables.guards, count, lambda g: index[g.target]),
        guard_cut=_integers(tables.guards, count, lambda g: -1 if g.cut is None else layout.names.index(g.cut)),
        guard_code=_integers(tables.guards, count, lambda g: pg.CONDUCT if g.target[-1] in "+-" else pg.BLOCK),
        trigger_row=trigger_row,
        switched=0 if switch is None else 1 if np.all(switch.on_time > 0) else 2,
        lag=_scalar(switch_on.lag), on_time=_scalar(switch_on.on_time), hold_off=_scalar(switch_on.hold_off),
        early=int(np.all(switch_on.early)), efficiency=_scalar(switch_on.efficiency),
        closed=np.array([[index.get(shunt.closed(c, polarity), -1) for c in names] for polarity in (-1, 1)]),
        opened=np.array([index[shunt.opened(c)] for c in names]), cut=current,
        mirror=np.array([index[shunt.mirrored(c)] for c in names]),
        output_z=output_z, output_d=output_d, categories=len(pg.CATEGORIES) + len(physics.effects) + 1,
        step=_largest_step(excitation, signal), **products,
    ))  # fmt: skip


def _compact(program: pg.Program) -> pg.Program:
    """Plain numbers and contiguous arrays, so that every system has the same types and one compilation serves all."""

    def plain(value):
        value = np.asarray(value)
        kind = np.int64 if value.dtype.kind in "iu" else np.float64
        return kind(value) if value.ndim == 0 else np.ascontiguousarray(value, kind)

    return pg.Program(*(plain(value) for value in program))


def _products(layout, products, split) -> dict:
    """Products of all configurations as padded arrays."""
    blocks = [_rows([row for _, p in own for row in (p.first, p.second)], layout.width) for own in products]
    rows = _pad(blocks, -3)
    rows = rows.reshape(*rows.shape[:-2], rows.shape[-2] // 2, 2, layout.width)
    count = rows.shape[-3]
    product_z, product_d = split(rows)
    coefficients = [_stack([p.coefficient for _, p in own] + [0.0] * (count - len(own))) for own in products]
    categories = np.full((len(products), count), -1)
    for c, own in enumerate(products):
        categories[c, : len(own)] = [category for category, _ in own]
    return {
        "product_coefficient": np.stack(np.broadcast_arrays(*coefficients), axis=-2), "product_category": categories,
        "product_z": product_z, "product_d": product_d,
    }  # fmt: skip


def _integers(guards: list[list[Guard]], count: int, read) -> np.ndarray:
    table = np.full((len(guards), count), -1)
    for c, own in enumerate(guards):
        table[c, : len(own)] = [read(g) for g in own]
    return table


def _parity(layout: _Layout, system: System) -> np.ndarray:
    states = [s for group in layout.effect_states for s in group] + list(layout.shunt_states)
    odd = np.ones(layout.n)
    for k, state in enumerate(states):
        odd[layout.n - len(states) + k] = 1.0 if state.odd else -1.0
    return -odd


def _exosystem(layout: _Layout, omega: np.ndarray, exo_scale: np.ndarray) -> np.ndarray:
    """Generator of the exogenous states: pairs (sine, cosine), or (value, slope), and the constant."""
    matrix = np.zeros((layout.exogenous, layout.exogenous))
    if not len(omega):
        matrix[0, 1] = 1.0
    for k, w in enumerate(omega):
        matrix[2 * k, 2 * k + 1], matrix[2 * k + 1, 2 * k] = w, -w
    return matrix * exo_scale[..., None, :] / exo_scale[..., :, None]


def _exo_scale(layout, equations, scale, signal, tr) -> np.ndarray:
    """Scales that give every exogenous column entries of the size of the resonance frequency."""
    n = layout.n
    mass = np.max(np.abs(equations[..., n : 2 * n] * scale[..., None, None, :]), axis=-1)
    columns = np.abs(equations[..., 2 * n :]) / np.where(mass > 0, mass, 1.0)[..., None]
    size = np.max(columns, axis=(-3, -2))
    resonance = np.sqrt(_scalar(tr.stiffness) / _scalar(tr.mass))[..., None]
    found = np.where(size > 0, resonance / np.where(size > 0, size, 1.0), 1.0)
    if isinstance(signal, Tones):
        for k in range(len(signal.frequencies)):
            found[..., 2 * k + 1] = found[..., 2 * k]
    else:
        found[..., 1] = found[..., 0] * resonance[..., 0]
    return found


def _largest_step(excitation: Excitation, signal: Tones | Ramps) -> float:
    """An eighth of the shortest period of the drive, or the spacing of its breakpoints."""
    if isinstance(signal, Tones):
        return float(0.125 / np.max(signal.frequencies))
    return float(np.min(np.diff(signal.times)))
