"""Specimens of another kind: odds that a specimen has values of its own, against being one of a kind with the others.

Each variable is judged by itself, by the marginal likelihoods of both, with the mean integrated over in closed form and
the spread on a grid. A specimen is told when the variables that speak for another kind are likelier together by more
than `MIN_ODDS`, after the choice among specimens and sets of variables is paid for. Of six, five that agree within 2 %
tell one that is half as large (95 of 100 drawn); of four, three tell one three times as large (88); of three, one value
is not enough. Of kinds with the usual spread one in 200 is told by mistake (`tests/population/test_hierarchy.py`).
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln, logsumexp

from piezoharvest.population.hierarchy import Beliefs

MIN_ODDS = 100.0  # as of rival places of a law: a hundred to one
MIN_OTHERS = 2  # specimens of one kind: of two that differ, neither is the odd one
# Spreads over the usual one: from 0.02 % of a value, below what specimens can agree in, to what the prior excludes.
GRID = np.geomspace(1e-3, 6.0, 80)

# Power of a spread's prior, in each part of that grid: zero, where all decades are alike, takes two values that are
# close by chance for a kind (6 % of three specimens at the usual spread); 2, as for the estimate, takes none for one.
SMALL = 0.5


def odd_ones(values: np.ndarray, errors: np.ndarray, beliefs: Beliefs) -> dict[int, tuple[int, ...]]:
    """Specimens of another kind, with the variables in which they differ.

    Parameters
    ----------
    values, errors : (n, p) array
        Estimates of the specimens' variables by themselves, and their standard errors.
    beliefs : Beliefs

    Returns
    -------
    dict
        Indices of specimens to indices of variables, the oddest first.
    """
    rest, found = list(range(len(values))), dict[int, tuple[int, ...]]()
    while len(rest) > MIN_OTHERS:
        gains = [_gains(values[rest], errors[rest], n, beliefs) for n in range(len(rest))]
        totals, telling = zip(*map(_best_set, gains), strict=True)
        worst = int(np.argmax(totals))
        if totals[worst] - np.log(len(rest)) < np.log(MIN_ODDS):
            break
        found[rest.pop(worst)] = telling[worst]
    return found


def _best_set(gains: np.ndarray) -> tuple[float, tuple[int, ...]]:
    """Logarithm of the odds of the set of variables that speaks most for another kind, and the set.

    One of k variables out of p is one of as many as p choose k.
    """
    order, count = np.argsort(-gains), len(gains)
    sizes = np.arange(1, count + 1)
    choices = gammaln(count + 1) - gammaln(sizes + 1) - gammaln(count - sizes + 1)
    odds = np.cumsum(gains[order]) - choices
    best = int(np.argmax(odds))
    return float(odds[best]), tuple(sorted(order[: best + 1].tolist()))


def _gains(values: np.ndarray, errors: np.ndarray, n: int, beliefs: Beliefs) -> np.ndarray:
    """Logarithm of the odds that the n-th specimen has a value of its own, of each variable, (p,)."""
    others = np.arange(len(values)) != n
    own = _log_normal(values[n] - beliefs.mean, np.hypot(errors[n], beliefs.deviation))
    return own + _evidence(values[others], errors[others], beliefs) - _evidence(values, errors, beliefs)


def _evidence(values: np.ndarray, errors: np.ndarray, beliefs: Beliefs) -> np.ndarray:
    """Logarithm of the marginal likelihood of specimens of one kind, of each variable, (p,)."""
    spread = GRID[:, None] * beliefs.spread
    weights = SMALL * np.log(GRID) - 0.5 * GRID**2  # of each part of the grid, which is one of logarithms
    weights = weights - logsumexp(weights)
    variance = errors[None] ** 2 + spread[:, None] ** 2  # (grid, n, p)
    # The mean is normal about its belief: values one after the other, each predicted from those before.
    mean, doubt, total = beliefs.mean + np.zeros_like(spread), beliefs.deviation**2 + np.zeros_like(spread), 0.0
    for k, value in enumerate(values):
        total = total + _log_normal(value - mean, np.sqrt(doubt + variance[:, k]))
        share = doubt / (doubt + variance[:, k])
        mean, doubt = mean + share * (value - mean), doubt * variance[:, k] / (doubt + variance[:, k])
    return logsumexp(total + weights[:, None], axis=0)


def _log_normal(away: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    return -0.5 * (away / deviation) ** 2 - np.log(deviation)
