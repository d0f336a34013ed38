"""Compiled propagation over the samples of a record, with derivatives with respect to all parameters.

Between two samples all is linear except the elements, whose outputs over a step depend on the state at its end.
Derivatives are propagated with the step, parameters being the innermost axis so that the loops over them are
vectorised. The functions that make up a step are inlined: it takes less than a microsecond, of which calls with so
many arrays would be a good part.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, entry, inlined

# The order of a tuple's fields is compiled in: their file has to be among the sources of this one.
from piezoharvest.predict.propagation.arguments import (
    BEFORE,
    BY_LIMIT,
    FIRST,
    FIRST_ADDED,
    FIRST_END,
    SECOND,
    SECOND_ADDED,
    SECOND_END,
    Elements,
    ElementSlopes,
    PropagatedState,
    StepDrive,
    StepMatrices,
    StepMemory,
)
from piezoharvest.predict.propagation.newton import find_outputs
from piezoharvest.predict.propagation.products import add_product, assign, clear, dot, scatter, solve, weighted_sums


@inlined
def _apply_drive(drive, step, y, g, k):
    """Set what M is multiplied by in a step, and the drive at its end."""
    q, now, size = drive.coefficients[k], drive.begin + step.share * (k + 1), len(y) - 4
    for j in range(size):
        g[j] = y[j]
    for j in range(4):
        g[size + j] = q[j]
    g[size + 4], g[size + 5] = 1.0, now - step.share
    y[size], y[size + 1] = q[0] + q[1] + q[2] + q[3], (q[1] + 2 * q[2] + 3 * q[3]) / step.h
    y[size + 2], y[size + 3] = 1.0, now


@compiled
def _add_expected(step, memory):
    """Add to trial inputs what outputs give that continue as the cubics that they were in the step before."""
    outputs, trial, count = memory.outputs, memory.trial, len(memory.before)
    for j in range(count):
        if step.feeds[j]:
            w, p, r = outputs[j], outputs[count + j], outputs[2 * count + j]
            w, p = w + (w - memory.before[j]) - 2.0 * p - 4.0 * r, p + 3.0 * r
            for i in step.implicit:
                trial[i] += step.feed[i, j] * w + step.feed[i, count + j] * p + step.feed[i, 2 * count + j] * r


@compiled
def _hold_outputs(step, memory):
    """Trial inputs with outputs as they were before the step."""
    for r in step.implicit:
        memory.trial[r] = memory.base[r]
        for j in range(len(memory.before)):
            memory.trial[r] += step.feed[r, j] * memory.before[j]


@inlined
def _advance(step, elements, state, memory):
    """States, inputs and outputs of the elements at the end of a step; return True if found."""
    y, inputs, trial, n, count = state.y, state.inputs, memory.trial, len(memory.z), len(memory.before)
    dot(step.M, memory.g, memory.z)
    for r in range(n):
        y[r] = memory.z[r]
    dot(step.inputs, y, memory.base)
    for r in range(len(inputs)):
        memory.old[r], trial[r] = inputs[r], memory.base[r]
    _add_expected(step, memory)
    for j in range(count):
        memory.before[j] = y[n + j]
    found = False
    for attempt in range(2):
        if attempt > 0:  # an output that jumped goes on as no cubic does
            _hold_outputs(step, memory)
        found = find_outputs(step, elements, state.sizes, memory)
        if found:
            break
    if not found:
        return False
    for r in range(len(inputs)):
        inputs[r] = trial[r]
    for j in range(count):
        y[n + j] = memory.outputs[j]
        state.local[j, 0] += memory.slopes[0, j, FIRST_END]
        state.local[j, 1] += memory.slopes[0, j, SECOND_END]
    for r in range(n):
        for j in range(3 * count):
            y[r] += step.H[r, j] * memory.outputs[j]
    return True


@inlined
def _advance_state_derivatives(drive, step, slopes, state, memory, k):
    """Derivatives of the states, without the influence of those of the elements' present outputs."""
    d, dz = state.d, memory.dz
    n, driven = len(dz), len(memory.z) + len(memory.before)
    weighted_sums(slopes.M, memory.g)
    clear(dz)
    scatter(slopes.M, 0, len(slopes.M.sums), 0, dz)
    if len(drive.rise):
        for r in range(n):
            dz[r, drive.lane] += step.M[r, driven] * drive.rise[k, 0]
            dz[r, drive.lane + 1] += step.M[r, driven] * drive.rise[k, 1]
    add_product(slopes.from_states, d, dz)
    weighted_sums(slopes.H, memory.outputs)
    scatter(slopes.H, 0, len(slopes.H.sums), 0, dz)
    assign(dz, d)


@inlined
def _advance_element_derivatives(step, elements, slopes, state, memory):
    """Derivatives of the elements' inputs and outputs."""
    d, dinputs, right, places = state.d, state.dinputs, memory.right, elements.places
    n, half, parameters, count = len(memory.z), len(elements.rated), d.shape[1], len(places)
    clear(right)
    if elements.reached:
        _differentiate_added(elements, slopes, d, memory, right[2 * half :])
    # First the part of the outputs that does not depend on the elements' present inputs; the values at the end last, as
    # the others depend on the previous ones.
    for j in range(count):
        a, b = places[j, 0], places[j, 1]
        for q in range(2 if elements.acts[j] else 0, -1, -1):
            s, at = memory.slopes[q, j], n + q * count + j
            if memory.off[j]:
                for p in range(parameters):
                    d[at, p] = 0.0
                continue
            before, one, two, three, four, limit = (
                s[BEFORE],
                s[FIRST],
                s[FIRST + 1],
                s[SECOND],
                s[SECOND + 1],
                s[BY_LIMIT],
            )
            for p in range(parameters):
                d[at, p] = (
                    before * d[n + j, p]
                    + one * dinputs[a, p]
                    + two * dinputs[half + a, p]
                    + limit * slopes.limits[j, p]
                )
            if three != 0.0 or four != 0.0:
                for p in range(parameters):
                    d[at, p] += three * dinputs[b, p] + four * dinputs[half + b, p]
    weighted_sums(slopes.O, state.y)
    scatter(slopes.O, 0, slopes.input_entries, 0, right)
    add_product(slopes.to_inputs, d, right)
    solve(step, memory.slopes, elements, memory.off, memory.J, right)
    assign(right, dinputs)
    for j in range(count):
        if memory.off[j]:
            continue
        a, b = places[j, 0], places[j, 1]
        for q in range(3 if elements.acts[j] else 1):
            s, at = memory.slopes[q, j], n + q * count + j
            one, two, three, four = s[FIRST_END], s[FIRST_END + 1], s[SECOND_END], s[SECOND_END + 1]
            for p in range(parameters):
                d[at, p] += one * dinputs[a, p] + two * dinputs[half + a, p]
            if three != 0.0 or four != 0.0:
                for p in range(parameters):
                    d[at, p] += three * dinputs[b, p] + four * dinputs[half + b, p]
            if elements.added[a] >= 0:
                _add_through_added(elements, a, s[FIRST_ADDED], s[FIRST_ADDED + 1], dinputs, d[at])
            if elements.added[b] >= 0:
                _add_through_added(elements, b, s[SECOND_ADDED], s[SECOND_ADDED + 1], dinputs, d[at])


@compiled
def _differentiate_added(elements, slopes, d, memory, right):
    """Derivatives of what the elements' outputs add to inputs' coefficients, those of outputs at the end left out."""
    before, outputs, rises, count = memory.before, memory.outputs, memory.rises, len(memory.before)
    for j in range(count):
        p, r, risen = outputs[count + j], outputs[2 * count + j], outputs[j] - before[j]
        rises[0, j], rises[1, j] = risen + p, r - p - 3.0 * risen
    add_product(slopes.before_added, d, right)
    for k in range(2):
        weighted_sums(slopes.added, rises[k])
        scatter(slopes.added, 0, len(slopes.added.sums), -k * elements.reached, right)


@compiled
def _add_through_added(elements, place, one, two, dinputs, out):
    """Add to an output's derivatives those by what outputs add to an input's coefficients."""
    added = elements.added[place]
    for p in range(len(out)):
        out[p] += one * dinputs[added, p] + two * dinputs[added + elements.reached, p]


@inlined
def _advance_derivatives(drive, step, elements, slopes, state, memory, k):
    """Derivatives at the end of a step, of which the values are known."""
    _advance_state_derivatives(drive, step, slopes, state, memory, k)
    _advance_element_derivatives(step, elements, slopes, state, memory)
    add_product(slopes.from_elements, state.d, memory.dz)
    assign(memory.dz, state.d)


@inlined
def _write_derivatives(elements, slopes, state, out):
    """Write the derivatives of the outputs."""
    clear(out)
    scatter(slopes.O, slopes.input_entries, len(slopes.O.sums), 2 * len(elements.rated), out)
    add_product(slopes.to_outputs, state.d, out)


@partial(entry, nogil=True)
def propagate_block(
    drive: StepDrive, step: StepMatrices, slopes: ElementSlopes, elements: Elements, state: PropagatedState,
    memory: StepMemory, Y: np.ndarray, dY: np.ndarray,
) -> int:  # fmt: skip
    """Propagate over a block of steps.

    Parameters
    ----------
    drive : StepDrive
    step : StepMatrices
    slopes : ElementSlopes
        Of no parameters if no derivatives are wanted.
    elements : Elements
    state : PropagatedState
        At the beginning; overwritten by that at the end.
    memory : StepMemory
    Y : (samples, outputs) array
    dY : (samples, outputs, parameters) array
        Both outputs, at the ends of each `drive.every` steps.

    Returns
    -------
    int
        -1, or the step in which Newton's method failed.
    """
    for k in range(len(drive.coefficients)):
        _apply_drive(drive, step, state.y, memory.g, k)
        if not _advance(step, elements, state, memory):
            return k
        sample, written = k // drive.every, (k + 1) % drive.every == 0
        if written:
            dot(step.outputs, state.y, Y[sample])
        if state.d.shape[1]:
            _advance_derivatives(drive, step, elements, slopes, state, memory, k)
            if written:
                _write_derivatives(elements, slopes, state, dY[sample])
    return -1
