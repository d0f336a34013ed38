"""Test whether records show inertia and damping: a film, or a stack far below its resonance, shows neither.

If they do not, a fit would change mass and damping to compensate other errors, or reduce them without end on their
logarithmic scale. So it is tested whether the quasi-static specimen explains the records as well. Unless the records
contradict the nominal mass and damping, these are kept: the lag b/k of the damping, which no test of them finds, would
else be taken for leakage or relaxation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezoharvest.description.transducer import INERT, Mode, Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import excess_of, fit, inverse, mean_square
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model, nuisance_for_problem
from piezoharvest.identify.start_values.initial_estimates import drive_is_slow
from piezoharvest.predict.parameters import Parameter, put, value_at
from piezoharvest.predict.prediction import PredictionError

# Decrease of the sum of squared residuals that mass and damping must cause: without any effect they do so by chance
# once in 150 records (chi-square with two degrees of freedom).
MIN_DECREASE = 10.0
MIN_CONTRADICTION = 25.0  # sum of squares, five standard errors, by which records contradict nominal values
# Share of the excess over the noise by which nominal values may be worse: a missing law distorts the comparison.
# Those of electrodes did so by 2 % (`reports/discovery`); of absurd values the excess is many times as large.
MAX_SHARE_OF_EXCESS = 0.1
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


def quasi_static_fit(problem: Problem, quasi_static: Problem, found: Fit) -> Fit | None:
    """Fit of the quasi-static specimen if it explains records about as well as a fit.

    Also if the resonance is above the Nyquist frequency of all of them.

    Parameters
    ----------
    problem : Problem
    quasi_static : Problem
        The same records, prepared for the quasi-static specimen.
    found : Fit
        Fit with masses and dampings; its noise is kept.
    """
    if any(data.drive == "base_acceleration" for data in problem.data if isinstance(data, Data)):
        return None  # the mass shows in the gain
    wanted = MIN_DECREASE * max(1.0, mean_square(found))  # relative to the residuals, if these exceed noise
    above = resonance_above_nyquist(problem, found.model.transducer)
    aim = np.inf if above else sum(float(sums.squares.sum()) for sums in found.sums) + wanted
    other = _fit_quasi_statically(problem, quasi_static, found, aim)
    if other is None:
        return None
    return other if above or excess_of(other) < excess_of(found) + wanted else None


def comes_to_rest(problem: Problem) -> bool:
    """True if the nominal modes come to rest within a sample.

    Those that do not would ring in the samples, at a frequency that is not known well, or lag so much that it shows.
    """
    slowest = min(map(_decay_rate, problem.nominal.all_modes))
    return all(slowest * data.setting.sample_time > 1.0 for data in problem.data if isinstance(data, Data))


def nominal_fit(problem: Problem, found: Fit, quasi_static: Fit) -> Fit | None:
    """Fit with the nominal masses and dampings; None if the records contradict them, beside the quasi-static specimen.

    Parameters
    ----------
    problem : Problem
    found : Fit
        Fit with masses and dampings; its noise is kept.
    quasi_static : Fit
        Fit of the quasi-static specimen.
    """
    nominal = problem.nominal
    transducer = found.model.transducer
    for parameter in found.model.parameters:
        if parameter.path[-1] in INERT:
            transducer = put(transducer, parameter.path, value_at(nominal, parameter.path))
    model = replace(found.model, transducer=transducer, parameters=_without_inert(found.model))
    other = _fit_if_followed(problem, model, nuisance_for_model(problem, found.model, found.nuisance, model), found)
    excess = excess_of(quasi_static)
    allowed = max(MIN_CONTRADICTION, MAX_SHARE_OF_EXCESS * excess)
    return other if other is not None and excess_of(other) < excess + allowed else None


def is_better_left_out(problem: Problem, quasi_static: Problem, found: Fit) -> bool:
    """True if records contradict the nominal masses and dampings of a fit: the quasi-static specimen leaves less.

    Parameters
    ----------
    problem : Problem
    quasi_static : Problem
        The same records, prepared for the quasi-static specimen.
    found : Fit
        With effects that were found since the nominal values were kept.
    """
    other = _fit_quasi_statically(problem, quasi_static, found)
    return other is not None and excess_of(other) < excess_of(found) - MIN_CONTRADICTION


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


def _fit_quasi_statically(problem: Problem, quasi_static: Problem, found: Fit, aim: float = np.inf) -> Fit | None:
    """Fit of the quasi-static specimen from that of another one; None if it cannot follow the records.

    It is given up where it will not come to the value `aim` of -2 ln L.
    """
    still = as_quasi_static(found.model.transducer)
    model = replace(found.model, transducer=still, parameters=_without_inert(found.model))
    nuisance = nuisance_for_problem(problem, found.nuisance, quasi_static, model)
    return _fit_if_followed(quasi_static, model, nuisance, found, aim)


def _fit_if_followed(
    problem: Problem, model: Model, nuisance: Sequence[np.ndarray], found: Fit, aim: float = np.inf
) -> Fit | None:  # fmt: skip
    """Fit with the noise of another one; None if the model cannot follow the records."""
    try:
        return fit(problem, model, nuisance, found.noise, estimate_noise=False, aim=aim)
    except (PredictionError, np.linalg.LinAlgError):
        return None


def _without_inert(model: Model) -> tuple[Parameter, ...]:
    """Parameters of a model but for masses and dampings."""
    return tuple(parameter for parameter in model.parameters if parameter.path[-1] not in INERT)


def _decay_rate(mode: Mode) -> float:
    """Rate in 1/s of the slowest part of a mode's free motion."""
    half = mode.damping / (2.0 * mode.mass)
    return half - float(np.sqrt(max(half**2 - mode.stiffness / mode.mass, 0.0)))
