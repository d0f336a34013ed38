"""What the data can determine, what it cannot, and which combination of the rest it does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezoharvest.identify.descent import Fit
from piezoharvest.identify.fit import inverse
from piezoharvest.identify.problem import WEAK
from piezoharvest.predict.parameters import Parameter

UNKNOWN = 0.5  # standard deviation of a logarithm from which on a parameter counts as not determined
OFF = 0.1  # of a logarithm, that the nominal value of a parameter may be off
TIED = 0.2  # exponent from which on another parameter belongs to the combination

# Which measurement separates what is only known together.
SEPARATE = {
    "mass": "a record or a frequency response up to the resonance",
    "damping": "a frequency response through the resonance, or a free decay",
    "stiffness": "a record with displacement, its electrodes shorted",
    "coupling": "a record with voltage or current beside the displacement, or one driven by a voltage",
    "capacitance": "an impedance below the resonance, or records with two load resistances",
    "thresholds": "a record with larger charge, and a slow one that reverses several times",
    "weights": "a record with larger charge, and a slow one that reverses several times",
}


def undetermined(found: Fit) -> list[int]:
    """Parameters that the data cannot determine when all others are free: the least certain one is taken out first."""
    parameters = found.model.parameters
    sizes = [size_of(found, k) for k in range(len(parameters))]
    free = list(range(len(found.information)))
    out: list[int] = []
    while True:
        total = (found.information + found.prior)[np.ix_(free, free)]
        std = np.sqrt(np.diag(inverse(total)))
        doubt = [(std[n] / sizes[k], k) for n, k in enumerate(free) if k < len(parameters)]
        if not doubt or max(doubt)[0] < UNKNOWN:
            return out
        worst = max(doubt)[1]
        out.append(worst)
        free.remove(worst)


def size_of(found: Fit, k: int) -> float:
    """Change of what is varied when the parameter becomes e times as large; infinite where it may be absent."""
    parameter = found.model.parameters[k]
    if parameter.scaling == "log":
        return 1.0
    # Of other ones the prior is as wide as their nominal values tell.
    return found.prior[k, k] ** -0.5 / WEAK if found.prior[k, k] > 0 else np.inf


def combination(found: Fit, k: int, fixed: Sequence[int]) -> str:
    """What is known of an undetermined parameter together with others: "coupling / stiffness^0.5"; empty if nothing."""
    parameters, size = found.model.parameters, size_of(found, k)
    if found.information[k, k] * size**2 < UNKNOWN**-2:
        return ""  # even with all others known the data would not tell it
    others, follow = _followers(found, k, fixed)
    parts = [parameters[k].name]
    for j, slope in zip(others, follow, strict=True):
        exponent = slope * size / size_of(found, j) if j < len(parameters) else 0.0
        if abs(exponent) > TIED:
            # Others follow by this power: the product with the opposite power stays.
            power = f"^{abs(exponent):.2g}" if abs(abs(exponent) - 1.0) > 0.05 else ""
            parts.append(f"{'/' if exponent > 0 else '*'} {parameters[j].name}{power}")
    return " ".join(parts) if len(parts) > 1 else ""


def assumed(found: Fit, k: int, fixed: Sequence[int]) -> tuple[str, ...]:
    """Which undetermined parameters one is told beside, at their nominal values.

    Were these off by what nominal values may be, it would be off by more than its standard error.
    """
    others = [j for j in range(len(found.information)) if j not in fixed]
    std = np.sqrt(inverse((found.information + found.prior)[np.ix_(others, others)])[others.index(k), others.index(k)])
    names = []
    for j in fixed:
        size, (followers, follow) = size_of(found, j), _followers(found, j, fixed)
        if np.isfinite(size) and abs(follow[followers.index(k)]) * OFF * size > std:
            names.append(found.model.parameters[j].name)
    return tuple(names)


def _followers(found: Fit, k: int, fixed: Sequence[int]) -> tuple[list[int], np.ndarray]:
    """What is varied beside one and is not fixed, and by how much it follows where that one is moved."""
    others = [j for j in range(len(found.information)) if j != k and j not in fixed]
    return others, -inverse(found.information[np.ix_(others, others)]) @ found.information[others, k]


def experiment(parameter: Parameter) -> str:
    """The measurement that would determine a parameter."""
    words = [str(part) for part in parameter.path if isinstance(part, str)]
    return next((SEPARATE[word] for word in reversed(words) if word in SEPARATE), "a record in which it matters")
