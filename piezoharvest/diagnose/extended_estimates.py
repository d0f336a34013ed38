"""Parameters of the lumped model beside the effects that were found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from piezoharvest.diagnose import thresholds
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import covariance
from piezoharvest.identify.identifiability import experiment, relative_error
from piezoharvest.identify.result import Estimate, Identification
from piezoharvest.predict.parameters import value_at


def estimates_with_effects(before: Identification, final: Fit) -> Iterator[Estimate]:
    """Estimates of the extended model, in the order of those before."""
    std = np.sqrt(np.diag(covariance(final)))
    places = {parameter.path: k for k, parameter in enumerate(final.model.parameters)}
    names = {parameter.name for parameter in final.model.parameters}
    for estimate in before.estimates:
        k = places.get(estimate.parameter.path)
        if k is None:  # the effects may explain what seemed to determine it
            nominal = replace(estimate, value=estimate.nominal, std=None, identifiable=False)
            yield replace(nominal, experiment=experiment(estimate.parameter)) if estimate.identifiable else estimate
            continue
        # The scaling of this fit: the one before may have kept the sign of a coupling, which this one varies.
        parameter = final.model.parameters[k]
        value = float(np.real(value_at(final.model.transducer, parameter.path)))
        error = float(parameter.slope(parameter.inner(value)) * std[k])
        identifiable = relative_error(value, error) < thresholds.MAX_RELATIVE_ERROR
        yield replace(
            estimate, value=value, std=error, identifiable=identifiable, combination="",
            experiment="" if identifiable else experiment(estimate.parameter),
            assumes=tuple(name for name in estimate.assumes if name not in names),
        )  # fmt: skip


def is_elsewhere(estimate: Estimate) -> bool:
    """True if a parameter is implausible and the records say so: by more standard errors than chance explains."""
    off = abs(estimate.value - estimate.nominal)
    certain = thresholds.MIN_CERTAIN_DEVIATION
    return is_implausible(estimate) and estimate.std is not None and off > certain * estimate.std


def is_implausible(estimate: Estimate) -> bool:
    """True if a parameter is so far from its nominal value that it compensates for something missing."""
    return not 1.0 / thresholds.MAX_DEVIATION < estimate.value / estimate.nominal < thresholds.MAX_DEVIATION
