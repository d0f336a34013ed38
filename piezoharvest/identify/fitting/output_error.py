"""Output-error fit of all channels of all records at once: Levenberg-Marquardt on Whittle's likelihood.

Sources: Ljung, System Identification, 1999, sections 7.2 and 10.2 (output error, Gauss-Newton); Soderstrom, Automatica
43(6), 939-958, 2007 (noise in the drive).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from piezoharvest.identify.fitting.evaluation import sums_of, whole
from piezoharvest.identify.fitting.levenberg_marquardt import ITERATIONS, Fit, White, descend
from piezoharvest.identify.fitting.likelihood import spectra_of
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model, unexplained_blocks
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_gain import gain_of
from piezoharvest.identify.noise.noise_model import Noise, estimate

ENOUGH = 1e-2  # of -2 ln L that an iteration may still promise
ROUNDED = 1e-13  # relative eigenvalue of an information matrix, below which it is rounding
ROUNDS = 3  # of estimating the noise


def fit(
    problem: Problem,
    model: Model,
    own: Sequence[np.ndarray] | None = None,
    noise: Noise | None = None,
    *,
    white: White | None = None,
    estimate_noise: bool = True,
    rounds: int = ROUNDS,
    enough: float = ENOUGH,
    aim: float = np.inf,
    most: int = ITERATIONS,
    tell: Callable[[str], None] = lambda text: None,
) -> Fit:
    """Fit a model to the records of a problem.

    Parameters
    ----------
    problem : Problem
    model : Model
        Start of the fit, and what varies.
    own : sequence of arrays, optional
        Start of the records' own numbers.
    noise : Noise, optional
    white : tuple of Whitener or ResponseWeights, optional
        Of another fit of the same records, and kept: what differs between models in the ways by which they pass on the
        noise of the drive says nothing about them, but would scatter their costs.
    estimate_noise : bool
        Whether the noise is estimated from the residuals, alternating with the fit.
    rounds : int
        How often.
    enough : float
        Of -2 ln L that an iteration may still promise at the end.
    aim : float
        Of -2 ln L: a fit that at its pace will not come to this is given up.
    most : int
        Iterations in a round.
    tell : callable
        Told about every iteration.
    """
    noise = problem.noise() if noise is None else noise
    own = problem.start(model) if own is None else tuple(own)
    found: Fit | None = None
    rounds = rounds if estimate_noise else 1
    for n in range(rounds):
        loose = n < rounds - 1
        found = descend(problem, model, own, noise, tell, white=white, loose=loose, enough=enough, aim=aim, most=most)
        model, own = found.model, found.own
        if loose:
            noise = reestimated(problem, found)
    assert found is not None
    return found


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

    Their noise is known from their lines: where a model leaves more, it lacks something, and they weigh less. Of lines
    that are too few to tell it, the residuals are all there is.
    """
    errors = {}
    for data, sums in zip(problem.data, found.sums, strict=True):
        if isinstance(data, FrequencyData):
            factor = found.noise.sigma[data.name] * np.sqrt(sums.squares.sum() / max(sums.count.sum(), 1.0))
            errors[data.name] = float(max(factor, 1e-3 if data.reference is None else 1.0))
    return errors


def _residual_spectra(problem: Problem, found: Fit) -> Iterator[tuple[Sequence[str], str, np.ndarray, np.ndarray]]:
    """What `noise.estimate` takes, one block at a time: all spectra of a long record would not fit into memory."""
    for data, own in zip(problem.data, found.own, strict=True):
        if isinstance(data, FrequencyData):
            continue
        for prediction, _, residual in unexplained_blocks(found.model, data, own):
            gain = gain_of(prediction, data.channels, np.fft.rfftfreq(len(residual), data.setting.sample_time))
            yield data.channels, data.drive, spectra_of(residual) / np.sqrt(2.0), gain


def linearised(
    problem: Problem, model: Model, own: Sequence[np.ndarray], found: Fit
) -> tuple[np.ndarray, np.ndarray, float]:
    """Information, gradient and sum of squares of a model, residuals weighed as in another fit of the same records."""
    return whole(model, own, sums_of(problem, model, own, found.white))


def covariance(found: Fit, held: Sequence[int] = ()) -> np.ndarray:
    """Covariance of all parameters, with the residuals' colour as it is: a sandwich by bands of frequency.

    Where the residuals of a band are larger than the noise (rounding, slow noise, what the model misses), the
    information of the band counts that much less; they are never taken to be smaller.

    Parameters
    ----------
    found : Fit
    held : sequence of int
        Parameters that are taken for known, whose rows and columns are zero.
    """
    model, own = found.model, found.own
    p, at = len(model.parameters), len(model.parameters)
    meat = np.zeros_like(found.information)
    squares = sum(part.squares for part in found.sums)
    count = sum(part.count for part in found.sums)
    # Bands with few lines are judged with those above them.
    excess = np.maximum(np.cumsum(squares) / np.maximum(np.cumsum(count), 1.0), squares / np.maximum(count, 1.0))
    excess = np.maximum(excess, 1.0)
    for mine, part in zip(own, found.sums, strict=True):
        places = np.concatenate([np.arange(p), np.arange(at, at + len(mine))])
        meat[np.ix_(places, places)] += np.einsum("b,bij->ij", excess, part.information) + part.scatter
        at += len(mine)
    free = np.delete(np.arange(len(meat)), list(held))
    bread = np.zeros_like(meat)
    bread[np.ix_(free, free)] = posterior(*(part[np.ix_(free, free)] for part in (found.information, found.prior)))
    if np.all(excess == 1.0) and not any(np.any(part.scatter) for part in found.sums):
        return bread
    total = bread @ (meat + found.prior) @ bread
    # Rounding may leave less of what is hardly determined than white noise would make it, or less than nothing.
    np.fill_diagonal(total, np.maximum(np.diag(total), np.diag(bread)))
    return total


def standard_errors(found: Fit) -> np.ndarray:
    """Of all that is varied; rounding may take what the data hardly shows below zero."""
    return np.sqrt(np.maximum(np.diag(covariance(found)), 0.0))


def inflation(found: Fit, k: int) -> float:
    """How many times as large the variance of a parameter is as noise that is as it was taken to be would make it."""
    return max(1.0, float(covariance(found)[k, k] / inverse(found.information + found.prior)[k, k]))


def posterior(information: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Covariance after data and priors.

    A sharp resonance tells the ratio of stiffness and mass 1e10 times as well as either of them: what rounding makes of
    directions of which the data say nothing would be worth more than the prior, so there it is the prior's alone.
    """
    size = np.maximum(np.sqrt(np.abs(np.diag(information + prior))), 1e-50)
    values, vectors = np.linalg.eigh((information + prior) / np.outer(size, size))
    told, untold = values > ROUNDED * values.max(), values <= ROUNDED * values.max()
    found = (vectors[:, told] / values[told]) @ vectors[:, told].T
    if np.any(untold):
        null = vectors[:, untold] / size[:, None]
        left, right = np.linalg.eigh(null.T @ prior @ null)
        found = found + (vectors[:, untold] @ right / np.maximum(left, 1e-300)) @ (vectors[:, untold] @ right).T
    return found / np.outer(size, size)


def inverse(information: np.ndarray) -> np.ndarray:
    """Inverse of an information matrix whose parameters have very different sizes, or no information at all."""
    size = np.maximum(np.sqrt(np.abs(np.diag(information))), 1e-50)
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    found = (vectors / np.maximum(values, 1e-14)) @ vectors.T
    return found / np.outer(size, size)
