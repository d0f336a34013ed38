"""Output-error fit of all channels of all records at once: Levenberg-Marquardt on Whittle's likelihood.

Sources: Ljung, System Identification, 1999, sections 7.2 and 10.2 (output error, Gauss-Newton); Soderstrom, Automatica
43(6), 939-958, 2007 (noise in the drive).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from piezoharvest.identify.fitting.cost_function import Whiteners
from piezoharvest.identify.fitting.evaluation import sums_of, total_information
from piezoharvest.identify.fitting.levenberg_marquardt import MAX_ITERATIONS, Fit, descend
from piezoharvest.identify.fitting.likelihood import spectra_of
from piezoharvest.identify.fitting.measured_responses import FrequencyData, ResponseWeights
from piezoharvest.identify.fitting.model import Model, unexplained_blocks
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_gain import gain_of
from piezoharvest.identify.noise.noise_model import Noise, estimate

TOLERANCE = 1e-2  # predicted decrease of -2 ln L at convergence
MIN_EIGENVALUE_RATIO = 1e-13  # relative eigenvalue of an information matrix, below which it is rounding error
# Of a variable of which neither data nor prior say anything, such as the time constant of an effect that is absent: far
# above any other, and its square, which a sandwich of covariances takes, is still a number.
UNKNOWN_VARIANCE = 1e60
NOISE_ROUNDS = 3  # of fit and noise estimation
# Behind a circuit with events a first fit may end far off, and the noise be estimated from what it left. The sum of
# squares of residuals has a relative standard deviation of a few per cent at most.
MORE_ROUNDS, MAX_SHARE = 3, 0.8


def fit(
    problem: Problem,
    model: Model,
    nuisance: Sequence[np.ndarray] | None = None,
    noise: Noise | None = None,
    *,
    white: Whiteners | None = None,
    estimate_noise: bool = True,
    rounds: int = NOISE_ROUNDS,
    enough: float = TOLERANCE,
    aim: float = np.inf,
    most: int = MAX_ITERATIONS,
    progress: Callable[[str], None] = lambda text: None,
) -> Fit:
    """Fit a model to the records of a problem.

    Parameters
    ----------
    problem : Problem
    model : Model
        Start of the fit, and the parameters to fit.
    nuisance : sequence of arrays, optional
        Start of the records' nuisance parameters.
    noise : Noise, optional
    white : tuple of Whitener or ResponseWeights, optional
        Whiteners of another fit of the same records, which are kept: models filter the noise of the drive differently,
        which is no information about them, but would make their costs scatter.
    estimate_noise : bool
        True to estimate the noise from the residuals, alternating with the fit.
    rounds : int
        Number of rounds of fit and noise estimation.
    enough : float
        Predicted decrease of -2 ln L at convergence.
    aim : float
        Value of -2 ln L: a fit that will not reach it at its present rate is stopped.
    most : int
        Most iterations in a round.
    progress : callable
        Called with a message for every iteration.
    """
    noise = problem.noise() if noise is None else noise
    nuisance = problem.start(model) if nuisance is None else tuple(nuisance)
    rounds, n = rounds if estimate_noise else 1, 0
    more = MORE_ROUNDS if estimate_noise and white is None and problem.has_events else 0
    while True:
        loose = n < rounds - 1
        found = descend(
            problem, model, nuisance, noise, progress, white=white, loose=loose, enough=enough, aim=aim, most=most
        )
        model, nuisance, n = found.model, found.nuisance, n + 1
        # Residuals far below the noise: it was overestimated.
        if not loose and not (n < rounds + more and mean_square(found) < MAX_SHARE):
            return found
        progress("noise estimated from the residuals: the misfit is relative to it from here on")
        noise = reestimated(problem, found)


def mean_square(found: Fit) -> float:
    """Mean square of the whitened residuals."""
    squares, count = (sum(float(getattr(part, name).sum()) for part in found.sums) for name in ("squares", "count"))
    return squares / max(count, 1.0)


def follows_exactly(problem: Problem, found: Fit) -> bool:
    """True if a model follows records without noise as closely as it can be computed.

    What is left is the errors of solvers, which are not random: no test and no gain says anything of them.
    """
    return problem.is_exact and mean_square(found) < 1.0


def excess_of(found: Fit) -> float:
    """Sum of squares of the whitened residuals in excess of noise."""
    return sum(float(sums.squares.sum() - sums.count.sum()) for sums in found.sums)


def reestimated(problem: Problem, found: Fit) -> Noise:
    """Noise from the residuals of a fit."""
    errors = noise_of_responses(problem, found)
    white = {name: sigma for name, sigma in found.noise.sigma.items() if name not in errors}
    if set(white) <= set(problem.known):
        return Noise({**white, **errors})
    spectra = _residual_spectra(problem, found)
    return Noise({**estimate(spectra, problem.known, Noise(white), problem.limits).sigma, **errors})


def noise_of_responses(problem: Problem, found: Fit) -> dict[str, float]:
    """Factors on the noise of measured responses, by record.

    Their noise is known from the scatter of their lines: larger residuals show an incomplete model, and reduce the
    weight. For records with too few lines, the noise is estimated from the residuals.
    """
    errors = {}
    for data, sums in zip(problem.data, found.sums, strict=True):
        if isinstance(data, FrequencyData):
            factor = found.noise.sigma[data.name] * np.sqrt(sums.squares.sum() / max(sums.count.sum(), 1.0))
            errors[data.name] = float(max(factor, 1e-3 if data.reference is None else 1.0))
    return errors


def _residual_spectra(problem: Problem, found: Fit) -> Iterator[tuple[Sequence[str], str, np.ndarray, np.ndarray]]:
    """Input of `noise_model.estimate`, one block at a time: all spectra of a long record would not fit into memory."""
    for data, nuisance, white in zip(problem.data, found.nuisance, found.white, strict=True):
        if isinstance(data, FrequencyData) or isinstance(white, ResponseWeights):
            continue
        levels = np.array([data.level(channel) for channel in data.channels])
        for prediction, begin, residual in unexplained_blocks(found.model, data, nuisance):
            gain = gain_of(prediction, data.channels, np.fft.rfftfreq(len(residual), data.setting.sample_time))
            left = spectra_of(white.weighted(begin, residual)) / (np.sqrt(2.0) * levels)
            yield data.channels, data.drive, left, gain * data.level(data.drive) / levels


def linearised(
    problem: Problem, model: Model, nuisance: Sequence[np.ndarray], found: Fit
) -> tuple[np.ndarray, np.ndarray, float]:
    """Information, gradient and sum of squares of a model, with the whiteners of another fit of the same records."""
    return total_information(model, nuisance, sums_of(problem, model, nuisance, found.white))


def covariance(found: Fit, fixed: Sequence[int] = (), *, switching: bool = True) -> np.ndarray:
    """Covariance of all parameters for coloured residuals: a sandwich estimate by bands of frequency.

    If the residuals of a band exceed the noise (rounding, slow noise, model error), the information of the band is
    reduced by the ratio; it is never increased.

    Parameters
    ----------
    found : Fit
    fixed : sequence of int
        Parameters that are taken as known, whose rows and columns are zero.
    switching : bool
        False to leave out that samples err together because a switch acts earlier or later, as gains in -2 ln L do.
    """
    model, nuisance = found.model, found.nuisance
    p, at = len(model.parameters), len(model.parameters)
    meat = np.zeros_like(found.information)
    squares = sum(part.squares for part in found.sums)
    count = sum(part.count for part in found.sums)
    # Bands with few lines are judged together with those below them.
    excess = np.maximum(np.cumsum(squares) / np.maximum(np.cumsum(count), 1.0), squares / np.maximum(count, 1.0))
    excess = np.maximum(excess, 1.0)
    spreads = [part.spread if switching else part.scatter for part in found.scattered]
    for mine, part, spread in zip(nuisance, found.sums, spreads, strict=True):
        places = np.concatenate([np.arange(p), np.arange(at, at + len(mine))])
        meat[np.ix_(places, places)] += np.einsum("b,bij->ij", excess, part.information) + spread
        at += len(mine)
    free = np.delete(np.arange(len(meat)), list(fixed))
    bread = np.zeros_like(meat)
    bread[np.ix_(free, free)] = posterior(*(part[np.ix_(free, free)] for part in (found.information, found.prior)))
    if np.all(excess == 1.0) and not any(map(np.any, spreads)):
        return bread
    total = bread @ (meat + found.prior) @ bread
    # Of parameters that are determined by their ratio only, rounding leaves 1e-8 of asymmetry.
    total = 0.5 * (total + total.T)
    # By rounding, variances of badly determined parameters may be less than with white noise, or negative.
    np.fill_diagonal(total, np.maximum(np.diag(total), np.diag(bread)))
    return total


def standard_errors(found: Fit) -> np.ndarray:
    """Standard errors of all parameters; variances that are negative by rounding count as zero."""
    return np.sqrt(np.maximum(np.diag(covariance(found)), 0.0))


def inflation(found: Fit, k: int) -> float:
    """Ratio of a parameter's variance to that with the assumed noise alone, at least 1."""
    return max(1.0, float(covariance(found)[k, k] / inverse(found.information + found.prior)[k, k]))


def posterior(information: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Posterior covariance from the information of data and prior.

    A sharp resonance determines the ratio of stiffness and mass 1e10 times as well as either of them: in directions
    without data, rounding errors of the information would exceed the prior, so only the prior is used there.
    """
    size = np.maximum(np.sqrt(np.abs(np.diag(information + prior))), 1e-50)
    values, vectors = np.linalg.eigh((information + prior) / np.outer(size, size))
    rounding = MIN_EIGENVALUE_RATIO * values.max()
    known = values > rounding
    found = (vectors[:, known] / values[known]) @ vectors[:, known].T
    if not np.all(known):
        without = _without_rounding(vectors[:, ~known], rounding * (np.abs(vectors[:, known]) @ (1.0 / values[known])))
        null = without / size[:, None]
        left, right = np.linalg.eigh(null.T @ prior @ null)
        left = np.maximum(left, np.max((null @ right) ** 2, axis=0) / UNKNOWN_VARIANCE)
        found = found + (without @ right / left) @ (without @ right).T
    return found / np.outer(size, size)


def _without_rounding(vectors: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Eigenvectors (n, k) without data, whose components that are only rounding errors (n,) are zero.

    A start of the charge and an offset of the voltage are the same behind open electrodes: nothing is known of their
    difference, and a part in 1e16 of what is not known would be more than all that is known of the mass. The error is
    of first order in that of the matrix, over the eigenvalues of the other vectors. The largest component always stays.
    """
    return np.where(np.abs(vectors) > np.minimum(error, 0.5 / np.sqrt(len(vectors)))[:, None], vectors, 0.0)


def inverse(information: np.ndarray) -> np.ndarray:
    """Inverse of an information matrix whose parameters have very different sizes, or no information at all."""
    size = np.maximum(np.sqrt(np.abs(np.diag(information))), 1e-50)
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    found = (vectors / np.maximum(values, 1e-14)) @ vectors.T
    return found / np.outer(size, size)
