"""Which trials there are, in an order fixed beforehand, any first part of which is a stratified random sample."""

from __future__ import annotations

from itertools import product

import numpy as np

from reports.discovery.campaigns import IMPOSSIBLE, SITES, Trial
from reports.discovery.laws import LAWS

SIGMAS = (8.0, 15.0, 40.0, 200.0, 1e4)
SEEDS = 5  # of each law, place and size
HEALTHY, PAIRS, IMPOSSIBLES = 300, 60, 40
PAIR = 100.0  # sigma of the law beside a named effect of 40
STRANGE = 60.0  # sigma of what is impossible
# First seeds. Of 2,000,000 on it was seen which kinds were answered wrongly, before known effects of any size were held
# against laws.
DEVELOPMENT, HELD_OUT = 1_000_000, 3_000_000
ORDER = 33  # seed of the order


def plan(*, held_out: bool) -> list[Trial]:
    """All trials, kinds in proportion; each stratum, a size with its laws and places, in a random order of its own."""
    first = HELD_OUT if held_out else DEVELOPMENT
    rng = np.random.default_rng([ORDER, int(held_out)])
    cells = list(product(LAWS, SITES))
    strata = [
        [
            Trial("law", *cell, sigma, first + 10_000 * n + 100 * s + k)
            for s in range(SEEDS)
            for k, cell in enumerate(cells)
        ]
        for n, sigma in enumerate(SIGMAS)
    ]
    strata += [
        [Trial("healthy", seed=first + 100_000 + k) for k in range(HEALTHY)],
        [Trial("pair", *cells[k], PAIR, first + 200_000 + k) for k in map(int, rng.permutation(len(cells))[:PAIRS])],
        [Trial("impossible", IMPOSSIBLE[k % len(IMPOSSIBLE)], "", STRANGE, first + 300_000 + k)
         for k in range(IMPOSSIBLES)],
    ]  # fmt: skip
    return _mixed([[stratum[int(k)] for k in rng.permutation(len(stratum))] for stratum in strata])


def _mixed(strata: list[list[Trial]]) -> list[Trial]:
    """Trials of all strata, so that any first part of them has all in proportion."""
    shares = [((k + 0.5) / len(trials), trial) for trials in strata for k, trial in enumerate(trials)]
    return [trial for _, trial in sorted(shares, key=lambda pair: pair[0])]
