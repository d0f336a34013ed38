"""Outputs of the elements and their inputs at the end of a step, which depend on each other: by Newton's method."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import inlined
from piezoharvest.predict.propagation.element_output import STOP, element_output
from piezoharvest.predict.propagation.products import solve

_MAX_ITERATIONS = 60
_MIN_STEP_SHARE = 0.01  # of a Newton step
_TOLERANCE = 1e-13  # relative residual of the inputs at which Newton ends
_ROUNDING_SHARE = 0.1  # of an input: its rounding error is well below this times _TOLERANCE
_ROUNDED_TOLERANCE = 1e-8  # the same, still accepted if rounding prevents convergence


@inlined
def _evaluate(step, elements, memory, w):
    """Outputs `w` of the elements and their slopes for the trial inputs."""
    before, old, trial, slopes = memory.before, memory.old, memory.trial, memory.slopes
    kinds, places, limits, half = elements.kinds, elements.places, elements.limits, len(old) // 2
    for j in range(len(w)):
        a, b = places[j, 0], places[j, 1]
        if step.held and kinds[j] == STOP:
            w[j] = before[j]
            slopes[j] = 0.0
            slopes[j, 0] = 1.0
            continue
        s = element_output(
            kinds[j], limits[j], before[j], old[a], old[half + a], trial[a], trial[half + a], trial[b], step.h
        )
        w[j] = s[0]
        for q in range(7):
            slopes[j, q] = s[q + 1]


@inlined
def _worst_residual(step, places, sizes, memory, w):
    """Residuals of the trial inputs; the largest, relative to what it is the difference of."""
    base, trial, residual, worst = memory.base, memory.trial, memory.residual, 0.0
    for r in range(len(base)):
        total, size = base[r], max(abs(base[r]), sizes[r])
        for j in range(len(w)):
            total += step.feed[r, j] * w[j]
            # A stop at rest gives the difference of two inputs, with the rounding errors of these.
            size += abs(step.feed[r, j]) * (abs(w[j]) + _ROUNDING_SHARE * abs(trial[places[j, 0]]))
        residual[r, 0] = total - trial[r]
        worst = max(worst, abs(residual[r, 0]) / (size + 1e-300))
    return worst


@inlined
def find_outputs(step, elements, sizes, memory, w):
    """Find outputs `w` of the elements and their inputs, from trial ones; return True if found."""
    trial, move, worst, best, share = memory.trial, memory.move, 0.0, np.inf, 1.0
    for _ in range(_MAX_ITERATIONS):
        _evaluate(step, elements, memory, w)
        worst = _worst_residual(step, elements.places, sizes, memory, w)
        if worst < _TOLERANCE:
            for r in range(len(trial)):
                sizes[r] = max(sizes[r], abs(trial[r]))
            return True
        if worst >= best and share > _MIN_STEP_SHARE:
            # Too far, across a corner of an operator: halve the step.
            share *= 0.5
            for r in range(len(trial)):
                trial[r] -= share * move[r]
            continue
        best, share = worst, 1.0
        solve(step.feed, memory.slopes, elements.places, memory.J, memory.residual)
        for r in range(len(trial)):
            move[r] = memory.residual[r, 0]
            trial[r] += move[r]
    return worst < _ROUNDED_TOLERANCE
