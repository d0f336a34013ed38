"""Recording of a motion: samples, extremes, energies and sensitivities."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.events.event_location import locate
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import dot_column, vector
from piezoharvest.engine.memory.tables import block_of, slot_of
from piezoharvest.engine.memory.vector import copy, dot, form, form_size, grow, multiply
from piezoharvest.engine.motion.energy_forms import bit_of_energy, energies_of_steps
from piezoharvest.engine.motion.exact_step import FLOW, SAMPLE, SAVED, SERIES, propagate_exactly, taylor_terms
from piezoharvest.engine.motion.mode_forms import STIFF_LEVELS
from piezoharvest.engine.propagation.quadrature import add_energies_of_series, energies_by_quadrature
from piezoharvest.engine.work_limit import spend_products

# Of the terms of the form of a finest step: rounding of some thirty sums on each of the first levels.
FORM_ROUNDING = 2.0**-46
NEGLIGIBLE_SHARE = 1e-13  # of an energy: smaller rounding is ignored
TIME_TOLERANCE = 1e-11  # fraction of a step: a sample's time this close to its end is at the end


@compiled
def record_outputs(P, L, S, D, slot, tau, end, arrived):
    """Record samples and extremes between the present state and that at `arrived`, tau later, at the time `end`."""
    now = S[D[st.CLOCK]]
    z, outputs = vector(L, D, SAMPLE), block_of(L, slot) + L[tb.OUTPUTS]
    rounding = max(TIME_TOLERANCE * tau, 1e-15 * end)
    while D[st.SAMPLED] < D[st.SAMPLES_WANTED] and S[D[st.SAMPLE_TIME] + D[st.SAMPLED]] <= end:
        k = D[st.SAMPLED]
        into = S[D[st.SAMPLE_TIME] + k] - now
        here = D[st.SAMPLES] + k * len(pg.OUTPUTS)
        if into <= rounding:
            multiply(P, outputs, tb.OUTPUT_ROWS, L[pg.COLUMNS], S, 0, here)
        elif into >= tau - rounding:
            multiply(P, outputs, tb.OUTPUT_ROWS, L[pg.COLUMNS], S, arrived, here)
        else:
            propagate_exactly(P, L, S, D, slot, 0, into, z)
            multiply(P, outputs, tb.OUTPUT_ROWS, L[pg.COLUMNS], S, z, here)
        D[st.SAMPLED] += 1
    if D[st.TRACKED]:
        at = slot_of(L, slot)
        first = L[at + tb.GUARD_COUNT] - pg.WATCHED
        for k in range(pg.WATCHED):
            output = outputs + (pg.DISPLACEMENT if k == 0 else pg.VOLTAGE)
            row = L[at + tb.FIRST_GUARD + 2 * (first + k) + 1]
            _record_turning_point(P, L, S, D, slot, tau, arrived, k, output, row)


@compiled
def _record_turning_point(P, L, S, D, slot, tau, arrived, k, output, row):
    """Widen the extremes by the ends of a step, and by the turning point where the output's rate changes sign.

    The rate is a form of the mode, at `row`.
    """
    a, rows, z = L[pg.A], L[pg.ROWS], vector(L, D, SAMPLE)
    rate = block_of(L, slot) + L[tb.LINES] + 2 * row * rows
    first, last = dot_column(P, output, tb.OUTPUT_ROWS, S, 0, a), dot_column(P, output, tb.OUTPUT_ROWS, S, arrived, a)
    _extend_extremes(S, D, k, first)
    _extend_extremes(S, D, k, last)
    before, after = dot(P, rate, S, 0, rows), dot(P, rate, S, arrived, rows)
    if not before * after < 0.0 or not _may_be_extreme(S, D, k, first, last, before, after, tau):
        return
    sign = 1.0 if after > 0.0 else -1.0
    locate(P, L, S, D, slot, row, sign, 0.0, 0.0, tau, tau * before / (before - after), z)
    _extend_extremes(S, D, k, dot_column(P, output, tb.OUTPUT_ROWS, S, z, a))


@inlined
def _may_be_extreme(S, D, k, first, last, before, after, tau):
    """True if an output that turns between two values, with rates at both, may pass its extremes so far.

    It stays on its side of the tangents at both ends where its rate is monotone; it is allowed to pass the nearer end
    by twice as much as these do.
    """
    meets = first + before * (last - first - after * tau) / (before - after)
    lowest = S[D[st.EXTREMES] + 2 * k]
    highest = S[D[st.EXTREMES] + 2 * k + 1]
    if before > 0.0:
        return 2.0 * meets - max(first, last) > highest
    return 2.0 * meets - min(first, last) < lowest


@compiled
def _extend_extremes(S, D, k, value):
    lowest = D[st.EXTREMES] + 2 * k
    S[lowest] = min(S[lowest], value)
    S[lowest + 1] = max(S[lowest + 1], value)


@compiled
def record_energies(P, L, S, D, slot, tau, level):
    """Add energies over tau from the present state.

    `level` is the level of a full step, or NONE for any tau.
    """
    if D[st.ENERGIES] == 0:
        return
    if not L[slot_of(L, slot) + tb.ACCOUNTED]:
        L[slot_of(L, slot) + tb.ACCOUNTED] = energies_of_steps(P, L, slot, D[st.CONFIGURATION])
    if level != NONE:
        _full_step(P, L, S, D, slot, level)
        return
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    finest, steps = L[slot_of(L, slot) + tb.FINEST_LEVEL], block + L[tb.STEPS]
    rest, kept, out = tau, vector(L, D, SAVED), vector(L, D, FLOW)
    copy(S, 0, kept, rows)
    for k in range(finest + 1):
        if rest >= P[steps + k]:
            _full_step(P, L, S, D, slot, k)
            grow(P, block + L[tb.GROWTH] + k * rows * columns, rows, columns, S, 0, out)
            copy(S, out, 0, rows)
            rest -= P[steps + k]
    if rest > 0.0:
        copy(S, 0, vector(L, D, SERIES), rows)
        taylor_terms(P, L, S, D, slot)
        add_energies_of_series(P, L, S, D, slot, rest / P[steps + finest])
    copy(S, kept, 0, rows)


@compiled
def _full_step(P, L, S, D, slot, level):
    """Add energies of a full step of one level from the present state, as quadratic forms of it.

    In a stiff mode the rounding error in the form of the finest step has been doubled with it, and a small power
    results as a difference of large ones. If that matters, quadrature is used where it agrees with the form to that
    rounding: it is then as good, and far better if the motion is smooth.
    """
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    spend_products(L, D[st.ENERGIES])
    square, finest, known = rows * columns, L[slot_of(L, slot) + tb.FINEST_LEVEL], False
    felt = L[slot_of(L, slot) + tb.ACCOUNTED]
    for e in range(D[st.ENERGIES]):
        if not felt & bit_of_energy(e):
            continue
        forms = block + L[tb.GRAMIAN] + e * square
        total = form(P, forms + level * L[tb.LEDGER] * square, rows, columns, S, 0)
        if finest >= STIFF_LEVELS:
            size = form_size(P, forms + finest * L[tb.LEDGER] * square, rows, columns, S, 0)
            rounding = size * FORM_ROUNDING * 2.0 ** (finest - level)
            if rounding > NEGLIGIBLE_SHARE * abs(total):
                if not known:
                    energies_by_quadrature(P, L, S, D, slot, level)
                    known = True
                if abs(S[D[st.QUADRATURE] + e] - total) <= rounding:
                    total = S[D[st.QUADRATURE] + e]
        S[D[st.ENERGY] + e] += total
