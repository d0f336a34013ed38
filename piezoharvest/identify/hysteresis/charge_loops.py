"""Capacitance, coupling and operators of a transducer from the loops of its voltage over charge and displacement.

v = (q - T x)/C + sum_j w_j stop(q; r_j) + constant, where the charge q is what has flowed through the load. Measured
voltage, current and displacement go into it as they are, so that all but the thresholds is linear: an estimate for the
start of a fit, in which noise of the displacement still counts as if it were known (equation error: Ljung, System
Identification, 1999, section 10.1).
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

POINTS = 500  # of a record: loops are smooth
MOST = 3.0  # times off its nominal value, which nobody would believe
ROUNDS = 8  # of moving the thresholds
LEAP = 0.3  # of the logarithm of a threshold at once
APART = 1.05  # least ratio of neighbouring thresholds
LEAST = 1e-3  # of 1/C: weights below are none, and a fit could not move them
RESOLVED = 1e-7  # relative singular value below which the loops do not tell the parameters apart


class ChargeLoop(NamedTuple):
    """Charge (C), voltage (V) and displacement (m) of a record, (samples,)."""

    charge: np.ndarray
    voltage: np.ndarray
    displacement: np.ndarray


def believable(value: float, nominal: float) -> bool:
    """Whether a value read off a record may be that of a parameter."""
    return bool(np.isfinite(value) and nominal / MOST < value < nominal * MOST)


def with_charge_loops(data: Sequence[Data], nominal: Transducer) -> Transducer:
    """Transducer with capacitance, coupling and operators of the loops, as far as these determine them.

    Without measured displacement F/k stands in its place, and the loops tell the capacitance at constant force.
    """
    measured = [each for each in data if "displacement" in each.record.signals]
    loops = [loop for loop in (loop_of(each, nominal) for each in measured or data) if loop is not None]
    found = _solved(loops, nominal) if loops else None
    if found is None:
        return nominal
    capacitance, coupling, hysteresis = found
    if not measured:
        capacitance -= coupling**2 / nominal.stiffness
    if not (believable(capacitance, nominal.capacitance) and believable(coupling, nominal.coupling)):
        return nominal
    return replace(nominal, capacitance=capacitance, coupling=coupling, hysteresis=hysteresis)


def loop_of(data: Data, nominal: Transducer) -> ChargeLoop | None:
    """Loop of a record from rest; None where charge, voltage or displacement do not follow from what was measured."""
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
    return ChargeLoop(*map(thinned, (charge, signals["voltage"], signals["displacement"])))


def thinned(values: np.ndarray) -> np.ndarray:
    """Means over parts of a record, POINTS of them or up to twice as many."""
    size = max(len(values) // POINTS, 1)
    return values[: len(values) // size * size].reshape(-1, size).mean(axis=1)


def _solved(loops: Sequence[ChargeLoop], nominal: Transducer) -> tuple[float, float, Hysteresis | None] | None:
    """Capacitance, coupling and operators by Gauss-Newton on the thresholds; None where the loops do not tell."""
    pairs = nominal.hysteresis
    thresholds, weights = (np.array(values) for values in ((pairs.thresholds, pairs.weights) if pairs else ((), ())))
    n = int(np.sum(thresholds < max(np.abs(loop.charge).max() for loop in loops)))  # the others stick all the time
    slope = ratio = np.nan
    for turn in range(ROUNDS if n else 1):
        # At first the nominal thresholds stay: weights that are far off would send them anywhere.
        design, voltage = _equations(loops, thresholds, weights, n, moving=turn > 0)
        size = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
        solution, _, rank, _ = np.linalg.lstsq(design / size, voltage, rcond=RESOLVED)
        if rank < design.shape[1]:
            return None
        slope, ratio, *rest = (solution / size)[: 2 + n * (1 + (turn > 0))]
        weights[:n] = np.maximum(rest[:n], LEAST * abs(slope))
        if turn:
            thresholds[:n] *= np.exp(np.clip(rest[n:], -LEAP, LEAP))
            thresholds = np.maximum.accumulate(thresholds * APART ** -np.arange(len(thresholds))) * (
                APART ** np.arange(len(thresholds))
            )
    if slope <= 0:
        return None
    found = Hysteresis(thresholds=tuple(thresholds.tolist()), weights=tuple(weights.tolist())) if pairs else None
    return 1.0 / slope, ratio / slope, found


def _equations(
    loops: Sequence[ChargeLoop], thresholds: np.ndarray, weights: np.ndarray, n: int, *, moving: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Design and right side for 1/C, T/C, n weights, changes of the logarithms of n thresholds, and constants."""
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
