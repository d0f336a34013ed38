"""Identifiability: parameters that the data determine, those they do not, and the combinations that they do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import ResponseWeights
from piezoharvest.identify.fitting.output_error import inverse, posterior, standard_errors
from piezoharvest.identify.fitting.problem import LINEAR_PRIOR_DEVIATION
from piezoharvest.predict.parameters import Parameter, value_at

# Relative standard error from which on a parameter counts as not determined: two standard errors then reach from the
# value to zero, and the data hardly improve on the nominal value, which is known to a factor of e.
MAX_RELATIVE_ERROR = 0.5
# Weight of the priors in the decision on identifiability. It is small, because only the records should decide; the
# prior only keeps the information matrix regular where they contain nothing.
PRIOR_WEIGHT = 1e-2
# A nominal damping is known to a factor of ten, other values to a factor of e at worst: of several parameters that are
# only known together, the damping is not the one to fix at its nominal value.
NOMINAL_LOG_ERRORS = {"damping": float(np.log(10.0))}
TIE_RATIO = 0.9  # of the largest uncertainty: of several parameters near it, the first is fixed at its nominal value
# Possible error of the logarithm of a nominal value; 30 % less is 0.35.
NOMINAL_ERROR = 0.1
NOMINAL_ERROR_FOR_RESPONSES = 0.35
MIN_EXPONENT = 0.2  # exponent from which on another parameter belongs to the combination

# Measurement that separates parameters that are only known together.
EXPERIMENTS = {
    "mass": "a record or a frequency response up to the resonance",
    "damping": "a frequency response through the resonance, or a free decay",
    "stiffness": "a record with displacement, with shorted electrodes",
    "coupling": "a record with voltage or current in addition to displacement, or one driven by a voltage",
    "capacitance": "an impedance below the resonance, or records with two load resistances",
    "thresholds": "a record with larger charge, and a slow one with several reversals",
    "weights": "a record with larger charge, and a slow one with several reversals",
}


def undetermined(found: Fit) -> list[int]:
    """Parameters that the data cannot determine if all others are free, by removing the least certain one in turn."""
    parameters = found.model.parameters
    sizes = np.array([size_of(found, k) for k in range(len(parameters))])
    trust = np.array([NOMINAL_LOG_ERRORS.get(str(parameter.path[-1]), 1.0) for parameter in parameters])
    free = list(range(len(found.information)))
    out: list[int] = []
    while True:
        at = np.ix_(free, free)
        std = np.sqrt(np.maximum(np.diag(posterior(found.information[at], PRIOR_WEIGHT * found.prior[at])), 0.0))
        doubt = {k: std[n] / sizes[k] for n, k in enumerate(free) if k < len(parameters)}
        doubt = {k: size / trust[k] for k, size in doubt.items() if size >= MAX_RELATIVE_ERROR}
        if not doubt:
            return out
        worst = next(k for k, size in doubt.items() if size >= TIE_RATIO * max(doubt.values()))
        out.append(worst)
        free.remove(worst)


def uncertain(found: Fit) -> list[int]:
    """Parameters of a fit with a relative standard error of `MAX_RELATIVE_ERROR` or more, the least certain first."""
    std = standard_errors(found)
    shares = []
    for k, parameter in enumerate(found.model.parameters):
        value = float(value_at(found.model.transducer, parameter.path))
        shares.append(relative_error(value, parameter.slope(parameter.inner(value)) * float(std[k])))
    return [int(k) for k in np.argsort(shares)[::-1] if shares[k] >= MAX_RELATIVE_ERROR]


def relative_error(value: float, std: float) -> float:
    """Standard error of a parameter over its value; infinite if the value is zero."""
    return std / abs(value) if value else np.inf


def size_of(found: Fit, k: int) -> float:
    """Change of the fitted variable if the parameter becomes e times as large; infinite if it may be zero."""
    parameter = found.model.parameters[k]
    if parameter.scaling == "log":
        return 1.0
    # The priors of other parameters have widths in proportion to the nominal values.
    return found.prior[k, k] ** -0.5 / LINEAR_PRIOR_DEVIATION if found.prior[k, k] > 0 else np.inf


def combination(found: Fit, k: int, fixed: Sequence[int]) -> str:
    """Combination of an undetermined parameter with others that is known: "coupling / stiffness^0.5"; empty if none."""
    parameters, size = found.model.parameters, size_of(found, k)
    if found.information[k, k] * size**2 < MAX_RELATIVE_ERROR**-2:
        return ""  # the data do not determine it even if all others are known
    others, follow = _sensitivities(found, k, fixed)
    parts = [parameters[k].name]
    for j, slope in zip(others, follow, strict=True):
        exponent = slope * size / size_of(found, j) if j < len(parameters) else 0.0
        if abs(exponent) > MIN_EXPONENT:
            # The other parameter follows by this power: the product with the opposite power is constant.
            power = f"^{abs(exponent):.2g}" if abs(abs(exponent) - 1.0) > 0.05 else ""
            parts.append(f"{'/' if exponent > 0 else '*'} {parameters[j].name}{power}")
    return " ".join(parts) if len(parts) > 1 else ""


def assumed(found: Fit, k: int, fixed: Sequence[int]) -> tuple[str, ...]:
    """Names of the fixed parameters whose nominal values the estimate of a parameter depends on.

    A possible error of these nominal values changes the estimate by more than its standard error. The possible error is
    a tenth; for frequency responses, which determine parameters to more digits than the dependence is linear, a third,
    and for damping, which acts by its value and not by its logarithm, nine times its value.
    """
    others = [j for j in range(len(found.information)) if j not in fixed]
    at = np.ix_(others, others)
    std = np.sqrt(posterior(found.information[at], found.prior[at])[others.index(k), others.index(k)])
    through = any(isinstance(white, ResponseWeights) for white in found.white)
    names = []
    for j in fixed:
        parameter, size = found.model.parameters[j], size_of(found, j)
        followers, follow = _sensitivities(found, j, fixed)
        off = NOMINAL_ERROR_FOR_RESPONSES if through else NOMINAL_ERROR
        if through and parameter.path[-1] in NOMINAL_LOG_ERRORS:
            off = np.expm1(NOMINAL_LOG_ERRORS[parameter.path[-1]])
        if np.isfinite(size) and abs(follow[followers.index(k)]) * off * size > std:
            names.append(parameter.name)
    return tuple(names)


def _sensitivities(found: Fit, k: int, fixed: Sequence[int]) -> tuple[list[int], np.ndarray]:
    """Free variables other than number `k`, and their changes per change of that variable."""
    others = [j for j in range(len(found.information)) if j != k and j not in fixed]
    return others, -inverse(found.information[np.ix_(others, others)]) @ found.information[others, k]


def experiment(parameter: Parameter) -> str:
    """Measurement that would determine a parameter."""
    words = [str(part) for part in parameter.path if isinstance(part, str)]
    return next(
        (EXPERIMENTS[word] for word in reversed(words) if word in EXPERIMENTS), "a record on which it has an influence"
    )
