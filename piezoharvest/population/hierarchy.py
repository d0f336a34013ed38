"""Mean and spread of specimens of one kind, from what the records of each say: a Gaussian hierarchical model.

The variables of a specimen (logarithms of values, mostly) are normally distributed about the mean of the kind with a
spread of their own; what records say of them is Gaussian with the information matrix of their fit. The mean is
integrated over (restricted likelihood). The spread maximises the marginal likelihood times a Rayleigh prior, and is
then taken at its mean square, by the curvature there: that of a few specimens may by chance be far too small.

Sources: Morris, J. Am. Stat. Assoc. 78(381), 47-55, 1983 (empirical Bayes); Chung, Rabe-Hesketh, Dorie, Gelman & Liu,
Psychometrika 78(4), 685-709, 2013 (a prior that vanishes linearly at no spread keeps the estimate of a few specimens
off zero, where all of them would count as one).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

# Of the weak prior's information: directions in which records say less than this they say nothing.
MIN_INFORMATION = 1e-3
LOG_SPREAD_LIMIT = 12.0  # of a spread over the usual one: beyond e^12 of it either way it makes no difference
CURVATURE_STEP = 0.2  # of the logarithm of a spread, whose posterior is several tenths wide
# Of the logarithm of a spread: that of its Rayleigh prior, where records say nothing (pi^2/24), rounded up.
MAX_LOG_VARIANCE = 0.5


@dataclass(frozen=True, eq=False)
class Beliefs:
    """What is known of the variables of a kind before its records: (p,) arrays in the units of the variables.

    Attributes
    ----------
    mean, deviation : (p,) array
        Of the kind's mean: nominal values, and how far off they may be.
    spread : (p,) array
        Usual spread of specimens: the mode of its Rayleigh prior.
    """

    mean: np.ndarray
    deviation: np.ndarray
    spread: np.ndarray


@dataclass(frozen=True, eq=False)
class Said:
    """What the records of one specimen say of its variables: a Gaussian likelihood.

    Attributes
    ----------
    mean : (p,) array
    information : (p, p) array
        May be singular: then the mean is arbitrary where it is zero.
    """

    mean: np.ndarray
    information: np.ndarray

    @classmethod
    def of_posterior(cls, values: np.ndarray, covariance: np.ndarray, beliefs: Beliefs) -> Said:
        """What is left of a fit's estimates when its prior, that of the beliefs about a mean, is taken away."""
        size = beliefs.deviation
        scaled = np.linalg.inv(covariance / np.outer(size, size)) - np.eye(len(size))
        eigenvalues, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
        kept = eigenvalues > MIN_INFORMATION
        strong, along = eigenvalues[kept], vectors[:, kept]
        pulled = along @ ((along.T @ ((values - beliefs.mean) / size)) / strong)
        return cls(values + size * pulled, (along * strong) @ along.T / np.outer(size, size))


@dataclass(frozen=True, eq=False)
class Population:
    """Specimens of one kind.

    Attributes
    ----------
    mean : (p,) array
    covariance : (p, p) array
        Of the mean.
    spread : (p,) array
        Standard deviation of specimens about the mean.
    """

    mean: np.ndarray
    covariance: np.ndarray
    spread: np.ndarray

    def shrunken(self, said: Said) -> tuple[np.ndarray, np.ndarray]:
        """Estimates of a specimen that borrows strength from the others, and their covariance.

        The covariance has the error of the mean in it (Morris 1983, eq. 3.5, for several variables), and takes the
        spread as known.
        """
        precision = np.diag(self.spread**-2.0)
        inverse = np.linalg.inv(said.information + precision)
        values = inverse @ (said.information @ said.mean + precision @ self.mean)
        follows = inverse @ precision
        return values, inverse + follows @ self.covariance @ follows.T


def estimated(said: Sequence[Said], beliefs: Beliefs) -> Population:
    """Mean and spread of a kind from what is said of its specimens.

    Parameters
    ----------
    said : sequence of Said
        At least one.
    beliefs : Beliefs
    """
    unit = beliefs.spread
    scaled = [Said(each.mean / unit, each.information * np.outer(unit, unit)) for each in said]
    mean, precision = beliefs.mean / unit, np.diag((unit / beliefs.deviation) ** 2)

    def cost(logs: np.ndarray) -> float:
        """-2 ln of the marginal likelihood and the prior of the spread."""
        spread = np.exp(logs)
        value, information, determinants, parts = _mean_of(scaled, spread, mean, precision)
        away = [each.mean - value for each in scaled]
        squares = sum(float(d @ part @ d) for d, part in zip(away, parts, strict=True))
        squares += float((value - mean) @ precision @ (value - mean))
        return determinants + squares + float(np.linalg.slogdet(information)[1] + np.sum(spread**2 - 2.0 * logs))

    limits = [(-LOG_SPREAD_LIMIT, LOG_SPREAD_LIMIT)] * len(unit)
    logs = minimize(cost, np.zeros(len(unit)), method="L-BFGS-B", bounds=limits).x
    ways = CURVATURE_STEP * np.eye(len(unit))
    bends = np.array([cost(logs + way) - 2.0 * cost(logs) + cost(logs - way) for way in ways]) / CURVATURE_STEP**2
    # -2 ln L has twice the inverse variance as its curvature; the mean square of a log-normal spread is e^(2 variance).
    spread = np.exp(logs + np.minimum(2.0 / np.maximum(bends, 1e-300), MAX_LOG_VARIANCE))
    value, information, _, _ = _mean_of(scaled, spread, mean, precision)
    return Population(unit * value, np.linalg.inv(information) * np.outer(unit, unit), unit * spread)


def _mean_of(
    said: Sequence[Said], spread: np.ndarray, prior: np.ndarray, precision: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, list[np.ndarray]]:
    """The kind's mean at a spread, its information, the logarithm of the specimens' determinants and their shares.

    The share of a specimen is the inverse of the sum of its covariance and that of the spread, by the eigenvalues of
    its information in units of the spread: they may be zero, or 1e10 times as large as others.
    """
    parts, determinants = [], 0.0
    total, right = precision.copy(), precision @ prior
    for each in said:
        values, vectors = np.linalg.eigh(each.information * np.outer(spread, spread))
        values = np.maximum(values, 0.0)
        part = (vectors * (values / (1.0 + values))) @ vectors.T / np.outer(spread, spread)
        parts.append(part)
        determinants += float(np.log1p(values).sum())
        total, right = total + part, right + part @ each.mean
    return np.linalg.solve(total, right), total, determinants, parts
