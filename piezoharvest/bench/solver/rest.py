"""Initial state of a record: the specimen at rest under the drive's static value."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from scipy.optimize import newton

from piezoharvest.bench.solver.model import Model, SolverError

MIN_FORCE = 1e-200  # N: for a smaller force the spring is linear; fractions of it might underflow


def rest(model: Model, drive: float) -> np.ndarray:
    """Equilibrium under a static drive, with v_t = 0 and every stop relaxed; sets the branches of the stops.

    Raises
    ------
    SolverError
        There is no equilibrium.

    Returns
    -------
    (states,) array
    """
    n, y = model.count, np.zeros((len(model.scale), 1))
    y[:n] = model.gain * drive / model.stiffness
    start, force = float(y[0, 0]), float(model.gain[0, 0] * drive)
    if abs(force) > MIN_FORCE:
        try:  # relative to the displacement of the linear spring
            y[0] = start * newton(lambda share: _unbalanced(model, drive, y, share * start) / force, 1.0, tol=1e-14)
        except RuntimeError:
            raise SolverError(f"no equilibrium was found under the static drive of {drive:g}") from None
    _unbalanced(model, drive, y, float(y[0, 0]))
    y[model.q_row] = (model.coupling * y[:n]).sum() + model.quadratic_coupling * y[0] ** 2
    y[model.own_rows.stop :, 0] = model.circuit.start()
    for stop in model.all_stops:
        stop.relax(float(y[stop.row, 0]))
    return y[:, 0]


def _unbalanced(model: Model, drive: float, y: np.ndarray, x: float) -> float:
    """Force on the first mode at the displacement `x`; the other states at rest are written into `y`."""
    y[0] = x
    m = SimpleNamespace(t=np.zeros(1), drive=np.array([drive]), y=y, x=y[: model.count])
    for row, value in enumerate(model.at_rest, model.own_rows.start):
        y[row] = value(m)
    return float((model.gain[0] * drive - model.stiffness[0] * x + sum(term(m) for term in model.forces))[0])
