"""Capacitance, coupling and operators of a transducer from the loops of its voltage over charge and displacement.

v = (q - T x)/C + sum_j w_j stop(q; r_j) + constant, where the charge q has flowed through the load. Measured voltage,
current and displacement are inserted directly, so that all unknowns except the thresholds are linear: an estimate for
the start of a fit, in which the noise of the displacement is neglected (equation error: Ljung, System Identification,
1999, section 10.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.hysteresis.play_operators import plays

POINTS = 500  # per record: loops are smooth
MAX_NOMINAL_RATIO = 3.0  # largest plausible ratio to the nominal value
ITERATIONS = 8  # Gauss-Newton iterations of the thresholds
MAX_LOG_STEP = 0.3  # largest step of the logarithm of a threshold
MIN_THRESHOLD_RATIO = 1.05  # least ratio of neighbouring thresholds
MIN_WEIGHT = 1e-3  # of 1/C: least weight, because a fit could not change a weight of zero
MIN_SINGULAR_VALUE_RATIO = 1e-7  # relative singular value below which the loops do not determine the parameters


class ChargeLoop(NamedTuple):
    """Charge (C), voltage (V) and displacement (m) of a record, (samples,)."""

    charge: np.ndarray
    voltage: np.ndarray
    displacement: np.ndarray


def is_plausible(value: float, nominal: float) -> bool:
    """True if an estimate is plausible for a parameter with this nominal value."""
    return bool(np.isfinite(value) and nominal / MAX_NOMINAL_RATIO < value < nominal * MAX_NOMINAL_RATIO)


def with_charge_loops(data: Sequence[Data], nominal: Transducer) -> Transducer:
    """Transducer with capacitance, coupling and operators from the loops, if these determine them.

    Without measured displacement, F/k is used instead, and the loops give the capacitance at constant force.
    """
    measured = [each for each in data if "displacement" in each.record.signals]
    loops = [loop for loop in (loop_of(each, nominal) for each in measured or data) if loop is not None]
    found = _solved(loops, nominal) if loops else None
    if found is None:
        return nominal
    capacitance, coupling, hysteresis = found
    if not measured:
        capacitance -= coupling**2 / nominal.stiffness
    if not (is_plausible(capacitance, nominal.capacitance) and is_plausible(coupling, nominal.coupling)):
        return nominal
    return replace(nominal, capacitance=capacitance, coupling=coupling, hysteresis=hysteresis)


def loop_of(data: Data, nominal: Transducer) -> ChargeLoop | None:
    """Loop of a record from rest; None if charge, voltage or displacement do not follow from the measured channels."""
    signals, h = {name: data.record[name] for name in data.record.signals}, data.setting.sample_time
    shunt = data.record.shunt
    if isinstance(shunt, Resistor):
        resistance = shunt.resistance
        if "voltage" in signals:
            signals["current"] = signals["voltage"] / resistance
        elif "current" in signals:
            signals["voltage"] = resistance * signals["current"]
    if "displacement" not in signals and "force" in signals:
        signals["displacement"] = signals["force"] / nominal.stiffness
    if not {"voltage", "current", "displacement"} <= set(signals):
        return None
    current = signals["current"]
    charge = -h * np.concatenate([[0.0], np.cumsum(0.5 * (current[1:] + current[:-1]))])
    return ChargeLoop(*map(decimated, (charge, signals["voltage"], signals["displacement"])))


def decimated(values: np.ndarray) -> np.ndarray:
    """Means over equal parts of a record, `POINTS` of them or up to twice as many."""
    size = max(len(values) // POINTS, 1)
    return values[: len(values) // size * size].reshape(-1, size).mean(axis=1)


def _solved(loops: Sequence[ChargeLoop], nominal: Transducer) -> tuple[float, float, Hysteresis | None] | None:
    """Capacitance, coupling and operators by Gauss-Newton on the thresholds; None if they are not determined."""
    pairs = nominal.hysteresis
    thresholds, weights = (np.array(values) for values in ((pairs.thresholds, pairs.weights) if pairs else ((), ())))
    n = int(np.sum(thresholds < max(np.abs(loop.charge).max() for loop in loops)))  # the others stick all the time
    slope = ratio = np.nan
    for turn in range(ITERATIONS if n else 1):
        # At first the nominal thresholds are fixed: with weights that are far off they would diverge.
        design, voltage = _equations(loops, thresholds, weights, n, moving=turn > 0)
        size = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
        solution, _, rank, _ = np.linalg.lstsq(design / size, voltage, rcond=MIN_SINGULAR_VALUE_RATIO)
        if rank < design.shape[1]:
            return None
        slope, ratio, *rest = (solution / size)[: 2 + n * (1 + (turn > 0))]
        weights[:n] = np.maximum(rest[:n], MIN_WEIGHT * abs(slope))
        if turn:
            thresholds[:n] *= np.exp(np.clip(rest[n:], -MAX_LOG_STEP, MAX_LOG_STEP))
            thresholds = np.maximum.accumulate(thresholds * MIN_THRESHOLD_RATIO ** -np.arange(len(thresholds))) * (
                MIN_THRESHOLD_RATIO ** np.arange(len(thresholds))
            )
    if slope <= 0:
        return None
    found = Hysteresis(thresholds=tuple(thresholds.tolist()), weights=tuple(weights.tolist())) if pairs else None
    return 1.0 / slope, ratio / slope, found


def _equations(
    loops: Sequence[ChargeLoop], thresholds: np.ndarray, weights: np.ndarray, n: int, *, moving: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Design matrix and right side for 1/C, T/C, n weights, changes of log thresholds, and constants."""
    rows, right = [], []
    for k, loop in enumerate(loops):
        found = plays(loop.charge, thresholds)
        stops = loop.charge[:, None] - found.outputs
        columns = [loop.charge, -loop.displacement, *stops[:, :n].T]
        if moving:
            columns += list((-found.slopes * weights * thresholds)[:, :n].T)
        constants = np.tile(np.eye(len(loops))[k], (len(stops), 1))
        rows.append(np.column_stack([*columns, constants]))
        right.append(loop.voltage - stops[:, n:] @ weights[n:])
    return np.concatenate(rows), np.concatenate(right)
