"""Outputs of smooth nonlinear elements, and the rates of these, from the rest of the state."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.algebra import back_substitute, eliminate, is_unit
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import dot_column
from piezoharvest.engine.memory.tables import block_of
from piezoharvest.engine.memory.vector import multiply
from piezoharvest.engine.motion.charge_transfer import charge_slope, move_charge
from piezoharvest.engine.motion.curves import curve_of
from piezoharvest.equations.terms import CURVE, PIECEWISE, PRODUCT, TIMED

MAX_ITERATIONS = 40
NEXT = 1e-9  # of a step: what lies so far ahead tells the piece that it goes through, where it begins at a corner
STEP_TOLERANCE = 1e-9  # of outputs or state: largest last step of Newton's method that counts as converged
# Scratch behind CURVE: length of the next step and of the last one, admissible error of outputs, vectors, the matrix of
# the outputs and its sides.
START, FLOW, MOVED, END, MATRIX = range(5)


@inlined
def scratch(L, D, k):
    """Place of a scratch vector in S."""
    return D[st.CURVE] + 3 + k * L[pg.ROWS]


@inlined
def tolerance_of(S, D):
    """Admissible error of an output within a step, relative to the state: both are scaled to the root of energy."""
    return S[D[st.CURVE] + 2]


@inlined
def element_of(L, k):
    """Place of an element's output in the augmented state; its derivatives follow."""
    return L[pg.N] + pg.DERIVATIVES * k


@inlined
def scale_of(P, L, place):
    """Factor from an exogenous state to its SI value."""
    return P[L[pg.EXO_SCALE] + place - L[pg.N]]


@compiled
def size_of(L, S, z):
    """Size of a state and of the signal."""
    total = 0.0
    for i in range(L[pg.N]):
        total += S[z + i] ** 2
    for i in range(L[pg.SIGNAL], L[pg.SIGNAL] + 2 * max(L[pg.TONE_COUNT], 1)):
        total += S[z + i] ** 2
    return np.sqrt(total)


@compiled
def input_of(P, L, S, z, k, which):
    """First or second input of an element at a state."""
    return dot_column(P, L[pg.ELEMENT_Z] + (2 * k + which) * L[pg.A], 1, S, z, L[pg.A])


@inlined
def corners(L):
    """Number of corners of all piecewise elements."""
    return L[L[pg.FIRST_CORNER] + L[pg.ELEMENTS]]


@compiled
def segment_at(P, L, k, first):
    """Number of the piece of a piecewise element in which an input lies."""
    at, end = L[L[pg.FIRST_CORNER] + k], L[L[pg.FIRST_CORNER] + k + 1]
    segment = 0
    while at + segment < end and P[L[pg.CORNERS] + at + segment] <= first:
        segment += 1
    return segment


@compiled
def _piece_of(P, L, D, k, first):
    """Place of the polynomial of a piecewise element: that which is held over a step, or that of the input."""
    held = D[D[st.SEGMENTS] + k]
    segment = held - 1 if held else segment_at(P, L, k, first)
    return L[pg.PIECES] + 3 * (L[L[pg.FIRST_CORNER] + k] + k + segment)


@compiled
def release(L, D):
    """Let the outputs of piecewise elements follow their inputs from piece to piece, as where a state jumps."""
    for k in range(L[pg.ELEMENTS]):
        D[D[st.SEGMENTS] + k] = 0


@compiled
def output_of(P, L, D, k, first, second, time):
    """Output of an element for these inputs."""
    power = L[L[pg.ELEMENT_POWER] + k]
    if power == TIMED:
        return P[L[pg.DRIFT]] * time * first
    if power == PIECEWISE:
        at = _piece_of(P, L, D, k, first)
        return P[at] + first * (P[at + 1] + first * P[at + 2])
    if power <= CURVE:
        return curve_of(CURVE - power, first)[0]
    return first * second if power == PRODUCT else first**power


@compiled
def slope_of(P, L, D, k, first, second, time, which):
    """Derivative of the output of an element by one of its inputs."""
    power = L[L[pg.ELEMENT_POWER] + k]
    if power == PRODUCT:
        return first if which else second
    if which:
        return 0.0
    if power == PIECEWISE:
        at = _piece_of(P, L, D, k, first)
        return P[at + 1] + 2.0 * first * P[at + 2]
    if power <= CURVE:
        return curve_of(CURVE - power, first)[1]
    return P[L[pg.DRIFT]] * time if power == TIMED else power * first ** (power - 1)


@compiled
def solve(L, S, D):
    """Solve the equations of the outputs; the solution overwrites the right side."""
    count = L[pg.ELEMENTS]
    matrix = scratch(L, D, MATRIX)
    right = matrix + count * count
    if is_unit(S, matrix, count):
        return
    rank = eliminate(S, D, matrix, right, count, 1, D[st.PIVOTS])
    out = right + count
    for k in range(count):
        S[out + k] = 0.0
    back_substitute(S, D, matrix, right, count, 1, D[st.PIVOTS], rank, out)
    for k in range(count):
        S[right + k] = S[out + k]


@compiled
def equations(P, L, S, D, z, time, row, slope):
    """Set the Jacobian of the equations of `outputs_at`: the unit matrix less the outputs' mutual derivatives."""
    count, matrix = L[pg.ELEMENTS], scratch(L, D, MATRIX)
    for k in range(count):
        first, second = input_of(P, L, S, z, k, 0), input_of(P, L, S, z, k, 1)
        for m in range(count):
            place, total = element_of(L, m), 0.0
            for which in range(2):
                form = L[pg.ELEMENT_Z] + (2 * k + which) * L[pg.A]
                by_output = P[form + place]
                if row != NONE:
                    by_output -= charge_slope(P, L, D, form) * P[row + place] / slope
                total += slope_of(P, L, D, k, first, second, time, which) * by_output
            S[matrix + k * count + m] = (1.0 if k == m else 0.0) - total / scale_of(P, L, element_of(L, k))


@compiled
def outputs_at(P, L, S, D, z, time, row, slope):
    """Set the outputs so that they agree with the rest of a state, by Newton's method: their inputs depend on them.

    With the row of a linear form the charge is moved as well, so that the form is zero; `slope` is its derivative with
    respect to the charge. If there is no solution the state is NaN.
    """
    count, right = L[pg.ELEMENTS], scratch(L, D, MATRIX) + L[pg.ELEMENTS] * L[pg.ELEMENTS]
    largest = change = last = np.inf
    for _ in range(MAX_ITERATIONS):
        if row != NONE:
            move_charge(P, L, S, D, z, -dot_column(P, row, 1, S, z, L[pg.A]) / slope)
        for k in range(count):
            place, first, second = element_of(L, k), input_of(P, L, S, z, k, 0), input_of(P, L, S, z, k, 1)
            S[right + k] = output_of(P, L, D, k, first, second, time) / scale_of(P, L, place) - S[z + place]
        equations(P, L, S, D, z, time, row, slope)
        solve(L, S, D)
        largest, change = 0.0, 0.0
        for k in range(count):
            S[z + element_of(L, k)] += S[right + k]
            change, largest = max(change, abs(S[right + k])), max(largest, abs(S[z + element_of(L, k)]))
        # At the level of rounding the step no longer decreases.
        if change <= 1e-15 * largest or (change <= 1e-12 * largest and not change < 0.5 * last):
            break
        last = change
    if row != NONE:
        move_charge(P, L, S, D, z, -dot_column(P, row, 1, S, z, L[pg.A]) / slope)
    if not change <= STEP_TOLERANCE * max(largest, size_of(L, S, z)):
        S[z] = np.nan


@compiled
def outputs(P, L, S, D, z, time):
    """Set the outputs so that they agree with the rest of a state."""
    outputs_at(P, L, S, D, z, time, NONE, 1.0)


@compiled
def _rates(P, L, S, D, slot, z, time, right):
    """Rates of the outputs that follow from the rates of a state, which depend on the rates it contains."""
    flow = scratch(L, D, FLOW)
    multiply(P, block_of(L, slot) + L[tb.MATRIX], L[pg.ROWS], L[pg.COLUMNS], S, z, flow)
    for k in range(L[pg.ELEMENTS]):
        first, second, total = input_of(P, L, S, z, k, 0), input_of(P, L, S, z, k, 1), 0.0
        for which in range(2):
            total += slope_of(P, L, D, k, first, second, time, which) * input_of(P, L, S, flow, k, which)
        if L[L[pg.ELEMENT_POWER] + k] == TIMED:
            total += P[L[pg.DRIFT]] * first
        S[right + k] = total / scale_of(P, L, element_of(L, k) + 1)


@compiled
def _rate_equation(P, L, S, D, slot, z, time, k, row):
    """Set a row of the equations of the rates: that of the unit matrix less what each rate does to that of output k."""
    count, rows, flow = L[pg.ELEMENTS], L[pg.ROWS], block_of(L, slot) + L[tb.MATRIX]
    for m in range(count):
        S[row + m] = 1.0 if k == m else 0.0
    first, second = input_of(P, L, S, z, k, 0), input_of(P, L, S, z, k, 1)
    for which in range(2):
        form = L[pg.ELEMENT_Z] + (2 * k + which) * L[pg.A]
        share = slope_of(P, L, D, k, first, second, time, which) / scale_of(P, L, element_of(L, k) + 1)
        for j in range(L[pg.A]) if share != 0.0 else range(0):
            if P[form + j] != 0.0:
                for m in range(count):
                    S[row + m] -= share * P[form + j] * P[flow + (element_of(L, m) + 1) * rows + j]


@compiled
def set_outputs_and_rates(P, L, S, D, slot, z, time):
    """Set the outputs and their rates so that they agree with the rest of a state.

    The equations of the rates are linear.
    """
    outputs(P, L, S, D, z, time)
    set_rates(P, L, S, D, slot, z, time)


@compiled
def set_rates(P, L, S, D, slot, z, time):
    """Set the rates of the outputs so that they agree with the rest of a state."""
    count, matrix = L[pg.ELEMENTS], scratch(L, D, MATRIX)
    right = matrix + count * count
    for k in range(count):
        S[z + element_of(L, k) + 1] = 0.0
    _rates(P, L, S, D, slot, z, time, right)
    for k in range(count):
        _rate_equation(P, L, S, D, slot, z, time, k, matrix + k * count)
    solve(L, S, D)
    for k in range(count):
        S[z + element_of(L, k) + 1] = S[right + k]
