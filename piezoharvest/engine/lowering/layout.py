"""The transducer's equations as rows, and the layout of their columns."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np

from piezoharvest.description.circuit import Product, Row, State
from piezoharvest.description.excitation import Excitation, Ramps, Tones
from piezoharvest.description.system import System
from piezoharvest.engine.memory import program as pg
from piezoharvest.equations.circuits import circuit_states
from piezoharvest.equations.laws import hysteresis_voltage
from piezoharvest.equations.rows import device, own_rows
from piezoharvest.equations.terms import PRODUCT, Rows, SmoothElement, Terms, state_names


def scalar(value) -> np.ndarray:
    """Coefficient without the trailing axis of length one that batches have."""
    value = np.asarray(value)
    return value[..., 0] if value.ndim else value


def stack(values) -> np.ndarray:
    """Coefficients as the last axis of one array."""
    return joined([scalar(value) for value in values], -1)


def joined(parts, axis: int) -> np.ndarray:
    """Arrays stacked along a new axis, counted from the end; those without the axes of a batch hold for all designs.

    As `numpy.stack` of `numpy.broadcast_arrays`, in a third of the time, which dominates lowering.
    """
    shapes = {part.shape for part in parts}
    shape = shapes.pop() if len(shapes) == 1 else np.broadcast_shapes(*shapes)
    where = len(shape) + 1 + axis
    if where == 0 and not shapes:  # no batch
        return np.array(parts)
    kind = np.result_type(*{part.dtype for part in parts})
    out = np.empty((*shape[:where], len(parts), *shape[where:]), kind)
    by_part = np.moveaxis(out, where, 0)
    for k, part in enumerate(parts):
        by_part[k] = part
    return out


def rows_of(rows, width: int) -> np.ndarray:
    """Rows as the second axis from the end of one array; an empty list gives none."""
    if not len(rows):
        return np.zeros((0, width))
    return joined(rows, -2)


class Layout:
    """Columns of the rows: [states | derivatives | exogenous], and named access to them."""

    def __init__(self, system: System, terms: Terms, signal: Tones | Ramps, preloaded: bool):
        transducer, shunt = system.transducer, system.shunt
        hysteresis = transducer.hysteresis
        self.modes, self.terms = transducer.all_modes, terms
        pairs = zip(hysteresis.thresholds, hysteresis.weights, strict=True) if hysteresis else ()
        self.operators: tuple[tuple[float, float], ...] = tuple(pairs)
        self.effects = tuple(dict.fromkeys(effect.name for effect in transducer.effects))
        self.shunt_states = circuit_states(system)
        # Under a preload open electrodes begin relaxed as well, with a charge.
        charged = range(1 + len(transducer.electrodes)) if preloaded else shunt.taken
        self.charged = sorted({0, *charged})
        self.names = state_names(transducer, self.charged)
        self.charge = self.names.index(f"q{shunt.electrode}" if shunt.electrode else "q")
        own = len(self.names)
        self.names += [f"stop{j + 1}" for j in range(len(self.operators))] + [stop.name for stop in terms.stops]
        self.stop_states = np.arange(own, len(self.names))
        self.names += [state.name for state in terms.states]
        self.names += [state.name for state in self.shunt_states]
        self.n = len(self.names)
        own_products = shunt.multiplied
        products = [SmoothElement(name, terms.nothing, terms.nothing, PRODUCT) for name in own_products]
        self.elements = [*terms.elements, *products]  # of whose inputs only those of the terms are rows of them
        self.signal = pg.DERIVATIVES * len(self.elements)  # where it begins in the exogenous states
        self.exogenous = self.signal + (2 * signal.frequencies.shape[-1] if isinstance(signal, Tones) else 2) + 1
        self.width = 2 * self.n + self.exogenous
        eye = np.eye(self.width)
        self.z = dict(zip(self.names, eye[: self.n], strict=True))
        self.dz = dict(zip(self.names, eye[self.n : 2 * self.n], strict=True))
        self.exo, self.one = eye[2 * self.n :], eye[-1]
        names = [*(element.name for element in terms.elements), *own_products]
        own = (self.exo[d : self.signal : pg.DERIVATIVES] for d in range(2))
        self.smooth, self.smooth_rates = (dict(zip(names, rows, strict=True)) for rows in own)

    @property
    def added_states(self) -> list[State]:
        """States of the effects and of the shunt: the last ones, in their order."""
        return [*self.terms.states, *self.shunt_states]

    @property
    def stop_inputs(self) -> list[np.ndarray]:
        """Inputs of the stops as rows over the states: the charge for the hysteresis, the effects' rows for theirs."""
        inputs = [self.z["q"]] * len(self.operators)
        return [*inputs, *(self.terms.over(stop.row, self.z) for stop in self.terms.stops)]


class Physics:
    """Rows of the transducer, common to all configurations of the shunt."""

    def __init__(self, system: System, excitation: Excitation, layout: Layout, signal: Tones | Ramps):
        self.transducer, self.shunt, self.layout = system.transducer, system.shunt, layout
        z, dz = layout.z, layout.dz
        drive = _drive(layout, signal)
        self.v_h, dv_h = self._hysteresis(z), self._hysteresis(dz)
        rows, rates = {**z, **layout.smooth}, {**dz, **layout.smooth_rates}
        hysteresis, kind = (self.v_h, dv_h), (excitation.base, excitation.imposed)
        self.device = device(layout.terms, rows, rates, drive, layout.one, hysteresis, *kind)
        self.motion, self.ports = self.device.motion, self.device.ports
        self.port = self.ports[system.shunt.electrode]
        self.strain_current = self.port.strain_current
        self.drive = self.motion.drive

    def _hysteresis(self, rows: Rows) -> Row:
        """Voltage of the hysteresis, or its rate."""
        operators = self.layout.operators
        stops = [rows[f"stop{j}"] for j in range(1, len(operators) + 1)]
        return hysteresis_voltage([weight for _, weight in operators], stops, 0.0 * self.layout.one)

    def equations(self, of_ports: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Residuals in the order of the states; the stops' rows are placeholders that each mode completes."""
        stops = [self.layout.dz[self.layout.names[k]] for k in self.layout.stop_states]
        return [*self.motion.equations, *of_ports, *stops, *self.device.equations]

    def circuit_rows(self) -> tuple[SimpleNamespace, SimpleNamespace]:
        """Rows of the shunt's states, among them its products, and of their rates."""
        layout = self.layout
        z, dz = (own_rows(rows, "", layout.shunt_states) for rows in (layout.z, layout.dz))
        for name in self.shunt.multiplied:
            setattr(z, name, layout.smooth[name])
        return z, dz

    def inputs(self) -> np.ndarray:
        """Rows of the inputs of the smooth elements, two for each."""
        pairs = [
            (self.device.placing.row(e.first), self.device.placing.row(e.second)) for e in self.layout.terms.elements
        ]
        factors = self.shunt.factors(self.port, self.circuit_rows()[0])
        pairs += [factors[name] for name in self.shunt.multiplied]
        return rows_of([row for pair in pairs for row in pair], self.layout.width)

    def products(self) -> list[tuple[int, Product]]:
        """Powers that do not depend on the configuration, with their categories."""
        z, modes = self.layout.z, self.layout.modes
        powers = [(pg.MECHANICAL_IN, Product(1.0, self.drive, self.motion.drive_velocity))]
        powers += [(pg.DAMPING, Product(m.damping, z[f"u{n}"], z[f"u{n}"])) for n, m in enumerate(modes, 1)]
        for name, product in self.layout.terms.losses:
            category = len(pg.CATEGORIES) + self.layout.effects.index(name)
            powers.append((category, self.device.placing.product(product)))
        return powers

    def storage(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrix of the stored energy z' storage z / 2 (J) over states and elements, and the scale of every state."""
        lay, capacitance = self.layout, self.transducer.capacitance
        diagonal, scale = [], []
        for mode in lay.modes:
            diagonal += [mode.stiffness, mode.mass]
            scale += [mode.stiffness**-0.5, mode.mass**-0.5]
        scale += [self.ports[number].capacitance ** 0.5 for number in lay.charged]
        scale += [capacitance**0.5] * len(lay.operators)
        diagonal += [*[0.0] * len(lay.charged), *(w for _, w in lay.operators)]
        diagonal += [0.0] * (len(lay.terms.stops) + len(lay.terms.states))
        diagonal += [state.storage if state.stores else 0.0 for state in lay.shunt_states]
        added = [state.size for state in lay.added_states]
        own = stack([*scale, *[0.0] * len(lay.terms.stops), *added])
        # A stop that an effect adds has the scale of its input, or of the largest part of that.
        for into in lay.stop_inputs[len(lay.operators) :]:
            scale.append(np.max(np.abs(np.real(into[..., : lay.n] * own)), axis=-1, keepdims=True))
        scale += added
        placing = self.device.placing
        diagonal += [0.0] * lay.signal
        matrix = stack(diagonal)[..., None] * np.eye(lay.n + lay.signal)
        matrix = matrix + 0.5 * self._energy(Product(capacitance, placing.v_t, placing.v_t))
        for port in self.ports.all[1:]:
            matrix = matrix + 0.5 * self._energy(Product(port.capacitance, port.v, port.v))
        matrix = sum((self._energy(placing.product(product)) for product in lay.terms.stored), matrix)
        return matrix, stack(scale)

    def _energy(self, product: Product) -> np.ndarray:
        """Matrix S of z S z/2 = coefficient * first * second."""
        n, elements = self.layout.n, slice(2 * self.layout.n, 2 * self.layout.n + self.layout.signal)
        first, second = (
            np.concatenate([row[..., :n], row[..., elements]], axis=-1) if self.layout.signal else row[..., :n]
            for row in (product.first, product.second)
        )
        outer = first[..., :, None] * second[..., None, :]
        return scalar(product.coefficient)[..., None, None] * (outer + outer.swapaxes(-1, -2))


def _drive(layout: Layout, signal: Tones | Ramps) -> np.ndarray:
    """Row of the driving signal over the exogenous states."""
    if isinstance(signal, Ramps):
        return layout.exo[layout.signal]
    drive = signal.offset * layout.one
    for k in range(signal.frequencies.shape[-1]):
        drive = drive + signal.amplitudes[..., k : k + 1] * layout.exo[layout.signal + 2 * k]
    return drive
