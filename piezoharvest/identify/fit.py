"""Output-error fit of all channels of all records at once: Levenberg-Marquardt on Whittle's likelihood.

Sources: Ljung, System Identification, 1999, sections 7.2 and 10.2 (output error, Gauss-Newton); Soderstrom, Automatica
43(6), 939-958, 2007 (noise in the drive).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.optimize import lsq_linear
from threadpoolctl import ThreadpoolController

from piezoharvest.identify.data import Data
from piezoharvest.identify.denoise import noise_floor
from piezoharvest.identify.gain import gain_of
from piezoharvest.identify.noise import Noise, estimate, first_guess
from piezoharvest.identify.responses import FIRST_ERROR, FrequencyData, ResponseWeights
from piezoharvest.identify.sums import Model, Sums, Whitener, own_names, residual_blocks, spectra_of
from piezoharvest.parameters import ParameterError
from piezoharvest.predict.parameters import put, value_at
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.transducer import Transducer

PRIOR = 1.0  # standard deviation of the logarithm of a parameter about its nominal value, where nothing else is known
WEAK = 10.0  # the same for a linear one, in units of its own size
MOST = 60  # iterations
ENOUGH = 1e-2  # of -2 ln L that an iteration may still promise
ROUGH = 1e-3  # the same relative to it, while the noise is passed on by a model that is not fitted yet
ROUNDS = 3  # of estimating the noise
QUIET = 2  # iterations in a row that gain less than that, after which no more is hoped for
HELD = 0.9  # share of what it promised that a step holds; with less the curvature is looked at
RIPPLE = 10.0  # times that, which a step may promise in vain
LEAP = 0.5  # of a logarithm in one iteration: what the data hardly shows must not run away meanwhile
FAR, NEAR = 1e-4, 1e-6  # damping at first, of a rough fit and of one that goes on from there
WORKERS = 2
LEAST = 1e-12  # relative eigenvalue of an information matrix


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    model : Model
    own : tuple of (o,) array
        For each record its states at the start, jumps and offsets.
    noise : Noise
    cost : float
        -2 ln L but for a constant: squares of the residuals, whitened by the model itself, and of the priors.
    sums : tuple of Sums
        For each record at the solution.
    information, prior : (p, p) array
        Of all parameters, those of the records behind those of the model.
    converged : bool
    iterations : int
    message : str
    """

    model: Model
    own: tuple[np.ndarray, ...]
    noise: Noise
    cost: float
    sums: tuple[Sums, ...]
    information: np.ndarray
    prior: np.ndarray
    converged: bool
    iterations: int
    message: str


class Problem:
    """Records to be fitted with a model.

    Parameters
    ----------
    data : sequence of Data
    nominal : Transducer
        Mean of the prior.
    offset_channels : tuple of str
    """

    def __init__(
        self, data: Sequence[Data | FrequencyData], nominal: Transducer, offset_channels: tuple[str, ...]
    ) -> None:
        self.data, self.nominal, self.offset_channels = tuple(data), nominal, offset_channels

    def noise(self) -> Noise:
        """Guess of the noise from the records themselves."""
        found: dict[str, list[float]] = {}
        for data in self.data:
            if isinstance(data, FrequencyData):
                found[data.name] = [FIRST_ERROR]
                continue
            for channel in (*data.channels, data.drive):
                guess = first_guess(data.record[channel])
                floor = 1e-6 * float(np.ptp(data.record[channel])) + 1e-300
                found.setdefault(channel, []).append(data.sigma.get(channel, max(guess, floor)))
        return Noise({**{channel: float(np.median(values)) for channel, values in found.items()}, **self.known})

    @cached_property
    def known(self) -> dict[str, float]:
        """Standard deviations that the campaign gives, and those of drives that show theirs by themselves.

        What residuals tell of a drive's noise depends on how the model passes it on, which may be wrong.
        """
        floors: dict[str, list[tuple[float, int]]] = {}
        for data in self.data:
            if isinstance(data, Data) and (floor := noise_floor(data.record[data.drive])) is not None:
                floors.setdefault(data.drive, []).append(floor)
        shown = {
            name: float(np.sqrt(np.average([sigma**2 for sigma, _ in some], weights=[count for _, count in some])))
            for name, some in floors.items()
        }
        return {**shown, **{channel: sigma for data in self.data for channel, sigma in data.sigma.items()}}

    def start(self, model: Model) -> tuple[np.ndarray, ...]:
        """Own numbers of the records before a fit: all zero."""
        return tuple(np.zeros(len(self.own_names(model, data))) for data in self.data)

    def own_names(self, model: Model, data: Data | FrequencyData) -> tuple[str, ...]:
        """Names of a record's own numbers."""
        return () if isinstance(data, FrequencyData) else own_names(model, data)


def fit(
    problem: Problem,
    model: Model,
    own: Sequence[np.ndarray] | None = None,
    noise: Noise | None = None,
    *,
    estimate_noise: bool = True,
    rounds: int = ROUNDS,
    enough: float = ENOUGH,
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
    estimate_noise : bool
        Whether the noise is estimated from the residuals, alternating with the fit.
    rounds : int
        How often.
    enough : float
        Of -2 ln L that an iteration may still promise at the end.
    tell : callable
        Told about every iteration.
    """
    noise = problem.noise() if noise is None else noise
    own = problem.start(model) if own is None else tuple(own)
    found: Fit | None = None
    rounds = rounds if estimate_noise else 1
    for n in range(rounds):
        found = _descend(problem, model, own, noise, tell, loose=n < rounds - 1, enough=enough)
        model, own = found.model, found.own
        if n < rounds - 1:
            noise = reestimated(problem, found)
    assert found is not None
    return found


def reestimated(problem: Problem, found: Fit) -> Noise:
    """Noise from the residuals of a fit."""
    errors = {
        data.name: found.noise.sigma[data.name] * max(np.sqrt(sums.squares.sum() / max(sums.count.sum(), 1.0)), 1e-3)
        for data, sums in zip(problem.data, found.sums, strict=True)
        if isinstance(data, FrequencyData)
    }
    white = {name: sigma for name, sigma in found.noise.sigma.items() if name not in errors}
    if set(white) <= set(problem.known):
        return Noise({**white, **errors})
    return Noise({**estimate(_residual_spectra(problem, found), problem.known, Noise(white)).sigma, **errors})


def _residual_spectra(problem: Problem, found: Fit) -> Iterator[tuple[Sequence[str], str, np.ndarray, np.ndarray]]:
    """What `noise.estimate` takes, one block at a time: all spectra of a long record would not fit into memory."""
    for data, own in zip(problem.data, found.own, strict=True):
        if isinstance(data, FrequencyData):
            continue
        for prediction, _, residual, _ in residual_blocks(found.model, data, own, False):
            gain = gain_of(prediction, data.channels, np.fft.rfftfreq(len(residual), data.setting.sample_time))
            yield data.channels, data.drive, spectra_of(residual) / np.sqrt(2.0), gain


def _inner(model: Model) -> np.ndarray:
    return np.array([p.inner(value_at(model.transducer, p.path)) for p in model.parameters])


def moved(model: Model, values: np.ndarray) -> Model:
    """Model with other values of what is varied."""
    transducer = model.transducer
    for parameter, value in zip(model.parameters, values, strict=True):
        transducer = put(transducer, parameter.path, float(np.real(parameter.outer(float(value)))))
    return replace(model, transducer=transducer)


def _prior(problem: Problem, model: Model, own: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Means and inverse variances of all parameters."""
    means, precision = [], []
    for parameter in model.parameters:
        if parameter.path[0] == "effects":
            means.append(0.0)
            precision.append(0.0)
            continue
        nominal = parameter.inner(value_at(problem.nominal, parameter.path))
        means.append(nominal)
        size = PRIOR if parameter.scaling == "log" else WEAK * (abs(nominal) or 1.0)
        precision.append(size**-2)
    return np.concatenate([means, np.zeros(sum(map(len, own)))]), np.concatenate(
        [precision, np.zeros(sum(map(len, own)))]
    )


def whiteners(
    problem: Problem, model: Model, noise: Noise, *, rough: bool = False
) -> tuple[Whitener | ResponseWeights, ...]:
    """Whiteners of all records, by a model that need not be the best."""
    return tuple(
        ResponseWeights(noise.sigma[data.name], data)
        if isinstance(data, FrequencyData)
        else Whitener(model.prediction(data), noise, data, rough=rough and data.drive not in problem.known)
        for data in problem.data
    )


@cache
def _threads() -> ThreadpoolController:
    """The libraries whose threads are limited; to find them takes as long as to fit a record."""
    return ThreadpoolController()


def sums_of(
    problem: Problem,
    model: Model,
    own: Sequence[np.ndarray],
    white: Sequence[Whitener | ResponseWeights],
    scatter: bool = False,
) -> tuple[Sums, ...]:
    """Sums of all records.

    Raises
    ------
    PredictionError
        The model cannot follow a record.
    """
    # Threads within products of small matrices would wait for each other most of the time.
    with _threads().limit(limits=1):
        if len(white) == 1:  # what a thread has had of memory is kept for the next one: with a long record that adds up
            return (white[0].sums(model, own[0], scatter),)
        for data in problem.data:
            if isinstance(data, Data):
                model.lowered(data)
        with ThreadPoolExecutor(WORKERS) as pool:
            jobs = [pool.submit(each.sums, model, mine, scatter) for each, mine in zip(white, own, strict=True)]
            return tuple(job.result() for job in jobs)


def _whole(model: Model, own: Sequence[np.ndarray], sums: Sequence[Sums]) -> tuple[np.ndarray, np.ndarray, float]:
    """Information, gradient and sum of squares of all records."""
    p, sizes = len(model.parameters), [len(mine) for mine in own]
    total = p + sum(sizes)
    information, gradient, squares, at = np.zeros((total, total)), np.zeros(total), 0.0, p
    for size, part in zip(sizes, sums, strict=True):
        places = np.concatenate([np.arange(p), np.arange(at, at + size)])
        information[np.ix_(places, places)] += part.information.sum(axis=0)
        gradient[places] += part.gradient.sum(axis=0)
        squares += float(part.squares.sum())
        at += size
    return information, gradient, squares


def _descend(problem, model, own, noise, tell, *, loose: bool, enough: float) -> Fit:
    """Levenberg-Marquardt with bounds."""
    lower = np.concatenate([[p.lower for p in model.parameters], np.full(sum(map(len, own)), -np.inf)])
    upper = np.concatenate([[p.upper for p in model.parameters], np.full(sum(map(len, own)), np.inf)])
    most = np.array([LEAP if p.scaling == "log" else np.inf for p in model.parameters] + [np.inf] * sum(map(len, own)))
    mean, precision = _prior(problem, model, own)
    values = np.concatenate([_inner(model), *own])
    white = whiteners(problem, model, noise, rough=loose)
    sums = sums_of(problem, model, own, white, scatter=not loose)
    information, gradient, squares = _whole(model, own, sums)
    cost = squares + float(precision @ (values - mean) ** 2)
    damping, converged, message = FAR if loose else NEAR, False, "too many iterations"
    iteration, quiet, first, bend = 0, 0, model, np.zeros_like(information)
    for iteration in range(1, MOST + 1):
        total = information + np.diag(precision) + bend
        slope = gradient - precision * (values - mean)
        shown = _shown(information, precision, sums, len(model.parameters))
        step, promise = _step(
            total, slope, damping, np.maximum(lower - values, -most), np.minimum(upper - values, most), shown
        )
        limit = max(1.0, ROUGH * squares) if loose else enough
        if promise < limit:
            converged, message = True, "converged"
            break
        trial = values + step
        try:
            new_model, new_own = moved(model, trial[: len(model.parameters)]), _split(trial, model, own)
            new_sums = sums_of(problem, new_model, new_own, white)
            new_information, new_gradient, squares = _whole(new_model, new_own, new_sums)
            new_cost = squares + float(precision @ (trial - mean) ** 2)
        except (PredictionError, ParameterError, np.linalg.LinAlgError, OverflowError):
            new_cost = np.inf
        if new_cost < cost:
            gained = (cost - new_cost) / promise
            quiet = quiet + 1 if cost - new_cost < limit else 0
            model, own, sums, values, cost = new_model, new_own, new_sums, trial, new_cost
            information, gradient = new_information, new_gradient
            if gained < HELD:
                change = slope - (gradient - precision * (values - mean))
                bend = _bent(bend, information + np.diag(precision), step, change)
            damping = max(damping * (0.1 if gained > 0.5 else 1.0 if gained > 0.1 else 4.0), 1e-12)
            tell(f"iteration {iteration}: {cost:.6g}")
        else:
            # Corners of the operators leave ripples in the cost, below which no step keeps what it promises.
            quiet = quiet + 1 if promise < RIPPLE * limit else 0
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e10:
                message = "no step improves the fit"
                converged = promise < 1.0
                break
        if quiet == QUIET:
            converged, message = True, "converged"
            break
    if not loose and model is not first:
        # Models pass on the noise of the drive in their own ways: each is judged by residuals that its own way makes
        # white.
        sums = sums_of(problem, model, own, whiteners(problem, model, noise), scatter=True)
        information, _, squares = _whole(model, own, sums)
        cost = squares + float(precision @ (values - mean) ** 2)
    return Fit(model, tuple(own), noise, cost, sums, information, np.diag(precision), converged, iteration, message)


def _shown(information: np.ndarray, precision: np.ndarray, sums: Sequence[Sums], p: int) -> np.ndarray:
    """Whether the records show a parameter better than its prior does, each for itself.

    What the noise of the drive adds to the products of the derivatives says nothing about a parameter, but scatters the
    slope: pushed by that, one that nothing else tells would run away.
    """
    own, noisy = np.diag(information).copy(), np.zeros(len(precision))
    noisy[:p] = sum(np.diag(part.noisy.sum(axis=0))[:p] for part in sums)
    return (own != 0.0) & ((own > 0.0) & (own**2 >= precision * (own + noisy)) | (noisy == 0.0))


def _bent(bend: np.ndarray, information: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """What the curvature of the cost has beyond the information, as the change of the slope over a step shows it.

    A secant of rank one (Dennis, Gay & Welsch, ACM Transactions on Mathematical Software 7(3), 348-368, 1981, on why:
    without it steps are too long where the noise that a model passes on depends on the parameters). It is only added:
    the curvature stays that of a minimum.
    """
    miss = change - (information + bend) @ step
    along = float(miss @ step)
    return bend + np.outer(miss, miss) / along if along > 0 else bend


def _split(values: np.ndarray, model: Model, own: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    ends = np.cumsum([len(model.parameters), *(len(mine) for mine in own)])
    return tuple(values[begin:end] for begin, end in itertools.pairwise(ends))


def _step(information, slope, damping, lower, upper, alive) -> tuple[np.ndarray, float]:
    """Step within bounds, and by how much it should lower the cost; what is not `alive` stays as it is."""
    step = np.zeros(len(slope))
    step[alive], promise = _bounded_step(
        information[np.ix_(alive, alive)], slope[alive], damping, lower[alive], upper[alive]
    )
    return step, promise


def _bounded_step(information, slope, damping, lower, upper) -> tuple[np.ndarray, float]:
    """Step within bounds, and by how much it should lower the cost."""
    size = np.sqrt(np.maximum(np.abs(np.diag(information)), 1e-300))
    # Without what the noise of the drive adds, the information in a direction that the data hardly shows may come out
    # negative.
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    values = np.maximum(values, LEAST)
    curvature = (vectors * values) @ vectors.T * np.outer(size, size)
    factor = np.linalg.cholesky((vectors * (values + damping)) @ vectors.T)
    right = np.linalg.solve(factor, slope / size)
    low, high = lower * size, upper * size
    step = np.linalg.solve(factor.T, right)
    if np.any(step < low) or np.any(step > high):
        free = low < high
        step = lsq_linear(factor.T, right, (np.where(free, low, -1e-300), np.where(free, high, 1e-300)), tol=1e-12).x
    step = step / size
    return step, float(2.0 * slope @ step - step @ curvature @ step)


def linearised(
    problem: Problem, model: Model, own: Sequence[np.ndarray], found: Fit
) -> tuple[np.ndarray, np.ndarray, float]:
    """Information, gradient and sum of squares of a model, residuals weighed as in another fit of the same records."""
    return _whole(model, own, sums_of(problem, model, own, whiteners(problem, found.model, found.noise)))


def covariance(found: Fit) -> np.ndarray:
    """Covariance of all parameters, with the residuals' colour as it is: a sandwich by bands of frequency.

    Where the residuals of a band are larger than the noise (rounding, slow noise, what the model misses), the
    information of the band counts that much less; they are never taken to be smaller.
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
        meat[np.ix_(places, places)] += np.einsum("b,bij->ij", excess, part.information + part.noisy) + part.scatter
        at += len(mine)
    bread = inverse(found.information + found.prior)
    return bread @ (meat + found.prior) @ bread


def inverse(information: np.ndarray) -> np.ndarray:
    """Inverse of an information matrix whose parameters have very different sizes."""
    size = np.sqrt(np.maximum(np.abs(np.diag(information)), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    found = (vectors / np.maximum(values, 1e-14)) @ vectors.T
    return found / np.outer(size, size)
