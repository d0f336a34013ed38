"""Solution of the bound's convex programs."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

# What is found is checked in closed form on a finer mesh, so that the solver's error can only make a bound less close:
# it need not be below that of the meshes, and a solution that the solver calls inaccurate is judged like any other.
_ACCURACY = {"tol_gap_abs": 1e-6, "tol_gap_rel": 1e-6, "tol_feas": 1e-7}
_FACTORISATION = "qdldl"  # the plain one: half the time of the solver's other ones for these small, dense programs
MARGIN = 1e-7  # by which constraints of natural size one are kept, so that the solver's error does not break them


def solve(objective: Any, constraints: list[Any], variables: list[Any]) -> list[np.ndarray] | None:
    """Values of the variables that minimise an objective; None if the solver finds none.

    Parameters
    ----------
    objective : cvxpy.Expression
        Convex, to be minimised.
    constraints : list of cvxpy.Constraint
    variables : list of cvxpy.Variable
    """
    import cvxpy as cp

    settings: dict[str, Any] = {**_ACCURACY, "direct_solve_method": _FACTORISATION}
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Solution may be inaccurate", UserWarning)
            cp.Problem(cp.Minimize(objective), constraints).solve(solver=cp.CLARABEL, **settings)
    except cp.SolverError:
        return None
    values = [variable.value for variable in variables]
    if any(value is None or not np.all(np.isfinite(value)) for value in values):
        return None
    return [np.asarray(value, float) for value in values]
