"""What figures from material constants share."""

from __future__ import annotations

import math

from piezoharvest.description.parameters import ParameterError

VACUUM_PERMITTIVITY = 8.8541878188e-12  # F/m, CODATA 2022


def conversion(key: str, d: float, s: float, relative_permittivity: float) -> float:
    """Coupling k^2 = d^2/(s eps) of a material, constants in C/N, m^2/N and relative to vacuum (IEEE Std 176-1987).

    Raises
    ------
    ParameterError
        k^2 is not below 1, which no stable material can have; `key` is the charge constant's.
    """
    limit = math.sqrt(s * relative_permittivity * VACUUM_PERMITTIVITY)
    if not abs(d) < limit:
        raise ParameterError(key, f"found {d:g}, must be a size below sqrt(s eps) = {limit:.4g} C/N")
    return (d / limit) ** 2
