"""A transducer from a model of its two-port: states in whatever coordinates, or transfer functions."""

from __future__ import annotations

from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.parameters import ParameterError, named_kind
from piezoharvest.description.transducer import Mode, Transducer
from piezoharvest.exchange.realisation import realised, responses
from piezoharvest.linear.statespace import linearize

_INPUTS, _OUTPUTS = ("force", "current"), ("displacement", "voltage")
_AGREES = 1e-6  # relative, of the responses: some thousand times what eigenvalues of six modes lose to rounding
_POINTS = 50  # frequencies at which they are compared


def transducer_from(system: Any) -> Transducer:
    """Transducer whose linear two-port a model of python-control or SciPy is; the inverse of `linearize`.

    Parameters
    ----------
    system : control.StateSpace, control.TransferFunction or scipy.signal.StateSpace
        Continuous time. Inputs `force` (N) and `current` (LOAD current, A, out of the leads), outputs `displacement`
        (m, of where the force acts) and `voltage` (V); without these names two of each, in this order. A third output
        without a name may be the velocity.

    Returns
    -------
    Transducer
        Modes by increasing short-circuit frequency, each scaled to a `force_participation` of 1.

    Raises
    ------
    ParameterError
        A signal is missing, or the system is not that of a transducer of modes that ring.

    Notes
    -----
    With v = c x held at zero by the current i = -c x'/(c b), what remains are the short-circuit modes, and
    c b = -1/C. At a pole s of theirs the residues of displacement and current over force are those of 1/(m s^2 + b s +
    k) and -s T/(m s^2 + b s + k).
    """
    model = _channels(system)
    a, force, current, displacement, voltage = model.a, *model.b.T, *model.c
    with np.errstate(all="ignore"):
        capacitance = -1.0 / (voltage @ current)
        shorted = np.eye(len(a)) + capacitance * np.outer(current, voltage)
        through = capacitance * voltage  # of x': the current that keeps the voltage at zero
        poles, vectors = np.linalg.eig(shorted @ a) if np.isfinite(shorted).all() else (np.zeros(0), np.zeros((0, 0)))
    if not capacitance > 0 or np.linalg.cond(vectors) > 1 / np.finfo(float).eps:
        raise ParameterError("system", "found no voltage that falls with the charge drawn, must be that of a capacitor")
    chosen = np.flatnonzero(np.imag(poles) > 1e-9 * np.max(np.abs(poles)))
    chosen = chosen[np.argsort(np.abs(poles[chosen]))]
    driven = np.linalg.solve(vectors, shorted @ force)
    moved = (displacement @ vectors * driven)[chosen]
    flowing = (through @ a @ vectors * driven)[chosen]
    pole = poles[chosen]
    with np.errstate(all="ignore"):
        mass = np.real(1.0 / (2j * np.imag(pole) * moved))
        coupling = np.real(flowing / moved / -pole)
    modes: list[dict[str, Any]] = [
        {"mass": float(m), "damping": float(-2 * s.real * m), "stiffness": float(abs(s) ** 2 * m), "coupling": float(t)}
        for s, m, t in zip(pole, mass, coupling, strict=True)
    ]
    return _checked(model, modes, float(capacitance))


class _Model(NamedTuple):
    """States driven by force and current (columns of b), seen as displacement and voltage (rows of c)."""

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray

    def responses(self, s: np.ndarray) -> np.ndarray:
        """Displacement and voltage over force and current at points s, (s, 2, 2)."""
        return self.c @ np.linalg.solve(s[:, None, None] * np.eye(len(self.a)) - self.a, self.b + 0j)


def _channels(system: Any) -> _Model:
    """Matrices of the four signals; raises `ParameterError`."""
    if getattr(system, "dt", None):
        raise ParameterError("system", f"found a sample time of {system.dt} s, must be of continuous time")
    a, b, c, d = _matrices(system)
    columns = _places(system, "input", _INPUTS, b.shape[1])
    rows = _places(system, "output", _OUTPUTS, c.shape[0], _without_velocity(a, b, c, d))
    if np.any(d[np.ix_(rows, columns)]):
        raise ParameterError("system", "found a direct feedthrough, but neither displacement nor voltage can jump")
    return _Model(a, b[:, columns], c[rows])


def _matrices(system: Any) -> tuple[np.ndarray, ...]:
    """A, B, C, D of a state-space model or of transfer functions; raises `ParameterError`."""
    from control import TransferFunction

    if isinstance(system, TransferFunction):
        a, b, c, d = realised(system)
        s = 1j * np.geomspace(0.1, 10, _POINTS) * max(np.max(np.abs(np.linalg.eigvals(a)), initial=0.0), 1.0)
        wanted, found = responses(system, s), c @ np.linalg.solve(s[:, None, None] * np.eye(len(a)) - a, b + 0j) + d
        if not np.max(np.abs(found - wanted) / np.max(np.abs(wanted), axis=0)) <= _AGREES:
            needed = (
                "must have poles that differ, as those of modes do; arithmetic with transfer functions repeats them"
            )
            raise ParameterError("system", f"found a multiple pole, {needed}")
        return a, b, c, d
    try:
        return tuple(np.asarray(getattr(system, name), float) for name in "ABCD")
    except (AttributeError, TypeError, ValueError):
        found = f"found {named_kind(system)}, must be a StateSpace of python-control or scipy.signal"
        raise ParameterError("system", f"{found}, or a control.TransferFunction, of real numbers") from None


def _places(system: Any, key: str, wanted: tuple[str, str], count: int, shown: list[int] | None = None) -> list[int]:
    """Numbers of the wanted signals: by name, else those `shown`, else the first two of two; raises an error."""
    names = list(getattr(system, f"{key}_labels", []))
    if set(wanted) <= set(names):
        return [names.index(name) for name in wanted]
    if count == 2:
        return [0, 1]
    if shown is not None:
        return shown
    found = f"found {count} {key}{'' if count == 1 else 's'}{' (' + ', '.join(names) + ')' if names else ''}"
    third = ", with or without the velocity" if key == "output" else ""
    needed = f"must be {' and '.join(wanted)} by name, or these two in this order{third}"
    raise ParameterError("system", f"{found}, {needed}")


def _without_velocity(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> list[int] | None:
    """Displacement and voltage among three outputs of which one is the time derivative of another; else None.

    The voltage of a capacitor has a derivative that jumps with the current, so that the pair is not ambiguous.
    """
    if len(c) != 3:
        return None
    slope, jump = c @ a, c @ b
    for moved, velocity, voltage in permutations(range(3)):
        size = np.max(np.abs(slope[moved])), np.max(np.abs(jump), axis=0)
        same = np.max(np.abs(slope[moved] - c[velocity])) <= _AGREES * size[0]
        if same and np.all(np.abs(jump[moved] - d[velocity]) <= _AGREES * size[1]):
            return [moved, voltage]
    return None


def _checked(model: _Model, modes: list[dict[str, Any]], capacitance: float) -> Transducer:
    """The transducer, if it responds as the system does."""
    needed = "must be the two-port of underdamped modes, each driven by the force"
    if not modes:
        raise ParameterError("system", f"found no resonance with shorted electrodes, {needed}")
    try:
        first, *further = (Mode(**mode) for mode in modes)
    except ParameterError as error:
        raise ParameterError("system", f"found a mode whose {error.key} is not allowed ({error.message})") from None
    transducer = Transducer(**modes[0], capacitance=capacitance, modes=tuple(further))
    natural = np.sqrt([mode.stiffness / mode.mass for mode in (first, *further)])
    s = 1j * np.geomspace(0.1 * natural[0], 10 * natural[-1], _POINTS)
    wanted, found = (one.responses(s) for one in (model, _channels(linearize(transducer))))
    # Each response as a share of its own: all are alike in size over a decade beside the resonances.
    wrong = np.max(np.abs(found - wanted) / np.max(np.abs(wanted), axis=0))
    if not wrong <= _AGREES:
        raise ParameterError("system", f"found responses that no transducer of its modes has ({wrong:.2g}), {needed}")
    return transducer
