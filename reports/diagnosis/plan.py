"""Which trials there are: all of them follow from their seeds, so that a stopped run goes on where it was.

Kinds are mixed, the weak ones for the power curves last, so that a run that was stopped shows something of all.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, cycle

import numpy as np

from reports.diagnosis.circuits import DRAWS as DRAWN
from reports.diagnosis.circuits import OTHERS
from reports.diagnosis.foreign import FAULTS
from reports.diagnosis.trials import DRAWS, Trial

WEAK = (2.0, 3.5, 5.0, 7.0, 9.0)  # sigma
LEAST, MOST = 12.0, 80.0  # sigma of what has to be named
FAULT = 120.0  # sigma of a fault, of which parameters take a part


def plan(*, small: bool) -> list[Trial]:
    """All trials; a small plan is the first part of the large one."""
    singles, healthy, pairs, withheld, foreign, weak = (1, 5, 5, 5, 2, 0) if small else (10, 100, 100, 45, 28, 10)
    ideal = 3 if small else 30
    names, faults = list(DRAWS), list(FAULTS)
    kinds = [
        [
            Trial("single", (name,), _size(1000 * k + n), 1000 * k + n)
            for k in range(singles)
            for n, name in enumerate(names)
        ],
        [Trial("healthy", (), 0.0, 50_000 + k) for k in range(healthy)],
        [Trial("pair", pair, 30.0, 60_000 + k) for k, pair in enumerate(_pairs(names)[:pairs])],
        [Trial("withheld", (names[(4 * k) % len(names)],), 40.0, 70_000 + k) for k in range(withheld)],
        [Trial("foreign", (faults[k % len(faults)],), FAULT, 75_000 + k) for k in range(foreign)],
        # One in sixteen of these is healthy.
        [
            Trial("ideal", choice, _size(77_000 + k) if choice else 0.0, 77_000 + k)
            for k, choice in zip(range(ideal), cycle([(), *((name,) for name in names)]), strict=False)
        ],
    ]
    # Clipping has no size in sigma that could be small: half a sample over the limit is either seen or not.
    smooth = [name for name in names if name != "clipping"]
    faint = [
        Trial("weak", (name,), sigma, 80_000 + 100 * n + k)
        for k in range(weak)
        for n, name in enumerate(smooth)
        for sigma in WEAK
    ]
    return _mixed(kinds) + faint


def held_out(added: int = 0) -> list[Trial]:
    """Trials for which no code was ever changed: only their share of right answers is looked at, never one of them.

    With a number added to every seed they are others.
    """
    names, faults = list(DRAWS), list(FAULTS)
    pairs = _pairs(names)[::-1]
    kinds = [
        [Trial("single", (name,), _size(900_000 + n), 900_000 + n) for n, name in enumerate(names)],
        [Trial("healthy", (), 0.0, 910_000 + k) for k in range(8)],
        [Trial("pair", pairs[k], 30.0, 920_000 + k) for k in range(8)],
        [Trial("withheld", (names[(4 * k) % len(names)],), 40.0, 930_000 + k) for k in range(5)],
        [Trial("foreign", (faults[k],), FAULT, 940_000 + k) for k in range(4)],
        [Trial("ideal", (names[2 * k],) if k else (), _size(950_000 + k) if k else 0.0, 950_000 + k) for k in range(5)],
    ]
    return [replace(trial, seed=trial.seed + added) for trial in _mixed(kinds)]


def _mixed(kinds: list[list[Trial]]) -> list[Trial]:
    """Trials of all kinds, so that any first part of them has all kinds in proportion."""
    shares = [(k / len(trials), trial) for trials in kinds for k, trial in enumerate(trials)]
    return [trial for _, trial in sorted(shares, key=lambda pair: pair[0])]


def _size(seed: int) -> float:
    rng = np.random.default_rng([seed, 3])
    return float(np.round(np.exp(rng.uniform(np.log(LEAST), np.log(MOST))), 1))


def _pairs(names: list[str]) -> list[tuple[str, str]]:
    pairs = list(combinations(names, 2))
    return [pairs[k] for k in np.random.default_rng(5).permutation(len(pairs))]


def circuits(*, held_out: bool) -> list[Trial]:
    """Trials behind circuits; those for which code was changed have other seeds than the held-out ones."""
    first, singles, healthy, rest = (2_000_000, 6, 20, 8) if held_out else (1_000_000, 2, 6, 5)
    names, pairs = list(DRAWN), _circuit_pairs()
    pairs = pairs[::-1] if held_out else pairs
    kinds = [
        [
            Trial("single", (name,), _size(first + 100 * k + n), first + 100 * k + n)
            for k in range(singles)
            for n, name in enumerate(names)
        ],
        [Trial("healthy", (), 0.0, first + 10_000 + k) for k in range(healthy)],
        [Trial("pair", pairs[k], 60.0, first + 20_000 + k) for k in range(rest)],
        [Trial("withheld", (names[k % len(names)],), 60.0, first + 30_000 + k) for k in range(rest)],
    ]
    return _mixed(kinds)


def _circuit_pairs() -> list[tuple[str, str]]:
    """Pairs of effects of circuits that some circuit shows both, and of one with one of the fifteen, by turns."""
    both = [(a, b) for a, b in combinations(DRAWN, 2) if set(DRAWN[a].circuits) & set(DRAWN[b].circuits)]
    mixed = [(a, b) for a in DRAWN for b in OTHERS]
    rng = np.random.default_rng(6)
    turns = zip(rng.permutation(len(both)), rng.permutation(len(mixed)), strict=False)
    return [pair for i, j in turns for pair in (both[i], mixed[j])]
