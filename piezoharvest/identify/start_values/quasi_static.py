"""Test whether records show inertia and damping: a film, or a stack far below its resonance, shows neither.

If they do not, a fit would change mass and damping to compensate other errors, or reduce them without end on their
logarithmic scale. So it is tested whether the quasi-static specimen explains the records as well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezoharvest.description.transducer import INERT, Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit, inverse, mean_square
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_problem
from piezoharvest.identify.start_values.initial_estimates import drive_is_slow
from piezoharvest.predict.prediction import PredictionError

# Decrease of the sum of squared residuals that mass and damping must cause: without any effect they do so by chance
# once in 150 records (chi-square with two degrees of freedom).
MIN_DECREASE = 10.0
# Times the mean square that a fit of all samples leaves: a quasi-static specimen leaves about as much of the beginnings
# as of all; of a specimen that resonates, a million times as much was left.
FAR = 100.0
MAX_MEAN_SQUARE = 1.1  # mean square of whitened residuals, above which mass and damping may be far off


def as_quasi_static(transducer: Transducer) -> Transducer:
    """The same transducer, quasi-static."""
    return replace(transducer, quasi_static=True)


def resonance_above_nyquist(problem: Problem, transducer: Transducer) -> bool:
    """True if a transducer's resonance is above the Nyquist frequency of all records, under drives that are far slower.

    Its ringing would appear in the samples by aliasing, and a fit would use it to compensate other errors.
    """
    if transducer.quasi_static:
        return False
    resonance = transducer.short_circuit_frequency
    return all(
        isinstance(data, Data)
        and 2.0 * resonance * data.setting.sample_time > 1.0
        and transducer.damping / (2.0 * transducer.mass) * data.setting.sample_time < 1.0
        and drive_is_slow(data, resonance)
        for data in problem.data
    )


def may_be_quasi_static(problem: Problem, found: Fit) -> bool:
    """True if a quasi-static fit should be tried: mass and damping hardly improve the fit, or it is poor anyway.

    The change is estimated from their covariance, linear in their values, not in their logarithms.
    """
    places = [k for k, parameter in enumerate(found.model.parameters) if parameter.path[-1] in INERT]
    if not places:
        return False
    covariance = inverse(found.information + found.prior)[np.ix_(places, places)]
    away = np.ones(len(places))
    hardly = float(away @ np.linalg.solve(covariance, away)) < MIN_DECREASE
    return hardly or mean_square(found) > MAX_MEAN_SQUARE or resonance_above_nyquist(problem, found.model.transducer)


def quasi_static_fits_as_well(problem: Problem, quasi_static: Problem, found: Fit) -> bool:
    """True if the quasi-static specimen fits about as well as a fit, or the fitted resonance is above all sample rates.

    Parameters
    ----------
    problem : Problem
    quasi_static : Problem
        The same records, prepared for the quasi-static specimen.
    found : Fit
        Fit with masses and dampings; its noise is kept.
    """
    if any(data.drive == "base_acceleration" for data in problem.data if isinstance(data, Data)):
        return False  # the mass shows in the gain
    other = _fit_quasi_statically(problem, quasi_static, found)
    if other is None:
        return False
    wanted = MIN_DECREASE * max(1.0, mean_square(found))  # relative to the residuals, if these exceed noise
    return _squares(other) < _squares(found) + wanted or resonance_above_nyquist(problem, found.model.transducer)


def is_far_from_quasi_static(problem: Problem, beginnings: Problem, found: Fit) -> bool:
    """True if a quasi-static specimen leaves far more of the records' beginnings than a fit leaves of all.

    Parameters
    ----------
    problem : Problem
    beginnings : Problem
        Those of the same records, prepared for the quasi-static specimen.
    found : Fit
        Fit with masses and dampings.
    """
    if resonance_above_nyquist(problem, found.model.transducer):
        return False
    other = _fit_quasi_statically(problem, beginnings, found)
    return other is None or mean_square(other) > FAR * max(1.0, mean_square(found))


def _fit_quasi_statically(problem: Problem, quasi_static: Problem, found: Fit) -> Fit | None:
    """Fit of the quasi-static specimen from that of another one; None if it cannot follow the records."""
    kept = tuple(parameter for parameter in found.model.parameters if parameter.path[-1] not in INERT)
    model = Model(as_quasi_static(found.model.transducer), kept, found.model.offset_channels, found.model.relaxed)
    nuisance = nuisance_for_problem(problem, found.nuisance, quasi_static, model)
    try:
        return fit(quasi_static, model, nuisance, found.noise, estimate_noise=False)
    except (PredictionError, np.linalg.LinAlgError):
        return None


def _squares(found: Fit) -> float:
    """Sum of squares of the whitened residuals."""
    return sum(float(sums.squares.sum()) for sums in found.sums)
