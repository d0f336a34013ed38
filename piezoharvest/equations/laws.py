"""The laws of the lumped transducer, each written once: rows that are zero, for every view of the physics.

The engine and the linear view solve the charge law for v_t while they are written down (`rows`); the prediction of
records keeps v_t, v and i as unknowns beside the states and solves all at once (`predict.record_model`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from piezoharvest.description.circuit import Row
from piezoharvest.description.transducer import Mode


def momentum(mode: Mode, x: Row, u: Row, du: Row, v_t: Row, forces: Row) -> Row:
    """M u' + b u + k x - T v_t - forces (N): motion of a mode under the drive and what effects push with."""
    return mode.mass * du + spring(mode, x, u, v_t, forces)


def spring(mode: Mode, x: Row, u: Row, v_t: Row, forces: Row) -> Row:
    """B u + k x - T v_t - forces (N): the force that moves a mode as it is imposed to move, but for its inertia."""
    return mode.damping * u + mode.stiffness * x - mode.coupling * v_t - forces


def charge_law(capacitance: Any, v_t: Row | float, strain_charge: Row, added: Row | float, q: Row) -> Row:
    """C v_t + sum T_i x_i + what effects add - q (C): charge on the electrodes."""
    return capacitance * v_t + strain_charge + added - q


def node_law(dq: Row, current: Row | float, drawn: Row | float) -> Row:
    """Q' + i + what effects draw (A): current at the electrodes."""
    return dq + current + drawn


def hysteresis_voltage(weights: Iterable[Any], stops: Iterable[Row], none: Row) -> Row:
    """Sum of w_j s_j (V): voltage of the stop operators in series with the clamped capacitance."""
    return sum((weight * stop for weight, stop in zip(weights, stops, strict=True)), none)


def participating(modes: Sequence[Mode], rows: Iterable[Row], none: Row) -> Row:
    """Displacement or velocity of the host: sum over the modes by their share where it is read."""
    return sum((mode.seen * row for mode, row in zip(modes, rows, strict=True)), none)


def strain_charge(modes: Sequence[Mode], rows: Iterable[Row], none: Row) -> Row:
    """Charge that the motion makes, or its rate: sum over the modes by their coupling."""
    return sum((mode.coupling * row for mode, row in zip(modes, rows, strict=True)), none)


def drive_gain(mode: Mode, base: bool) -> Any:
    """Factor from the drive to the force on a mode: its share of a force, or minus its mass (kg) under a base."""
    return -mode.base_mass if base else mode.force_participation
