"""What the data can determine, what it cannot, and which combination of the rest it does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import ResponseWeights
from piezoharvest.identify.fitting.output_error import inverse, posterior, standard_errors
from piezoharvest.identify.fitting.problem import WEAK
from piezoharvest.predict.parameters import Parameter, value_at

# Relative standard error from which on a parameter counts as not determined: two of them reach from the value to zero,
# where what it stands for is absent, and the nominal value, good to a factor of e before, is hardly known any better.
UNKNOWN = 0.5
# Share of a nominal value's prior that counts beside the records: the verdict is on these, and it only has to be kept
# from dividing by zero where they say nothing.
SLIGHT = 1e-2
# A nominal damping is good to a factor of ten, others are to one of e at worst: of several that are only known together
# it is not the damping that is taken as nominal.
TRUST = {"damping": float(np.log(10.0))}
ALIKE = 0.9  # of the largest doubt: where several come near it, the first one of them is taken as nominal
OFF, OFF_FAR = 0.1, 0.35  # of a logarithm, that the nominal value of a parameter may be off; 30 % less are 0.35
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
    sizes = np.array([size_of(found, k) for k in range(len(parameters))])
    trust = np.array([TRUST.get(str(parameter.path[-1]), 1.0) for parameter in parameters])
    free = list(range(len(found.information)))
    out: list[int] = []
    while True:
        at = np.ix_(free, free)
        std = np.sqrt(np.maximum(np.diag(posterior(found.information[at], SLIGHT * found.prior[at])), 0.0))
        doubt = {k: std[n] / sizes[k] for n, k in enumerate(free) if k < len(parameters)}
        doubt = {k: size / trust[k] for k, size in doubt.items() if size >= UNKNOWN}
        if not doubt:
            return out
        worst = next(k for k, size in doubt.items() if size >= ALIKE * max(doubt.values()))
        out.append(worst)
        free.remove(worst)


def doubtful(found: Fit) -> list[int]:
    """Parameters of a fit whose standard errors are not well below their values, the least certain one first."""
    std = standard_errors(found)
    shares = []
    for k, parameter in enumerate(found.model.parameters):
        value = float(value_at(found.model.transducer, parameter.path))
        shares.append(relative_error(value, parameter.slope(parameter.inner(value)) * float(std[k])))
    return [int(k) for k in np.argsort(shares)[::-1] if shares[k] >= UNKNOWN]


def relative_error(value: float, std: float) -> float:
    """Standard error of a parameter over its value; infinite of one that is zero."""
    return std / abs(value) if value else np.inf


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

    Were these off by what nominal values may be, it would be off by more than its standard error. That is a tenth; of
    responses, which tell their parameters to more digits than the curvature of such ties is known, a third, and nine
    times as much damping, which acts as such and not by its logarithm.
    """
    others = [j for j in range(len(found.information)) if j not in fixed]
    at = np.ix_(others, others)
    std = np.sqrt(posterior(found.information[at], found.prior[at])[others.index(k), others.index(k)])
    through = any(isinstance(white, ResponseWeights) for white in found.white)
    names = []
    for j in fixed:
        parameter, size, (followers, follow) = found.model.parameters[j], size_of(found, j), _followers(found, j, fixed)
        off = (np.expm1(TRUST[parameter.path[-1]]) if parameter.path[-1] in TRUST else OFF_FAR) if through else OFF
        if np.isfinite(size) and abs(follow[followers.index(k)]) * off * size > std:
            names.append(parameter.name)
    return tuple(names)


def _followers(found: Fit, k: int, fixed: Sequence[int]) -> tuple[list[int], np.ndarray]:
    """What is varied beside one and is not fixed, and by how much it follows where that one is moved."""
    others = [j for j in range(len(found.information)) if j != k and j not in fixed]
    return others, -inverse(found.information[np.ix_(others, others)]) @ found.information[others, k]


def experiment(parameter: Parameter) -> str:
    """The measurement that would determine a parameter."""
    words = [str(part) for part in parameter.path if isinstance(part, str)]
    return next((SEPARATE[word] for word in reversed(words) if word in SEPARATE), "a record in which it matters")
