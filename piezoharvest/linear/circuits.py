"""Linear circuits at their port: coefficients of their equations, found from unit vectors, and their admittance."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.circuit import Port
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import LinearShunt, Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.linear.assembly import angular


class CircuitColumns(NamedTuple):
    """Coefficients of a circuit's equations z Z + dz Z' + v V + dv V' + i I = 0.

    Attributes
    ----------
    states : tuple of str
        Names of the n states Z.
    z, dz : (..., n + 1, n) array
    v, dv, i : (..., n + 1) array
    """

    states: tuple[str, ...]
    z: np.ndarray
    dz: np.ndarray
    v: np.ndarray
    dv: np.ndarray
    i: np.ndarray


def circuit_columns(shunt: Shunt, capacitance: float) -> CircuitColumns:
    """Evaluate a linear circuit's equations on unit vectors.

    Parameters
    ----------
    shunt : LinearShunt
    capacitance : float
        Clamped capacitance of the transducer in F; NaN if there is none.

    Raises
    ------
    ParameterError
        The circuit has switches or diodes.
    """
    if not isinstance(shunt, LinearShunt):
        raise ParameterError("shunt", f"found {shunt.kind}, must be a linear circuit (no switches, no diodes)")
    names = tuple(state.name for state in shunt.states(capacitance))
    n = len(names)
    eye = np.eye(2 * n + 4)
    z = SimpleNamespace(**dict(zip(names, eye[:n], strict=True)))
    dz = SimpleNamespace(**dict(zip(names, eye[n : 2 * n], strict=True)))
    v, dv, i, one = eye[2 * n :]
    rows = np.broadcast_arrays(*shunt.equations("linear", Port(v, dv, i, one, capacitance), z, dz))
    stacked = np.stack(rows, axis=-2)
    return CircuitColumns(
        names, stacked[..., :n], stacked[..., n : 2 * n], *np.moveaxis(stacked[..., 2 * n : 2 * n + 3], -1, 0)
    )


def admittance(shunt: Shunt, frequencies: Any, transducer: Transducer | None = None) -> np.ndarray:
    """Admittance current/voltage of a linear circuit, from its equations.

    Parameters
    ----------
    shunt : LinearShunt
    frequencies : (f,) array or float
        Hz.
    transducer : Transducer, optional
        Required for circuits that are tuned to its capacitance.

    Returns
    -------
    (f,) complex array or complex
        S; infinite for a short. A batch of designs is the leading axis.

    Raises
    ------
    ParameterError
        The circuit has switches or diodes, or a frequency is not above zero.
    """
    s = 1j * angular(frequencies)[..., None]
    columns = circuit_columns(shunt, float("nan") if transducer is None else transducer.capacitance)
    batch = columns.z.ndim == 3
    z, dz = (x[..., None, :, :] if batch else x for x in (columns.z, columns.dz))
    v, dv, i = (x[..., None, :] if batch else x for x in (columns.v, columns.dv, columns.i))
    states, voltage = z + s[..., None] * dz, v + s * dv

    def minor(column: np.ndarray) -> np.ndarray:
        """Determinant with the port variable's column beside those of the states (Cramer's rule)."""
        last = np.broadcast_to(column, voltage.shape)[..., None]
        return np.linalg.det(np.concatenate((states, last), axis=-1))

    with np.errstate(divide="ignore", invalid="ignore"):
        numerator, denominator = minor(voltage), minor(i)
        return np.where(denominator == 0, complex(np.inf, 0.0), -numerator / denominator)[()]
