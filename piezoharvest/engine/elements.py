"""Smooth nonlinear elements at a state: what their outputs and the slopes of these are, the rest of it being given."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine import state as st
from piezoharvest.engine import tables as tb
from piezoharvest.engine.algebra import back_substitute, eliminate
from piezoharvest.engine.compiled import compiled, inlined
from piezoharvest.engine.state import dot_column
from piezoharvest.engine.tables import block_of
from piezoharvest.engine.vector import multiply
from piezoharvest.terms import PRODUCT, TIMED

NEWTONS = 40
# Scratch behind CURVE: length of the next step and of the last one, vectors, the matrix of the outputs and its sides.
START, FLOW, MOVED, END, MATRIX = range(5)


@inlined
def scratch(L, D, k):
    """Where a scratch vector stands in S."""
    return D[st.CURVE] + 2 + k * L[pg.ROWS]


@inlined
def element_of(L, k):
    """Where the output of an element stands in the augmented state, its derivatives behind it."""
    return L[pg.N] + pg.DERIVATIVES * k


@inlined
def scale_of(P, L, place):
    """What an exogenous state is to be multiplied by to be in its unit."""
    return P[L[pg.EXO_SCALE] + place - L[pg.N]]


@compiled
def input_of(P, L, S, z, k, which):
    """First or second input of an element at a state."""
    return dot_column(P, L[pg.ELEMENT_Z] + (2 * k + which) * L[pg.A], 1, S, z, L[pg.A])


@compiled
def output_of(P, L, k, first, second, time):
    """Output of an element for these inputs."""
    power = L[L[pg.ELEMENT_POWER] + k]
    if power == TIMED:
        return P[L[pg.DRIFT]] * time * first
    return first * second if power == PRODUCT else first**power


@compiled
def slope_of(P, L, k, first, second, time, which):
    """Derivative of the output of an element by one of its inputs."""
    power = L[L[pg.ELEMENT_POWER] + k]
    if power == PRODUCT:
        return first if which else second
    if which:
        return 0.0
    return P[L[pg.DRIFT]] * time if power == TIMED else power * first ** (power - 1)


@compiled
def solve(L, S, D):
    """Solve the equations of the outputs; the solution takes the place of the right side."""
    count = L[pg.ELEMENTS]
    matrix = scratch(L, D, MATRIX)
    right = matrix + count * count
    rank = eliminate(S, D, matrix, right, count, 1, D[st.PIVOTS])
    out = right + count
    for k in range(count):
        S[out + k] = 0.0
    back_substitute(S, D, matrix, right, count, 1, D[st.PIVOTS], rank, out)
    for k in range(count):
        S[right + k] = S[out + k]


@compiled
def outputs(P, L, S, D, z, time):
    """Set the outputs to what the rest of a state makes of them, by Newton's method: the voltage depends on them."""
    count, matrix = L[pg.ELEMENTS], scratch(L, D, MATRIX)
    right = matrix + count * count
    last = np.inf
    for _ in range(NEWTONS):
        largest, change = 0.0, 0.0
        for k in range(count):
            own, first, second = z + element_of(L, k), input_of(P, L, S, z, k, 0), input_of(P, L, S, z, k, 1)
            S[right + k] = output_of(P, L, k, first, second, time) / scale_of(P, L, element_of(L, k)) - S[own]
            for m in range(count):
                slope = 0.0
                for which in range(2):
                    row = L[pg.ELEMENT_Z] + (2 * k + which) * L[pg.A]
                    slope += slope_of(P, L, k, first, second, time, which) * P[row + element_of(L, m)]
                S[matrix + k * count + m] = (1.0 if k == m else 0.0) - slope / scale_of(P, L, element_of(L, k))
        solve(L, S, D)
        for k in range(count):
            S[z + element_of(L, k)] += S[right + k]
            change, largest = max(change, abs(S[right + k])), max(largest, abs(S[z + element_of(L, k)]))
        # At the level of rounding it no longer gets better.
        if change <= 1e-15 * largest or (change <= 1e-12 * largest and not change < 0.5 * last):
            break
        last = change


@compiled
def _rates(P, L, S, D, slot, z, time, right):
    """What the rates of a state, with the slopes of the outputs that it holds, make of these slopes."""
    flow = scratch(L, D, FLOW)
    multiply(P, block_of(L, slot) + L[tb.MATRIX], L[pg.ROWS], L[pg.COLUMNS], S, z, flow)
    for k in range(L[pg.ELEMENTS]):
        first, second, total = input_of(P, L, S, z, k, 0), input_of(P, L, S, z, k, 1), 0.0
        for which in range(2):
            total += slope_of(P, L, k, first, second, time, which) * input_of(P, L, S, flow, k, which)
        if L[L[pg.ELEMENT_POWER] + k] == TIMED:
            total += P[L[pg.DRIFT]] * first
        S[right + k] = total / scale_of(P, L, element_of(L, k) + 1)


@compiled
def lift(P, L, S, D, slot, z, time):
    """Set the outputs and their slopes to what the rest of a state makes of them.

    The equations of the slopes are linear; their columns are what a slope of one makes of all others.
    """
    outputs(P, L, S, D, z, time)
    count, matrix = L[pg.ELEMENTS], scratch(L, D, MATRIX)
    right = matrix + count * count
    for k in range(count):
        S[z + element_of(L, k) + 1] = 0.0
    for m in range(count):
        S[z + element_of(L, m) + 1] = 1.0
        _rates(P, L, S, D, slot, z, time, right)
        S[z + element_of(L, m) + 1] = 0.0
        for k in range(count):
            S[matrix + k * count + m] = S[right + k]
    _rates(P, L, S, D, slot, z, time, right)
    for k in range(count):
        for m in range(count):
            S[matrix + k * count + m] = (1.0 if k == m else 0.0) - (S[matrix + k * count + m] - S[right + k])
    solve(L, S, D)
    for k in range(count):
        S[z + element_of(L, k) + 1] = S[right + k]
