"""Energy at ports: a free law that gives some where nothing can give any is no law of that port, but a sensor's fault.

A force over a displacement and a charge over a voltage return what they take: as functions they give nothing. A current
over a voltage, a voltage over a current, or a force over a velocity, f(x), gives energy wherever x f(x) < 0; of a
function of what a memory makes of the input, that memory says where. The closest table that gives none is a convex
problem, and what it costs in -2 ln L says whether the records insist on giving. Sources: Brogliato et al., Dissipative
Systems Analysis and Control, 2007, section 2.1; Diamond & Boyd, J. Mach. Learn. Res. 17(83), 2016 (cvxpy).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from piezoharvest.description.effects import Effect
from piezoharvest.description.effects.nameless.circuit_places import DcLoad, has_dc_load, has_diodes, has_loop
from piezoharvest.description.effects.nameless.memory import DIRECT
from piezoharvest.description.shunts import Resistor, Shunt
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.law_fits import TABLES, LawFit
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.problem import Problem

POINTS = 81  # inputs over the visited range at which a table may give no energy: twice as dense as its corners and more
SWING = 0.01  # of the gain by a law: more than a table's swing beside a knee costs (a thousandth, measured)
ROUNDING = 1e-9  # of the largest power: less is none


def takes_energy(problem: Problem, table: LawFit, gain: float = 0.0) -> bool:
    """False if a table at a port gives energy, beyond the odds at which a place is ruled out.

    A law that is sharper than the table between two of its corners swings about zero beside it, for which nothing gives
    energy: what that costs is a small share of the gain (-2 ln L) by the law.
    """
    odds = max(2.0 * thresholds.MIN_LOG_ODDS, SWING * gain)
    return price_of_passivity(table, *own_part(problem, table)) < odds


def own_part(problem: Problem, table: LawFit) -> tuple[float, float]:
    """What the model has at the port beside the law, c + d x: the law may take that back, not more.

    A load takes part of what its label says, diodes and a switched loop what theirs do; what is beside the load, at the
    electrodes, has nothing to take back.
    """
    device, name = table.found.model.transducer, table.place.name
    if table.law.memory is not None:  # what it lags by is not what the model has
        return 0.0, 0.0
    if name == "damper":
        return 0.0, float(np.real(device.damping))
    labels = (data.setting.shunt for data in problem.data if isinstance(data, Data))
    shunts: list[Any] = [_connected(label, device.effects[: table.index]) for label in labels if label is not None]
    if isinstance(table.place, DcLoad):
        loads: list[Any] = [shunt.load_resistance for shunt in shunts if has_dc_load(shunt)]
        own = [(0.0, 1.0 / load) for load in loads]
    elif name == "load":
        own = [(0.0, 1.0 / shunt.resistance) for shunt in shunts if isinstance(shunt, Resistor)]
    elif name == "diode":
        own = [(shunt.diode_drop, shunt.diode_resistance) for shunt in shunts if has_diodes(shunt)]
    elif name == "switch_loop":
        own = [(0.0, shunt.loop(device.capacitance)[1]) for shunt in shunts if has_loop(shunt)]
    else:
        own = []
    constant, slope = np.min(np.real(own), axis=0) if own else (0.0, 0.0)
    return float(constant), float(slope)


def _connected(shunt: Shunt, effects: Sequence[Effect]) -> Shunt:
    """The circuit as effects leave it."""
    for effect in effects:
        shunt = effect.connect(shunt)
    return shunt


def price_of_passivity(table: LawFit, constant: float, slope: float) -> float:
    """Rise of -2 ln L by the condition that a table beside a constant and a straight line gives no energy."""
    form, memory, port = table.form, table.law.memory, table.place.port
    if not (port == DIRECT or (memory and port)) or not isinstance(form, TABLES):
        return 0.0
    x = np.linspace(table.visited.min(), table.visited.max(), POINTS)
    pieces = np.column_stack([replace(form, kinks=tuple(unit)).values(x) for unit in np.eye(len(form.kinks))])
    inside, right = table.normal
    weight = inside + np.diag(np.diag(table.found.prior)[table.tabled])
    seen = np.diag(weight) > 0.0  # what no record shows is in no power
    size = np.where(seen, 1.0 / np.sqrt(np.where(seen, np.diag(weight), 1.0)), 0.0)
    values, vectors = np.linalg.eigh(weight * np.outer(size, size))
    root = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    found = np.linalg.lstsq(weight * np.outer(size, size), size * right, rcond=1e-13)[0]
    lost = memory.dissipated(port, x, pieces, np.gradient(pieces, x, axis=0)) if memory else x[:, None] * pieces
    power, own = lost * size, constant * np.abs(x) + slope * x**2
    unit = float(np.abs(power @ found).max() + own.max())
    if unit == 0.0 or np.all(power @ found + own >= -ROUNDING * unit):
        return 0.0
    return _distance(root, found, power / unit, own / unit)


def _distance(root: np.ndarray, found: np.ndarray, power: np.ndarray, own: np.ndarray) -> float:
    """Least |root (k - found)|^2 of kinks k whose powers are not negative; if it is not found, that of no kinks."""
    import cvxpy as cp

    kinks, most = cp.Variable(len(found)), float(np.linalg.norm(root @ found))
    wanted = cp.sum_squares(root / most @ (kinks - found))
    problem = cp.Problem(cp.Minimize(wanted), [power @ kinks + own >= 0.0])
    try:
        return most**2 * float(problem.solve(solver=cp.CLARABEL))  # pyright: ignore[reportArgumentType]
    except cp.SolverError:
        return most**2
