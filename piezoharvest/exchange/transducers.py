"""A transducer from a state-space model of its two-port, in whatever coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np

from piezoharvest.description.parameters import ParameterError, named_kind
from piezoharvest.description.transducer import Mode, Transducer
from piezoharvest.linear.statespace import linearize

_INPUTS, _OUTPUTS = ("force", "current"), ("displacement", "voltage")
_AGREES = 1e-6  # relative, of the responses: some thousand times what eigenvalues of six modes lose to rounding
_POINTS = 50  # frequencies at which they are compared


def transducer_from(system: Any) -> Transducer:
    """Transducer whose linear two-port a state-space model is; the inverse of `linearize`.

    Parameters
    ----------
    system : control.StateSpace or scipy.signal.StateSpace
        Continuous time. Inputs `force` (N) and `current` (LOAD current, A, out of the leads), outputs `displacement`
        (m, of where the force acts) and `voltage` (V); without these names two of each, in this order.

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
    a, force, current, displacement, voltage = _channels(system)
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
    return _checked(system, modes, float(capacitance))


def _channels(system: Any) -> tuple[np.ndarray, ...]:
    """A, and the columns and rows of the four signals; raises `ParameterError`."""
    try:
        a, b, c, d = (np.asarray(getattr(system, name), float) for name in "ABCD")
    except (AttributeError, TypeError, ValueError):
        found = f"found {named_kind(system)}, must be a StateSpace of python-control or scipy.signal"
        raise ParameterError("system", f"{found}, of real numbers") from None
    if getattr(system, "dt", None):
        raise ParameterError("system", f"found a sample time of {system.dt} s, must be of continuous time")
    places = []
    for key, wanted, count in (("input", _INPUTS, b.shape[1]), ("output", _OUTPUTS, c.shape[0])):
        names = list(getattr(system, f"{key}_labels", []))
        if not set(wanted) <= set(names) and count != 2:
            found = f"found {', '.join(names) or count}, must be {' and '.join(wanted)}"
            raise ParameterError("system", f"{found} among its {key}s")
        places.append([names.index(name) for name in wanted] if set(wanted) <= set(names) else [0, 1])
    columns, rows = places
    if np.any(d[np.ix_(rows, columns)]):
        raise ParameterError("system", "found a direct feedthrough, but neither displacement nor voltage can jump")
    return a, b[:, columns[0]], b[:, columns[1]], c[rows[0]], c[rows[1]]


def _checked(system: Any, modes: list[dict[str, Any]], capacitance: float) -> Transducer:
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
    wanted, found = (_responses(_channels(one), s) for one in (system, linearize(transducer)))
    # Each response as a share of its own: all are alike in size over a decade beside the resonances.
    wrong = np.max(np.abs(found - wanted) / np.max(np.abs(wanted), axis=0))
    if not wrong <= _AGREES:
        raise ParameterError("system", f"found responses that no transducer of its modes has ({wrong:.2g}), {needed}")
    return transducer


def _responses(channels: tuple[np.ndarray, ...], s: np.ndarray) -> np.ndarray:
    """Displacement and voltage over force and current at points s, (s, 2, 2)."""
    a, force, current, displacement, voltage = channels
    states = np.linalg.solve(s[:, None, None] * np.eye(len(a)) - a, np.column_stack((force, current)) + 0j)
    return np.stack((displacement, voltage)) @ states
