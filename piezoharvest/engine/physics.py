"""The transducer's equations as rows, and the layout of what the rows run over."""

from __future__ import annotations

import numpy as np

from piezoharvest.circuit import Port, Product, State
from piezoharvest.engine import program as pg
from piezoharvest.equations import capacitor_voltage, effect_prefixes, leads, mechanics, own_rows, state_names
from piezoharvest.excitation import Excitation, Ramps, Tones
from piezoharvest.system import System


def scalar(value) -> np.ndarray:
    """A coefficient without the trailing axis that batches carry for the sake of rows."""
    value = np.asarray(value)
    return value[..., 0] if value.ndim else value


def stack(values) -> np.ndarray:
    """Coefficients as the last axis of one array."""
    return joined([scalar(value) for value in values], -1)


def joined(parts, axis: int) -> np.ndarray:
    """Arrays along a new axis, counted from the end; those that do not carry the axes of a batch serve all designs.

    As `numpy.stack` of `numpy.broadcast_arrays`, in a third of the time, for lowering is little else.
    """
    shapes = {part.shape for part in parts}
    shape = shapes.pop() if len(shapes) == 1 else np.broadcast_shapes(*shapes)
    kind, where = np.result_type(*{part.dtype for part in parts}), len(shape) + 1 + axis
    out = np.empty((*shape[:where], len(parts), *shape[where:]), kind)
    by_part = np.moveaxis(out, where, 0)
    for k, part in enumerate(parts):
        by_part[k] = part
    return out


class Layout:
    """Columns of the rows: [states | derivatives | exogenous], and named access to them."""

    def __init__(self, system: System, signal: Tones | Ramps):
        transducer, shunt = system.transducer, system.shunt
        hysteresis = transducer.hysteresis
        self.modes = transducer.all_modes
        self.stops = () if hysteresis is None else tuple(zip(hysteresis.thresholds, hysteresis.weights, strict=True))
        self.effects = effect_prefixes(transducer)
        self.shunt_states = shunt.states(transducer.capacitance)
        self.names = state_names(transducer)
        self.charge = len(self.names) - 1
        self.stop_states = np.arange(self.charge + 1, self.charge + 1 + len(self.stops))
        self.names += [f"stop{j + 1}" for j in range(len(self.stops))]
        self.names += [prefix + state.name for effect, prefix in self.effects for state in effect.states()]
        self.names += [state.name for state in self.shunt_states]
        self.n = len(self.names)
        self.exogenous = 2 * signal.frequencies.shape[-1] + 1 if isinstance(signal, Tones) else 3
        self.width = 2 * self.n + self.exogenous
        eye = np.eye(self.width)
        self.z = dict(zip(self.names, eye[: self.n], strict=True))
        self.dz = dict(zip(self.names, eye[self.n : 2 * self.n], strict=True))
        self.exo, self.one = eye[2 * self.n :], eye[-1]

    @property
    def added_states(self) -> list[State]:
        """States of the effects and of the shunt: the last ones, in their order."""
        return [*(state for effect, _ in self.effects for state in effect.states()), *self.shunt_states]


class Physics:
    """The transducer's rows: what every configuration of the shunt has in common."""

    def __init__(self, system: System, excitation: Excitation, layout: Layout, signal: Tones | Ramps):
        self.transducer, self.layout = system.transducer, layout
        z, dz = layout.z, layout.dz
        self.drive = _drive(layout, signal)
        self.motion = mechanics(self.transducer, z, dz, self.drive, excitation.base)
        stops = range(len(layout.stops))
        nothing = 0.0 * layout.one
        self.v_h = sum((layout.stops[j][1] * z[f"stop{j + 1}"] for j in stops), nothing)
        dv_h = sum((layout.stops[j][1] * dz[f"stop{j + 1}"] for j in stops), nothing)
        self.v = capacitor_voltage(self.transducer, z) + self.v_h
        dv = capacitor_voltage(self.transducer, dz) + dv_h
        # An effect must not use the load current, which its own current decides.
        self.bare = Port(self.v, dv, np.full(layout.width, np.nan), layout.one, self.transducer.capacitance)
        self.port, self.effect_equations = leads(self.transducer, self.bare, z, dz)

    def equations(self, port_equation: np.ndarray) -> list[np.ndarray]:
        """Residuals in the order of the states; the stops' rows are placeholders that each mode completes."""
        stops = [self.layout.dz[f"stop{j + 1}"] for j in range(len(self.layout.stops))]
        return [*self.motion.equations, port_equation, *stops, *self.effect_equations]

    def products(self) -> list[tuple[int, Product]]:
        """Powers that do not depend on the configuration, with their categories."""
        z, dz, modes = self.layout.z, self.layout.dz, self.layout.modes
        powers = [(pg.MECHANICAL_IN, Product(1.0, self.drive, self.motion.drive_velocity))]
        powers += [(pg.DAMPING, Product(m.damping, z[f"u{n}"], z[f"u{n}"])) for n, m in enumerate(modes, 1)]
        for k, (effect, prefix) in enumerate(self.layout.effects):
            own = own_rows(z, prefix, effect.states()), own_rows(dz, prefix, effect.states())
            powers += [(len(pg.CATEGORIES) + k, product) for product in effect.losses(self.bare, *own)]
        return powers

    def storage(self) -> tuple[np.ndarray, np.ndarray]:
        """Stored energy as a matrix over the states (J = z storage z / 2), and the scale of every state."""
        lay, capacitance = self.layout, self.transducer.capacitance
        diagonal, scale = [], []
        for mode in lay.modes:
            diagonal += [mode.stiffness, mode.mass]
            scale += [mode.stiffness**-0.5, mode.mass**-0.5]
        diagonal += [0.0] + [w for _, w in lay.stops]
        scale += [capacitance**0.5] * (1 + len(lay.stops))
        for state in lay.added_states:
            diagonal.append(state.storage)
            scale.append(np.abs(state.storage) ** -0.5)
        v_t = capacitor_voltage(self.transducer, lay.z)[..., : lay.n]
        matrix = stack(diagonal)[..., None] * np.eye(lay.n)
        matrix = matrix + scalar(capacitance)[..., None, None] * v_t[..., :, None] * v_t[..., None, :]
        return matrix, stack(scale)


def _drive(layout: Layout, signal: Tones | Ramps) -> np.ndarray:
    """Row of the driving signal over the exogenous states."""
    if isinstance(signal, Ramps):
        return layout.exo[0]
    drive = signal.offset * layout.one
    for k in range(signal.frequencies.shape[-1]):
        drive = drive + signal.amplitudes[..., k : k + 1] * layout.exo[2 * k]
    return drive
