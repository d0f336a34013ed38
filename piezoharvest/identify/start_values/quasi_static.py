"""Whether records show inertia and damping at all: a film, or a stack far below its resonance, hides both.

Where they do not, a fit would move mass and damping until they take the place of something else, or let them vanish,
which on a logarithmic scale has no end. So it is asked whether the quasi-static specimen explains the records as well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezoharvest.description.transducer import INERT, Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit, inverse
from piezoharvest.identify.fitting.problem import Problem, renamed
from piezoharvest.identify.start_values.initial_estimates import slow
from piezoharvest.predict.prediction import PredictionError

# Squares of the residuals by which mass and damping have to lower their sum: two numbers that explain nothing do so by
# chance once in 150 records (chi-square with two degrees of freedom).
WANTED = 10.0
POOR = 1.1  # mean square of whitened residuals, above which mass and damping may be anywhere


def hidden(transducer: Transducer) -> Transducer:
    """The same transducer, quasi-static."""
    return replace(transducer, quasi_static=True)


def beyond_samples(problem: Problem, transducer: Transducer) -> bool:
    """Whether a transducer would ring faster than any record could show, under drives that are far slower.

    Its ringing would show in samples at frequencies where nothing moves, and a fit would use it for what is missing.
    """
    if transducer.quasi_static:
        return False
    resonance = transducer.short_circuit_frequency
    return all(
        isinstance(data, Data)
        and 2.0 * resonance * data.setting.sample_time > 1.0
        and transducer.damping / (2.0 * transducer.mass) * data.setting.sample_time < 1.0
        and slow(data, resonance)
        for data in problem.data
    )


def may_be_hidden(problem: Problem, found: Fit) -> bool:
    """Whether it is worth asking: the fit would hardly be worse if mass and damping vanished, or is poor anyway.

    By how much is told by their covariance, along their values, not their logarithms.
    """
    places = [k for k, parameter in enumerate(found.model.parameters) if parameter.path[-1] in INERT]
    if not places:
        return False
    covariance = inverse(found.information + found.prior)[np.ix_(places, places)]
    away = np.ones(len(places))
    hardly = float(away @ np.linalg.solve(covariance, away)) < WANTED
    return hardly or mean_square(found) > POOR or beyond_samples(problem, found.model.transducer)


def explains_as_well(problem: Problem, quasi_static: Problem, found: Fit) -> bool:
    """Whether the quasi-static specimen leaves no more than a fit does, or what that makes of the masses is no motion.

    Parameters
    ----------
    problem : Problem
    quasi_static : Problem
        The same records, as such a specimen has them.
    found : Fit
        With masses and dampings; its noise is kept.
    """
    if any(data.drive == "base_acceleration" for data in problem.data if isinstance(data, Data)):
        return False  # the mass shows in the gain
    kept = tuple(parameter for parameter in found.model.parameters if parameter.path[-1] not in INERT)
    model = Model(hidden(found.model.transducer), kept, found.model.offset_channels, found.model.relaxed)
    own = renamed(problem, found.own, quasi_static, model)
    try:
        other = fit(quasi_static, model, own, found.noise, estimate_noise=False)
    except (PredictionError, np.linalg.LinAlgError):
        return False
    wanted = WANTED * max(1.0, mean_square(found))  # in units of what is left, if that is more than noise
    return _squares(other) < _squares(found) + wanted or beyond_samples(problem, found.model.transducer)


def _squares(found: Fit) -> float:
    """Sum of squares of the whitened residuals."""
    return sum(float(sums.squares.sum()) for sums in found.sums)


def mean_square(found: Fit) -> float:
    """Mean square of the whitened residuals."""
    return _squares(found) / max(sum(float(sums.count.sum()) for sums in found.sums), 1.0)
