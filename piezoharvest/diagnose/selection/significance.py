"""How certain an effect of a fit is: its strength in standard errors, and what coloured noise adds to these.

It is judged beside gains in -2 ln L and residual tests, which do not know that samples behind a switch err together:
so none of them does.
"""

from __future__ import annotations

import numpy as np

from piezoharvest.diagnose import thresholds
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import covariance, inflation
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identifiability import size_of
from piezoharvest.predict.parameters import value_at


def variance_inflation(found: Fit, n: int) -> float:
    """Variance of the n-th effect's strength over that with white residuals.

    The errors of a rounding sensor are correlated while its load is constant: they resemble creep, a contact, or the
    end of a range.
    """
    place = _strength_column(found, n)
    return 1.0 if place is None else inflation(found, place)


def significance(found: Fit, n: int) -> float:
    """Wald statistic of the n-th effect's strength; infinite for a spectral line, or where it is scanned."""
    place = _strength_column(found, n)
    if place is None:
        return np.inf
    parameter = found.model.parameters[place]
    inner = parameter.inner(value_at(found.model.transducer, parameter.path))
    size = 1.0 if parameter.scaling == "log" else float(np.real(inner))
    return size**2 / float(covariance(found, switching=False)[place, place])


def standard_errors_from_zero(problem: Problem, found: Fit, n: int) -> float:
    """Distance of the n-th effect's strength from zero in its standard errors.

    Parameters that the records do not determine are taken as known: an effect correlated with one of these is not less
    certain for it. A strength that is scanned is not zero where other events than those at zero fit better.
    """
    if found.model.transducer.effects[n].scanned:
        return np.inf
    scatter = covariance(found, _undetermined_places(found), switching=False)
    place = _strength_column(found, n)
    if place is None:
        size, error = line_amplitude(problem, found, n, scatter)
        return size / error if error > 0.0 else np.inf
    parameter = found.model.parameters[place]
    if parameter.scaling == "log":
        return np.inf
    inner = float(np.real(parameter.inner(value_at(found.model.transducer, parameter.path))))
    return abs(inner) / float(np.sqrt(scatter[place, place]))


def _undetermined_places(found: Fit) -> list[int]:
    """Transducer parameters that the data does not determine, the least certain one first."""
    places = [k for k, parameter in enumerate(found.model.parameters) if parameter.path[0] != "effects"]
    fixed: list[int] = []
    while places:
        std = np.sqrt(np.diag(covariance(found, fixed, switching=False)))
        worst = max(places, key=lambda k: std[k] / size_of(found, k))
        if std[worst] / size_of(found, worst) < thresholds.MAX_RELATIVE_ERROR:
            break
        fixed.append(worst)
        places.remove(worst)
    return fixed


def line_amplitude(problem: Problem, found: Fit, n: int, scatter: np.ndarray) -> tuple[float, float]:
    """Root mean square over records of the amplitude of a line (the n-th effect), and its standard error."""
    effect = found.model.transducer.effects[n]
    start = f"{effect.name} {getattr(effect, 'channel', '')} "  # prefix of its nuisance parameters
    names = [problem.nuisance_names(found.model, data) for data in problem.data]
    parts = np.concatenate(found.nuisance) * [name.startswith(start) for some in names for name in some]
    records = sum(any(name.startswith(start) for name in some) for some in names)
    amplitude = float(np.sqrt(parts @ parts / records))
    slopes = np.pad(parts / (records * amplitude), (len(scatter) - len(parts), 0))
    return amplitude, float(np.sqrt(slopes @ scatter @ slopes))


def _strength_column(found: Fit, n: int) -> int | None:
    """Column of the n-th effect's strength; None without one, or for a line (nuisance parameters)."""
    effects = found.model.transducer.effects
    if not effects:
        return None
    n = n % len(effects)
    path = ("effects", n, type(effects[n]).strength().name)
    return next((k for k, parameter in enumerate(found.model.parameters) if parameter.path == path), None)
