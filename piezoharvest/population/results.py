"""Values of a kind and of its specimens, in SI units, from fits in variables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.identify.identifiability import MAX_RELATIVE_ERROR, relative_error
from piezoharvest.identify.result import Estimate
from piezoharvest.population.pooling import Pooled, names_of
from piezoharvest.predict.parameters import Parameter, value_at

FROM_THE_KIND = "mostly from the other specimens: its own records contribute less than these"
BORROWED = 0.5  # of the standard error of a specimen by itself: below it, most of the information is that of the others
Value = tuple[float, float, str]


@dataclass(frozen=True)
class OfKind:
    """One parameter of a kind.

    Attributes
    ----------
    parameter : Parameter
    mean, std, spread : float
        Mean over specimens (of the logarithm, where that is what varies), its standard error, and the standard
        deviation of specimens; SI units.
    """

    parameter: Parameter
    mean: float
    std: float
    spread: float


def of_kind(found: Pooled) -> dict[str, OfKind]:
    """Parameters of a kind by name."""
    errors, rows = np.sqrt(np.diag(found.population.covariance)), {}
    numbers = zip(found.population.mean, errors, found.population.spread, strict=True)
    for (name, parameter), (mean, std, spread) in zip(found.variables.items(), numbers, strict=True):
        value = float(np.real(parameter.outer(float(mean))))
        slope = abs(parameter.derivative(value))
        rows[name] = OfKind(parameter, value, slope * float(std), slope * float(spread))
    return rows


def values_of(found: Pooled, n: int) -> dict[str, Value]:
    """Value, standard error and unit of the parameters of a specimen, by the names that specimens share."""
    last, rows = found.fits[n], {}
    errors = np.sqrt(np.diag(found.scatter[n]))
    for name, parameter, error in zip(names_of(last), last.model.parameters, errors, strict=True):
        value = float(np.real(value_at(last.model.transducer, parameter.path)))
        rows[name] = value, abs(parameter.derivative(value)) * float(error), parameter.unit
    return rows


def estimates_of(found: Pooled, n: int, before: Sequence[Estimate]) -> tuple[Estimate, ...]:
    """Estimates of a specimen's own parameters in the fit with its kind."""
    values = values_of(found, n)
    return tuple(_estimate(each, values) for each in before)


def _estimate(before: Estimate, values: Mapping[str, Value]) -> Estimate:
    """An estimate by the fit with the kind; as it was where that has not fitted it."""
    if before.parameter.name not in values:
        return before
    value, std, _ = values[before.parameter.name]
    identifiable = relative_error(value, std) < MAX_RELATIVE_ERROR
    borrowed = identifiable and (before.std is None or std < BORROWED * before.std)
    return replace(
        before, value=value, std=std, identifiable=identifiable, assumes=(), combination="", contradicted=False,
        experiment="" if identifiable else before.experiment, note=FROM_THE_KIND if borrowed else before.note,
    )  # fmt: skip
