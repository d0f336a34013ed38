"""Scalar elements without memory, evaluated outside the compiled march: for equilibria."""

from __future__ import annotations

import numpy as np

from piezoharvest.predict.specimen import POSITIVE_POWER, POWER, PRODUCT, STOP, Matrices


def outputs_of(matrices: Matrices, z: np.ndarray, w: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Outputs of the elements for given states, outputs before, and inputs; stops stay as they are."""
    inputs = matrices.O @ np.concatenate([z, w, e])
    found = np.zeros_like(w)
    for j, (kind, (first, second)) in enumerate(zip(matrices.kinds, matrices.places, strict=True)):
        value, exponent = inputs[first], np.real(matrices.parameters[j])
        if kind == STOP:
            found[j] = w[j]
        elif kind == PRODUCT:
            found[j] = value * inputs[second]
        elif kind == POWER or (kind == POSITIVE_POWER and np.real(value) > 0):
            found[j] = value**exponent
    return found
