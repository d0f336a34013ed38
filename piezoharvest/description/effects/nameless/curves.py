"""Smooth curves of one input, by name: as functions of arrays with complex steps or without."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

_SERIES = 1e-2  # argument below which the Langevin function is its series: both are exact to 1e-10 there


def _langevin(z: np.ndarray) -> np.ndarray:
    """Coth z - 1/z: polarisation of free dipoles (Langevin, Ann. Chim. Phys. 5, 70-127, 1905)."""
    small: Any = np.abs(np.real(z)) < _SERIES
    safe = np.where(small, 1.0, z)
    return np.where(small, z / 3.0 - z**3 / 45.0, 1.0 / np.tanh(safe) - 1.0 / safe)


def _logarithm(z: Any) -> Any:
    """Sign(z) log(1 + |z|): creep (Ge & Jouaneh, Precis. Eng. 17(3), 211-221, 1995)."""
    side: Any = np.sign(z.real)
    return side * np.log(1.0 + side * z)


def _coulomb(z: Any) -> Any:
    """Sign of z, rounded off within |z| < 1."""
    return z / np.sqrt(1.0 + z**2)


def _gauss(z: Any) -> Any:
    return np.exp(-(z**2))


# In the order of their codes in compiled code (`engine.motion.curves`).
CURVES: dict[str, Callable[[Any], Any]] = {
    "exponential": lambda z: np.exp(z) - 1.0,
    "sinh": np.sinh,
    "tanh": np.tanh,
    "langevin": _langevin,
    "log": _logarithm,
    "coulomb": _coulomb,
    "gauss": _gauss,
}
CODES = {name: code for code, name in enumerate(CURVES)}
SLOPES_AT_REST = (1.0, 1.0, 1.0, 1.0 / 3.0, 1.0, 0.0, 0.0)  # dry friction has none that is linear
PARITIES = (0, -1, -1, -1, -1, -1, 1)  # -1 of an odd curve, 1 of an even one, 0 of others
