"""Linear model M z' = N z + B w of a transducer, its effects and a circuit, assembled from their equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from types import SimpleNamespace
from typing import Any

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.circuit import Product, Row, State
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import LinearShunt, Shunt
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.equations.circuits import circuit_equations, circuit_powers, circuit_states
from piezoharvest.equations.rows import Ports, connected, device, own_rows
from piezoharvest.equations.terms import Rows, Terms, state_names

OperatingPoint = str | Sequence[bool]
Termination = Callable[[Ports, SimpleNamespace, SimpleNamespace, Mapping[str, Row]], Sequence[Row]]
CANCELLED = "the circuit cancels the transducer's capacitance exactly"


@dataclass(frozen=True)
class LinearModel:
    """M z' = N z + B w, with outputs and powers as rows over [z | dz | w | 1].

    For a batch of designs every array has the batch as its leading axis.

    Attributes
    ----------
    states, inputs : tuple of str
        Names of z (x1, u1, ... in m and m/s, q in C, then those of the effects and of the circuit) and of w.
    M, N : (..., n, n) array
    B : (..., n, m) array
    rows : mapping of str to Row
        "displacement" (m), "velocity" (m/s), "voltage" (V), "current" (load current, A), "charge" (q_p, C) and
        "drive_velocity" (conjugate of the drive: their product is its power; W per N or per m/s^2).
    powers : mapping of str to sequence of Product
        Powers of the shunt by category, W.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    M: np.ndarray
    N: np.ndarray
    B: np.ndarray
    rows: Mapping[str, Row]
    powers: Mapping[str, Sequence[Product]]

    def split(self, row: Row) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients of z, of dz and of the inputs in a row."""
        n = len(self.states)
        return row[..., :n], row[..., n : 2 * n], row[..., 2 * n : -1]

    def dynamics(self) -> tuple[np.ndarray, np.ndarray]:
        """A and B of z' = A z + B w.

        Raises
        ------
        ParameterError
            M is singular: the circuit cancels the transducer's capacitance exactly.
        """
        try:
            solution = np.linalg.solve(self.M, np.concatenate((self.N, self.B), axis=-1))
        except np.linalg.LinAlgError:
            raise ParameterError("capacitance", f"{CANCELLED}, use another value") from None
        return solution[..., : len(self.states)], solution[..., len(self.states) :]

    def explicit(self, outputs: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A, B, C, D of z' = A z + B w, y = C z + D w, with the named rows as outputs y; raises as `dynamics` does."""
        a, b = self.dynamics()
        parts = [self.split(self.rows[output]) for output in outputs]
        z, dz, w = (np.stack(np.broadcast_arrays(*part), axis=-2) for part in zip(*parts, strict=True))
        return a, b, z + dz @ a, w + dz @ b

    def phasors(self, omega: np.ndarray) -> Callable[[Row], np.ndarray]:
        """Function that returns the transfer functions of a row at angular frequencies `omega` (f,), rad/s.

        It maps a row to an array (..., f, inputs), complex; `omega` may also be a scalar, without the axis f.
        """
        s = 1j * np.asarray(omega, float)[..., None]
        m, n, b = (x[..., None, :, :] if x.ndim == 3 else x for x in (self.M, self.N, self.B))
        states = np.linalg.solve(s[..., None] * m - n, b + 0j)

        def transfer(row: Row) -> np.ndarray:
            z, dz, w = self.split(row[..., None, :] if row.ndim == 2 else row)
            return ((z + s * dz)[..., None, :] @ states)[..., 0, :] + w

        return transfer


def angular(frequencies: Any) -> np.ndarray:
    """Angular frequencies in rad/s from Hz.

    Raises
    ------
    ParameterError
        A frequency is not finite or not above zero (open electrodes keep their charge: no static gain).
    """
    require_positive("frequencies", frequencies, "Hz")
    return 2 * np.pi * np.asarray(frequencies, float)


def require_positive(key: str, value: Any, unit: str) -> None:
    """Raise `ParameterError` unless a number, or every number of an array, is finite and greater than zero."""
    numbers = np.asarray(value, float)
    bad = numbers[~(np.isfinite(numbers) & (numbers > 0))]
    if bad.size:
        raise ParameterError(key, f"found {bad.flat[0]}, must be a finite number greater than 0 {unit}")


def hysteresis_slope(
    transducer: Transducer, operating_point: OperatingPoint = "stick", amplitude: float | None = None
) -> complex:
    """Slope dv_h/dq of the hysteresis in V/C.

    Parameters
    ----------
    transducer : Transducer
    operating_point : "stick", "slip" or sequence of bool
        All operators stick (small signal), all slip, or True for each one that slips.
    amplitude : float, optional
        Charge amplitude in C; if given, the result is the describing function, complex.

    Raises
    ------
    ParameterError
        The operating point is none of these, or the amplitude is not positive.
    """
    hysteresis = transducer.hysteresis
    if amplitude is not None:
        require_positive("amplitude", amplitude, "C")
        return 0.0 if hysteresis is None else hysteresis.describing_function(amplitude)
    weights = () if hysteresis is None else hysteresis.weights
    if isinstance(operating_point, str):
        if operating_point not in ("stick", "slip"):
            raise ParameterError("operating_point", f'found "{operating_point}", must be "stick", "slip" or flags')
        operating_point = [operating_point == "slip"] * len(weights)
    if len(operating_point) != len(weights):
        found = f"found {counted(len(operating_point), 'flag')} for {counted(len(weights), 'operator')}"
        raise ParameterError("operating_point", f"{found}, each operator needs one")
    return sum((w for w, slips in zip(weights, operating_point, strict=True) if not slips), 0.0)


def assemble(
    transducer: Transducer,
    shunt: Shunt,
    *,
    slope: complex | None = None,
    base: bool = False,
    operating_point: OperatingPoint = "stick",
) -> LinearModel:
    """Rows of a transducer with its effects and a linear circuit across it.

    Parameters
    ----------
    transducer : Transducer
    shunt : LinearShunt
    slope : complex, optional
        Slope of the hysteresis in V/C; default all operators sticking. Complex for phasors.
    base : bool
        The input is base acceleration (m/s^2) instead of force (N).
    operating_point : "stick", "slip" or sequence of bool
        Stop operators of effects stick, which is elastic, except for "slip", where their output is zero. Nonlinear
        terms of other effects vanish for small motions.

    Raises
    ------
    ParameterError
        The shunt is not a linear circuit.
    """
    system = connected(System(transducer, shunt))
    shunt = system.shunt
    if not isinstance(shunt, LinearShunt):
        raise ParameterError("shunt", f"found {shunt.kind}, must be a linear circuit (no switches, no diodes)")
    return connect(
        transducer,
        lambda ports, z, dz, inputs: list(chain(*circuit_equations(shunt, "linear", ports, z, dz))),
        circuit_states(system),
        electrodes=shunt.taken,
        slope=slope,
        base=base,
        operating_point=operating_point,
        powers=lambda ports, z: circuit_powers(shunt, "linear", ports, z),
    )


def connect(
    transducer: Transducer,
    terminate: Termination,
    states: Sequence[State] = (),
    *,
    slope: complex | None = None,
    resistance: float = 0.0,
    base: bool = False,
    operating_point: OperatingPoint = "stick",
    electrical: Sequence[str] = (),
    electrodes: Sequence[int] = (0,),
    prefix: str = "shunt_",
    powers: Callable[[Ports, SimpleNamespace], Mapping[str, Sequence[Product]]] | None = None,
) -> LinearModel:
    """Rows of a transducer whose ports are terminated by `terminate`.

    Parameters
    ----------
    transducer : Transducer
    terminate : callable
        Given (ports, z, dz, inputs) it returns an equation for each port whose charge is a state, and for each of
        `states`.
    states : sequence of State
        States of the termination.
    slope, base, operating_point
        As in `assemble`.
    resistance : float
        In series with the transducer, ohm: represents the loss of the hysteresis at one frequency.
    electrical : sequence of str
        Names of electrical inputs, beside the drive.
    electrodes : sequence of int
        Numbers of the electrodes that are terminated. The first one's voltage and current are rows of the model; the
        charges of all, and that of the transducer's own, are states. The others are open.
    prefix : str
        Prefix of the names of `states`.
    powers : callable, optional
        Powers by category, given (ports, z).
    """
    inputs = ["base_acceleration" if base else "force", *electrical]
    terms = Terms(transducer, inputs[0], linearised=True)
    names = [*state_names(transducer, sorted(electrodes)), *(state.name for state in terms.states)]
    names += [prefix + state.name for state in states]
    z, dz, w, one = _unit_rows(names, inputs)
    z, dz = _with_stops(terms, z, operating_point), _with_stops(terms, dz, operating_point)
    hysteresis = _hysteresis(z, dz, hysteresis_slope(transducer) if slope is None else slope, resistance)
    motion, ports, of_effects = device(terms, z, dz, w[inputs[0]], one, hysteresis, base)[1:]
    own_z = own_rows(z, prefix, states)
    equations = [*motion.equations, *of_effects, *terminate(ports, own_z, own_rows(dz, prefix, states), w)]
    rows = {name: getattr(motion, name) for name in ("displacement", "velocity", "drive_velocity")}
    port = ports[electrodes[0]]
    rows |= {f"voltage{number}": ports[number].v for number in ports.charged if number}
    rows |= {"voltage": port.v, "current": port.i, "charge": z["q"]}
    rows |= {prefix + name: row for name, row in vars(own_z).items()}
    return _model(names, inputs, equations, rows, powers(ports, own_z) if powers else {})


def _with_stops(terms: Terms, rows: Rows, operating_point: OperatingPoint) -> Rows:
    """Rows of states, or of their rates, with those of the effects' stops."""
    sticks = 0.0 if operating_point == "slip" else 1.0
    return {**rows, **{stop.name: sticks * terms.over(stop.row, rows) for stop in terms.stops}}


def _hysteresis(z: Rows, dz: Rows, slope: complex, resistance: float) -> tuple[Row, Row]:
    """Voltage of the hysteresis and its rate, which must not be used if there is a resistance."""
    rate = slope * dz["q"] if np.all(np.equal(resistance, 0)) else np.nan * dz["q"]
    return slope * z["q"] + resistance * dz["q"], rate


def _unit_rows(names: list[str], inputs: list[str]):
    """Unit rows of the states, of their derivatives, of the inputs and of the constant."""
    n, eye = len(names), np.eye(2 * len(names) + len(inputs) + 1)
    z, dz = dict(zip(names, eye[:n], strict=True)), dict(zip(names, eye[n : 2 * n], strict=True))
    return z, dz, dict(zip(inputs, eye[2 * n : -1], strict=True)), eye[-1]


def _model(names, inputs, equations, rows, powers) -> LinearModel:
    """Stack the equations and split them by columns."""
    stacked = np.stack(np.broadcast_arrays(*equations), axis=-2)
    n = len(names)
    m, minus_n, minus_b = stacked[..., n : 2 * n], stacked[..., :n], stacked[..., 2 * n : -1]
    return LinearModel(tuple(names), tuple(inputs), m, -minus_n, -minus_b, rows, powers)
