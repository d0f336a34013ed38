"""Model of a transducer with its effects and its load, driven by a record: equations as rows, with scalar elements.

Rows have columns for the constant 1, time, the drive and its rate, states and their rates, algebraic signals, and the
outputs of scalar elements (Lur'e form). Effects add their terms by the methods of `RecordModel`; the linear equations
are then solved once for the rates of the states, and nonlinearities remain in the elements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.circuit import Port, Row
from piezoharvest.description.effects.nameless.curves import CODES
from piezoharvest.description.effects.nameless.sizes import RecordSizes, length_of
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt, Resistor, Short, Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.equations.laws import (
    charge_law,
    drive_gain,
    hysteresis_voltage,
    momentum,
    node_law,
    participating,
    spring,
    strain_charge,
)
from piezoharvest.predict.propagation.element_kinds import (
    CURVE,
    HINGE,
    POSITIVE_POWER,
    POWER,
    PRODUCT,
    SQUARED_HINGE,
    STOP,
)

COLUMNS = (
    96  # at first: a transducer of six modes with ten operators and five effects; doubled as long as more are needed
)
INPUTS = ("drive", "drive_rate", "one", "time")
# An imposed voltage, zero for a short, reaches the electrodes through leads whose time constant is this fraction of a
# sample.
LEADS = 1e-4


class ScalarElement(NamedTuple):
    """Scalar element of one or two rows: its kind, its rows, and its threshold, exponent or knot."""

    kind: int
    first: Row
    second: Row
    parameter: complex


@dataclass(frozen=True)
class Matrices:
    """Linear part of a specimen, in states scaled to the root of energy.

    z' = A z + B e + W w and [inputs of the elements; rates of these; outputs] = O [z; w; e], with e the drive, its
    rate, 1 and time, and w the outputs of the elements. Those of several specimens that differ in complex steps only
    have these as first axis of A, B, W, O, `parameters` and `follow`.

    Attributes
    ----------
    A : (n, n) array
    B : (n, 4) array
    W : (n, elements) array
    O : (2 * inputs + outputs, n + elements + 4) array
    scale : (n,) array
        States are scale * z in SI units.
    kinds : (elements,) array
    parameters : (elements,) array
        Thresholds of the stops, exponents of the powers, knots of the hinges.
    places : (elements, 2) array
        Inputs of each element, as indices.
    rated, straight : (inputs,) array of bool
        The rate of the part of the input that no element's output reaches directly is known; it is a straight line in
        time.
    channels : tuple of str
        Outputs.
    states : tuple of str
    memories : tuple of str
        Names of the stops' memories, after the state that each one follows.
    follow : (n, n) array
        Initial deviations of all states from those of the free ones: a sensor with lag has followed its input.
    own : tuple of (int, int)
        States that effects have added: index of the effect, and of the state.
    """

    A: np.ndarray
    B: np.ndarray
    W: np.ndarray
    O: np.ndarray  # noqa: E741
    scale: np.ndarray
    kinds: np.ndarray
    parameters: np.ndarray
    places: np.ndarray
    rated: np.ndarray
    straight: np.ndarray
    channels: tuple[str, ...]
    states: tuple[str, ...]
    memories: tuple[str, ...]
    follow: np.ndarray
    own: tuple[tuple[int, int], ...] = ()


VARYING = ("A", "B", "W", "O", "parameters", "follow")  # arrays of `Matrices` that depend on values


class _TooNarrowError(Exception):
    """More columns are needed than rows have."""


class RecordModel:
    """Specimen on the test bench, as equations to which effects may add terms.

    Parameters
    ----------
    transducer : Transducer
        Its effects act in the given order. Its values may be columns (k, 1) that differ in complex steps only: the
        equations are then written once for all of these specimens.
    shunt : Shunt or None
        A linear circuit, or None under an imposed voltage.
    drive : str
        The imposed channel.
    sample_time : float
        s between samples.
    size : (float, float), optional
        Amplitude and frequency of the drive.

    Attributes
    ----------
    one, time, drive, drive_rate : Row
        1, time as fraction of the record, the drive in its unit, and its rate.
    x, u, q, v_t, v, i, strain_charge : Row
        Displacement (m) and velocity of the first mode, charge, voltage across the capacitance and at the electrodes,
        load current, and sum T_i x_i.

    Raises
    ------
    ParameterError
        The shunt is not a linear circuit, or requires a capacitance that a record does not determine.
    """

    reads = True
    further: Mapping[str, Row] = MappingProxyType({})

    def __init__(
        self, transducer: Transducer, shunt: Shunt | None, drive: str, sample_time: float,
        size: RecordSizes | None = None,
    ) -> None:  # fmt: skip
        transducer = transducer.settled(sample_time) if transducer.quasi_static else transducer
        self.transducer, self.sample_time, self.drive_name = transducer, sample_time, drive
        self.size = size
        self._width = COLUMNS
        while True:
            try:
                self._write(shunt)
                return
            except _TooNarrowError:  # a score test has the effects of a whole library at many start values at once
                self._width *= 2

    def _write(self, shunt: Shunt | None) -> None:
        """Write all equations, in rows of the present width."""
        transducer = self.transducer
        self._loaded = shunt is None or shunt.loaded
        self._used = 0
        self.drive, self.drive_rate, self.one, self.time = (self._column() for _ in INPUTS)
        self.elapsed = length_of(self.size) * self.time
        self._states: list[tuple[str, Row, Row, complex]] = []
        self._signals: list[Row] = []
        self._equations: list[Row] = []
        self._elements: list[tuple[ScalarElement, Row]] = []
        self._charges: list[Row] = []
        self._drawn: list[Row] = []
        self._conducted: list[Row] = []
        self._read: dict[str, list[Row]] = {}
        self._lags: list[complex] = []
        self._followers: dict[str, Row] = {}
        self._modes()
        self.q, self._dq = self.state("q", 1.0 / transducer.capacitance)
        self.v_t, self.v, self.i = (self.signal() for _ in range(3))
        self._pushes: list[list[Row]] = [[] for _ in transducer.all_modes]
        self._own: list[tuple[int, int]] = []
        for n, effect in enumerate(transducer.effects):
            shunt, first = shunt and effect.connect(shunt), len(self._states)
            effect.act(self)
            self._own += [(n, k) for k in range(first, len(self._states))]
        self._electrics(shunt)
        self._mechanics()

    # Methods used by effects.

    def state(self, name: str, storage: complex) -> tuple[Row, Row]:
        """Add a state whose energy is about storage z^2/2: rows of it and of its rate; an equation has to follow."""
        z, dz = self._column(), self._column()
        self._states.append((name, z, dz, np.abs(storage) ** -0.5))
        return z, dz

    def signal(self) -> Row:
        """Add an algebraic signal; an equation has to follow."""
        self._signals.append(self._column())
        return self._signals[-1]

    def equation(self, residual: Row) -> None:
        """Add an equation: a row that is zero."""
        self._equations.append(residual)

    def stop(self, row: Row, threshold: complex) -> Row:
        """Stop operator of a state, started from zero."""
        return self._element(ScalarElement(STOP, row, row, threshold))

    def product(self, first: Row, second: Row) -> Row:
        """Product of two rows."""
        return self._element(ScalarElement(PRODUCT, first, second, 0.0))

    def power(self, row: Row, exponent: float, *, positive: bool = False) -> Row:
        """Integer power of a row; with `positive` any power of its positive part, zero below."""
        return self._element(ScalarElement(POSITIVE_POWER if positive else POWER, row, row, exponent))

    def hinges(self, row: Row, corners: Sequence[tuple[float, Any, Any]], order: int = 1) -> Row:
        """Sum of c max(s (x - k), 0)^order / order of a row x over corners (s, k, c)."""
        total, kind = 0.0 * row, {1: HINGE, 2: SQUARED_HINGE}[order]
        for side, knot, kink in corners:
            each = self._element(ScalarElement(kind, side * row, side * row, side * knot))
            total = total + kink / order * each
        return total

    def curve(self, name: str, row: Row) -> Row:
        """Add a curve of a row, by its name."""
        return self._element(ScalarElement(CURVE + CODES[name], row, row, 0.0))

    def charge(self, row: Row) -> None:
        """Add a charge on the electrodes beside C v_t and sum T_i x_i, C."""
        self._charges.append(row)

    def draw(self, row: Row) -> None:
        """Add a current that leaves the node beside the load, A."""
        self._drawn.append(row)

    def push(self, row: Row, mode: int = 0) -> None:
        """Add a force on a mode, N."""
        self._pushes[mode].append(row)

    def conduct(self, row: Row) -> None:
        """Add a current through the load, which its sensor sees, A."""
        if self._loaded:
            self._conducted.append(row)

    def read(self, row: Row, channel: str = "displacement") -> None:
        """Add to what the sensor of a channel reads, in the channel's unit."""
        self._read.setdefault(channel, []).append(row)

    def lag(self, time_constant: complex) -> None:
        """Put a first-order lag into the displacement sensor."""
        self._lags.append(time_constant)

    # Internal methods.

    def _column(self) -> Row:
        if self._used == self._width:
            raise _TooNarrowError
        row = np.zeros(self._width)
        row[self._used] = 1.0
        self._used += 1
        return row

    def _element(self, element: ScalarElement) -> Row:
        self._elements.append((element, self._column()))
        return self._elements[-1][1]

    def _modes(self) -> None:
        """Displacements and velocities of the modes; an imposed displacement is no state."""
        modes, self._motion = self.transducer.all_modes, []
        if self.drive_name == "displacement":
            if len(modes) > 1:
                raise ParameterError(
                    "transducer.modes", "found further modes, but only one is allowed where the displacement is imposed"
                )
            self._motion = [(self.drive, self.drive_rate, None)]
        else:
            for n, mode in enumerate(modes, 1):
                x, dx = self.state(f"x{n}", mode.stiffness)
                u, du = self.state(f"u{n}", mode.mass)
                self.equation(dx - u)
                self._motion.append((x, u, du))
        self.x, self.u, _ = self._motion[0]
        self.strain_charge = strain_charge(modes, [x for x, _, _ in self._motion], 0.0 * self.one)

    def _electrics(self, shunt: Shunt | None) -> None:
        device, hysteresis = self.transducer, self.transducer.hysteresis
        none = 0.0 * self.one
        self.equation(charge_law(device.capacitance, self.v_t, self.strain_charge, sum(self._charges, none), self.q))
        thresholds, weights = (hysteresis.thresholds, hysteresis.weights) if hysteresis else ((), ())
        stops = [self.stop(self.q, threshold) for threshold in thresholds]
        self.equation(self.v - self.v_t - hysteresis_voltage(weights, stops, none))
        drawn = sum(self._drawn, none) + sum(self._conducted, none)
        self.equation(node_law(self._dq, self.i, drawn))
        source = self.drive if self.drive_name == "voltage" else 0.0 * self.one
        if self.drive_name == "voltage" or isinstance(shunt, Short):
            # Leads with a negligible time constant avoid an algebraic loop through the operators.
            shunt = Resistor(resistance=LEADS * self.sample_time / device.capacitance)
        if not isinstance(shunt, LinearShunt):
            kind = getattr(shunt, "kind", None)
            raise ParameterError("shunt", f"found {kind!r}, but a record that is fitted needs a linear circuit")
        port = Port(self.v - source, self._voltage_rate(), self.i, self.one, device.capacitance)
        own = [
            (state.name, *self.state(f"shunt_{state.name}", state.storage))
            for state in shunt.states(device.capacitance)
        ]
        rows = [SimpleNamespace(**{row[0]: row[k] for row in own}) for k in (1, 2)]
        for residual in shunt.equations("linear", port, *rows):
            if np.any(np.isnan(residual)):
                must = "must be a circuit without a capacitor across the leads, beside hysteresis or another charge"
                raise ParameterError("shunt", f"found {shunt.kind!r}, {must}")
            self.equation(residual)

    def _voltage_rate(self) -> Row:
        """Rate of the electrode voltage, V/s; not a number where it is one of more than the states of the specimen."""
        if self.transducer.hysteresis or self._charges:
            return np.nan * self.one
        rates = [u for _, u, _ in self._motion]
        moving = strain_charge(self.transducer.all_modes, rates, 0.0 * self.one)
        return (self._dq - moving) / self.transducer.capacitance

    def _mechanics(self) -> None:
        modes, base = self.transducer.all_modes, self.drive_name == "base_acceleration"
        none = 0.0 * self.one
        specimen = participating(modes, [x for x, _, _ in self._motion], none)
        velocity = participating(modes, [u for _, u, _ in self._motion], none)
        self._reading = specimen + sum(self._read.get("displacement", ()), none)
        self._moving = {"velocity": velocity}
        rates = [du for _, _, du in self._motion if du is not None]
        if rates:
            self._moving["acceleration"] = participating(modes, rates, none)
        behind = 0.0
        for n, time_constant in enumerate(self._lags):
            behind = behind + time_constant
            if np.all(np.real(time_constant) == 0):
                # To first order a lag subtracts the velocity; this suffices for a derivative.
                self._reading = self._reading - time_constant * velocity
                continue
            z, dz = self.state(f"reading{n}", modes[0].stiffness)
            self.equation(time_constant * dz + z - self._reading)
            self._reading = z
            self._followers[f"reading{n}"] = np.asarray(specimen - behind * velocity)
        self._force = 0.0 * self.one
        for n, (mode, (x, u, du)) in enumerate(zip(modes, self._motion, strict=True)):
            pushes = sum(self._pushes[n], none)
            if du is None:
                self._force = spring(mode, x, u, self.v_t, pushes)
                continue
            acts = self.drive - sum(self._read.get(self.drive_name, []), none)  # without what its sensor shows besides
            driven = none if self.drive_name == "voltage" else drive_gain(mode, base) * acts
            self.equation(momentum(mode, x, u, du, self.v_t, driven + pushes))

    def matrices(self) -> Matrices:
        """Solve the equations for the rates and signals."""
        z, dz = [state[1] for state in self._states], [state[2] for state in self._states]
        # A complex step does not change a magnitude.
        scale = np.array([np.ravel(state[3])[0] for state in self._states])
        columns = [int(np.argmax(row)) for row in [*dz, *self._signals]]
        states = [int(np.argmax(row)) for row in z]
        outs = [int(np.argmax(w)) for _, w in self._elements]
        rows = _stacked(self._equations)
        size = np.abs(rows).max(axis=-1, keepdims=True)
        # Unknown rates and signals from states, elements and inputs.
        solution = np.linalg.solve(rows[..., columns] / size, -rows / size)

        def explicit(wanted: list[Row]) -> np.ndarray:
            full = _stacked(wanted)
            full = full + full[..., columns] @ solution
            return np.concatenate([full[..., states] * scale, full[..., outs], full[..., : len(INPUTS)]], axis=-1)

        n, elements = len(z), [element for element, _ in self._elements]
        rates = explicit(dz) / scale[:, None]
        inputs, places = self._distinct(elements)
        outputs = {
            "displacement": self._reading, **self._moving, "voltage": self.v,
            "current": self.i + sum(self._conducted), "force": self._force,
        }  # fmt: skip
        for name in outputs.keys() & self._read.keys() - {"displacement"}:
            outputs[name] = outputs[name] + sum(self._read[name])
        if self.drive_name != "displacement":
            del outputs["force"]
        channels = tuple(name for name in outputs if name != self.drive_name)
        B, w = rates[..., n + len(elements) :], len(elements)
        seen = explicit([*inputs.values(), *(outputs[name] for name in channels)])
        slopes, rated, straight = _rates_of(seen[..., : len(inputs), :], rates)
        observed = np.concatenate([seen[..., : len(inputs), :], slopes, seen[..., len(inputs) :, :]], axis=-2)
        name_of = {self._content(row): name for name, row, _, _ in self._states}
        contents = list(inputs)
        followed = [
            name_of.get(contents[first], "drive") for e, (first, _) in zip(elements, places, strict=True)
            if e.kind == STOP
        ]  # fmt: skip
        memories = tuple(f"history {name}{followed[:k].count(name)}" for k, name in enumerate(followed))
        return Matrices(
            A=rates[..., :n], W=rates[..., n : n + w], B=B, O=observed, scale=scale,
            kinds=np.array([e.kind for e in elements], np.int64), parameters=_parameters(elements),
            places=places, rated=rated, straight=straight, channels=channels,
            states=tuple(state[0] for state in self._states),
            memories=memories, follow=self._followed(states, scale), own=tuple(self._own),
        )  # fmt: skip

    def _followed(self, states: list[int], scale: np.ndarray) -> np.ndarray:
        """`Matrices.follow`."""
        rows = [
            self._followers[name][..., states] * scale / size if name in self._followers else unit
            for (name, *_), size, unit in zip(self._states, scale, np.eye(len(scale)), strict=True)
        ]
        return _stacked(rows)

    def _distinct(self, elements: list[ScalarElement]) -> tuple[dict[bytes, Row], np.ndarray]:
        """Distinct inputs of the elements by their content, and their indices for every element.

        A row that is zero is one of its own: it may be that of an effect at its null value, whose derivatives differ.
        """

        def key(row: Row, n: int) -> bytes:
            return self._content(row) + (b"" if np.any(np.real(row)) else f" {n}".encode())

        pairs = [(key(e.first, n), key(e.second, n)) for n, e in enumerate(elements)]
        inputs: dict[bytes, Row] = {}
        for element, (first, second) in zip(elements, pairs, strict=True):
            inputs.setdefault(first, element.first)
            inputs.setdefault(second, element.second)
        order = {content: n for n, content in enumerate(inputs)}
        places = [(order[first], order[second]) for first, second in pairs]
        return inputs, np.array(places, np.int64).reshape(len(elements), 2)

    def _content(self, row: Row) -> bytes:
        """Key of the numbers of a row, the same for real and complex ones, one and several, zeros of either sign."""
        numbers = row[..., : self._used] + 0.0j
        if numbers.ndim > 1 and np.all(numbers == numbers[0]):
            numbers = numbers[0]
        return numbers.tobytes()


def _stacked(rows: Sequence[Row]) -> np.ndarray:
    """Rows as a matrix, or as one for each of several specimens, (..., rows, columns)."""
    several = max((row.shape[:-1] for row in rows), key=len)
    found = np.empty((*several, len(rows), rows[0].shape[-1]), complex if any(map(np.iscomplexobj, rows)) else float)
    for k, row in enumerate(rows):
        found[..., k, :] = row
    return found


def _rates_of(seen: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rates of the elements' inputs, as rows like theirs; which of them are known, and which inputs are straight lines.

    They are without what the outputs of elements contribute that reach an input directly, not by way of the states.
    That of an input which depends on the rate of the drive is not known, nor that of one that depends on time, whose
    unit is the length of a record; of time alone it is a straight line.
    """
    n, first = rates.shape[-2], seen.shape[-1] - len(INPUTS)
    drive, drive_rate, _, time = range(first, seen.shape[-1])
    found = seen[..., :n] @ rates
    found[..., drive_rate] += seen[..., drive]

    def reached(*columns: int) -> np.ndarray:
        return np.any(seen[..., columns] != 0.0, axis=(*range(seen.ndim - 2), -1))

    rated = ~reached(drive_rate, time)
    return np.where(rated[:, None], found, 0.0), rated, ~reached(*range(first), drive, drive_rate)


def _parameters(elements: Sequence[ScalarElement]) -> np.ndarray:
    """`Matrices.parameters`."""
    return _stacked([np.atleast_1d(element.parameter) for element in elements])[..., 0] if elements else np.zeros(0)
