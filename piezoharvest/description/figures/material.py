"""What follows from the constants of a material, for figures and for the linear view."""

from __future__ import annotations

import math

from piezoharvest.description.parameters import ParameterError

VACUUM_PERMITTIVITY = 8.8541878188e-12  # F/m, CODATA 2022


def conversion(d: float, s: float, epsilon: float, key: str = "d") -> float:
    """Coupling k^2 = d^2/(s eps) of a material, constants in C/N, m^2/N and F/m (IEEE Std 176-1987).

    Raises
    ------
    ParameterError
        k^2 is not below 1, which no stable material can have; `key` is the charge constant's.
    """
    limit = math.sqrt(s * epsilon)
    if not abs(d) < limit:
        raise ParameterError(key, f"found {d:g}, must have a magnitude below sqrt(s eps) = {limit:.4g} C/N")
    return (d / limit) ** 2


def stack_values(
    d: float, s: float, epsilon: float, *, area: float, thickness: float, layers: int = 1, key: str = "d"
) -> tuple[float, float, float]:
    """Stiffness (N/m), coupling (N/V) and clamped capacitance (F) of a stack in its 33 mode.

    Its n layers of area A (m^2) and thickness t (m) are mechanically in series, electrically in parallel, force and
    field uniform: k = A/(s n t), T = d A/(s t), C = n A eps (1 - k33^2)/t. Constants and errors as of `conversion`.
    """
    k33 = conversion(d, s, epsilon, key)
    return area / (s * layers * thickness), d * area / (s * thickness), layers * area * epsilon * (1 - k33) / thickness
