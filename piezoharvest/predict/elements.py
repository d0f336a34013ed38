"""Scalar elements without memory, evaluated outside the compiled propagation: for equilibria."""

from __future__ import annotations

import numpy as np

from piezoharvest.description.effects.nameless.curves import CURVES
from piezoharvest.predict.propagation.element_kinds import (
    CURVE,
    HINGE,
    POSITIVE_POWER,
    POWER,
    PRODUCT,
    SQUARED_HINGE,
)


def outputs_of(
    kinds: np.ndarray, places: np.ndarray, parameters: np.ndarray, inputs: np.ndarray, w: np.ndarray
) -> np.ndarray:
    """Outputs (k, elements) of the elements for inputs (k, inputs); those of stops are copied from `w`.

    The parameters (k, elements) may have complex steps, but for whole exponents.
    """
    found = w.copy()
    for kind in np.unique(kinds):  # all of a kind at once: a table has dozens of hinges
        j = np.flatnonzero(kinds == kind)
        value, parameter = inputs[:, places[j, 0]], parameters[:, j]
        if kind == PRODUCT:
            found[:, j] = value * inputs[:, places[j, 1]]
        elif kind == POWER:
            found[:, j] = value ** np.real(parameter)
        elif kind == POSITIVE_POWER:
            above = np.real(value) > 0
            found[:, j] = np.where(above, np.where(above, value, 1.0) ** parameter, 0.0)
        elif kind in (HINGE, SQUARED_HINGE):
            above = np.where(np.real(value - parameter) > 0, value - parameter, 0.0)
            found[:, j] = above if kind == HINGE else above**2
        elif kind >= CURVE:
            found[:, j] = tuple(CURVES.values())[kind - CURVE](value)
    return found
