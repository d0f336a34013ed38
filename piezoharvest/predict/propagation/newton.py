"""Outputs of the elements and their inputs at the end of a step, which depend on each other: by Newton's method."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import inlined
from piezoharvest.predict.propagation.element_output import set_output
from piezoharvest.predict.propagation.products import solve

_MAX_ITERATIONS = 60
_MIN_STEP_SHARE = 0.01  # of a Newton step
# Relative residuals of the inputs at which Newton ends: as they are, and where rounding prevents a tenth of them. What
# is left of them moves states that follow quasi-statically by much more, 1e11 times as much in a stack of 22 kHz under
# steps of seconds, and a cost that it makes uneven has no smooth valley.
_TOLERANCE, _LIMIT_OF_ROUNDING = 1e-15, 1e-13
_EXACT = 1e-17  # the same at start values, whose error no step of Newton's has squared: elements are at rest
_ROUNDING_SHARE = 0.1  # of an input: its rounding error is well below this times _LIMIT_OF_ROUNDING
_ROUNDED_TOLERANCE = 1e-8  # the same, still accepted if rounding prevents convergence


@inlined
def _worst_residual(step, places, sizes, memory):
    """Residuals of the implicit trial inputs; the largest, relative to what it is the difference of."""
    base, trial, residual, outputs, worst = memory.base, memory.trial, memory.residual, memory.outputs, 0.0
    count = len(places)
    for r in step.implicit:
        total, size = base[r], max(abs(base[r]), sizes[r])
        for j in range(count):
            if memory.off[j] or not step.feeds[j]:
                continue
            # A stop at rest gives the difference of two inputs, with the rounding errors of these.
            rounded = _ROUNDING_SHARE * abs(trial[places[j, 0]])
            for q in range(3):
                fed = step.feed[r, q * count + j]
                total += fed * outputs[q * count + j]
                size += abs(fed) * (abs(outputs[q * count + j]) + rounded)
        residual[r, 0] = total - trial[r]
        worst = max(worst, abs(residual[r, 0]) / (size + 1e-300))
    return worst


@inlined
def _find_inputs(step, elements, sizes, memory):
    """Find inputs, from trial ones, and the outputs that they depend on; return True if found."""
    trial, move, worst, best, share = memory.trial, memory.move, 0.0, np.inf, 1.0
    for r in step.explicit:
        memory.residual[r, 0] = 0.0
    for iteration in range(_MAX_ITERATIONS):
        for j in range(len(elements.places)):
            if step.feeds[j]:
                set_output(j, step, elements, memory)
        worst = _worst_residual(step, elements.places, sizes, memory)
        if worst < (_TOLERANCE if iteration else _EXACT) or 0.1 * best <= worst < _LIMIT_OF_ROUNDING:
            return True
        if worst >= best and share > _MIN_STEP_SHARE:
            # Too far, across a corner of an operator: halve the step.
            share *= 0.5
            for r in step.implicit:
                trial[r] -= share * move[r]
            continue
        best, share = worst, 1.0
        solve(step, memory.slopes, elements, memory.off, memory.J, memory.residual)
        for r in step.implicit:
            move[r] = memory.residual[r, 0]
            trial[r] += move[r]
    return worst < _ROUNDED_TOLERANCE


@inlined
def find_outputs(step, elements, sizes, memory):
    """Find outputs of the elements and their inputs, from trial ones; return True if found."""
    if not _find_inputs(step, elements, sizes, memory):
        return False
    for r in range(len(memory.trial)):
        sizes[r] = max(sizes[r], abs(memory.trial[r]))
    for j in range(len(elements.places)):
        if not step.feeds[j]:
            set_output(j, step, elements, memory)
    return True
