"""The transducer's equations as rows, and the layout of what the rows run over."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np

from piezoharvest.circuit import Port, Product, State
from piezoharvest.engine import program as pg
from piezoharvest.excitation import Excitation, Ramps, Tones
from piezoharvest.system import System


def scalar(value) -> np.ndarray:
    """A coefficient without the trailing axis that batches carry for the sake of rows."""
    value = np.asarray(value, float)
    return value[..., 0] if value.ndim else value


def stack(values) -> np.ndarray:
    """Coefficients as the last axis of one array."""
    return np.stack(np.broadcast_arrays(*[scalar(v) for v in values]), axis=-1)


class Layout:
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
        self.stop_states = np.arange(self.charge + 1, self.charge + 1 + len(self.stops))

    def row(self, column: int) -> np.ndarray:
        """Unit row of a column."""
        unit = np.zeros(self.width)
        unit[column] = 1.0
        return unit

    def z(self, name: str) -> np.ndarray:
        """Row of a state."""
        return self.row(self.names.index(name))

    def dz(self, name: str) -> np.ndarray:
        """Row of a state's derivative."""
        return self.row(self.n + self.names.index(name))

    @property
    def one(self) -> np.ndarray:
        """Row of the constant 1."""
        return self.row(-1)

    def group(self, prefix: str, states: Sequence[State]) -> tuple[SimpleNamespace, SimpleNamespace]:
        """A component's states and their derivatives, by the names that the component gave them."""
        pairs = [(s.name, prefix + s.name) for s in states]
        return (
            SimpleNamespace(**{short: self.z(name) for short, name in pairs}),
            SimpleNamespace(**{short: self.dz(name) for short, name in pairs}),
        )


class Physics:
    """The transducer's rows: what every configuration of the shunt has in common."""

    def __init__(self, system: System, excitation: Excitation, layout: Layout, signal: Tones | Ramps):
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
        drive = signal.offset * lay.one
        for k in tones:
            drive = drive + signal.amplitudes[..., k] * sines[k]
        return drive

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
        matrix = stack(diagonal)[..., None] * np.eye(lay.n)
        matrix = matrix + scalar(tr.capacitance)[..., None, None] * v_t[..., :, None] * v_t[..., None, :]
        return matrix, stack(scale)
