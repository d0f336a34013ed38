"""Compiled search for the steady states of many designs one after the other: search, then one recorded span."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import stored
from piezoharvest.engine.propagation.advance import DONE
from piezoharvest.engine.steady_state import section as sc
from piezoharvest.engine.steady_state import shooting as sh
from piezoharvest.engine.work_limit import MAX_WORK, interrupted

# Columns of the results of a design, followed by its energies.
SETTLED, EVALUATED, EVENTS, DISPLACEMENT, VOLTAGE, STORED, ENERGIES = range(7)


@compiled
def reset(P, L, S, D):
    """Put a state at rest at time zero, with nothing recorded."""
    for i in range(D[st.END]):
        S[i] = 0.0
    for k in range(st.MODE):
        D[k] = 0
    D[st.MODE] = NONE
    for j in range(L[pg.H]):
        D[D[st.SLIP] + j] = 0
    S[D[st.CLOCK] + st.OPENS], S[D[st.CLOCK] + st.ACTED] = np.inf, -np.inf
    if L[pg.SWITCHED] == pg.CLOCKED:
        D[st.CLOSED] = 1
        S[D[st.CLOCK] + st.OPENS] = 0.5 * P[L[pg.ON_TIME]] * P[L[pg.STAGE]]
    for k in range(pg.WATCHED):
        S[D[st.EXTREMES] + 2 * k], S[D[st.EXTREMES] + 2 * k + 1] = np.inf, -np.inf
    for i in range(L[pg.N]):
        S[i] = P[L[pg.EQUILIBRIUM] + i]


@compiled
def _half_span(S, D, k, mirrored):
    """Half of peak-to-peak; after half a period the other half is its mirror image."""
    lowest, highest = S[D[st.EXTREMES] + 2 * k], S[D[st.EXTREMES] + 2 * k + 1]
    return max(highest, -lowest) if mirrored else 0.5 * (highest - lowest)


@compiled
def _record(P, L, S, D, W, V, out, at, mirrored):
    """Run the orbit through one span and store the results for a period."""
    reset(P, L, S, D)
    sc.load(P, L, S, D, W, V, sc.BEST, W[sc.TIME], 0)
    # Smooth elements compute their outputs from the state at the beginning of a run.
    if sh.run_to(P, L, S, D, W, V, W[sc.TIME]) != DONE:
        return
    before, periods = stored(P, L, S), 2.0 if mirrored else 1.0
    if sh.run_to(P, L, S, D, W, V, W[sc.TIME] + W[sc.SPAN]) != DONE:
        return
    sc.save(P, L, S, D, W, V, sc.END, mirrored)
    if sc.distance(P, L, W, V, sc.BEST) > sh.MAX_CHANGE:
        return
    out[at + SETTLED] = 1.0
    out[at + EVENTS] = periods * D[st.LOGGED]
    out[at + DISPLACEMENT] = _half_span(S, D, 0, mirrored)
    out[at + VOLTAGE] = _half_span(S, D, 1, mirrored)
    out[at + STORED] = periods * (stored(P, L, S) - before)
    for e in range(D[st.ENERGIES]):
        out[at + ENERGIES + e] = periods * S[D[st.ENERGY] + e]


@compiled
def steady_states(P, L, S, D, W, V, s, d, r, e, designs, count, out, width, symmetric):
    """Find and record the steady states of a number of designs.

    `designs` holds their programs row by row, `out` receives `width` numbers for each. The states are those of
    `shooting.find`, and (r, e) that which records. A symmetric orbit may be unstable where an asymmetric one is stable:
    if none is found on half the period, the whole period is tried. The work left on entry is that of all designs; each
    may take what one simulation may, and those for which none is left stay without a result.
    """
    total = L[tb.WORK_LEFT]
    for b in range(count):
        length = L[pg.LENGTH]
        for k in range(length):
            P[k] = designs[b * length + k]
        L[tb.CLAMPED] = 0
        if interrupted(L):
            return
        for k in range(width):
            out[b * width + k] = 0.0
        allowed = min(MAX_WORK, total)
        if allowed <= 0:
            continue
        L[tb.WORK_LEFT] = L[tb.NEXT_CHECK] = allowed
        W[sc.EVALUATIONS], W[sc.PERIOD] = 0.0, P[L[pg.PERIOD]]
        for attempt in range(2):
            mirrored = symmetric and attempt == 0
            W[sc.SPAN] = 0.5 * W[sc.PERIOD] if mirrored else W[sc.PERIOD]
            reset(P, L, S, D)
            reset(P, L, s, d)
            status = sh.find(P, L, S, D, W, V, s, d, mirrored)
            if status == DONE and sh.converged(W[sc.RESIDUAL], W[sc.RADIUS]):
                _record(P, L, r, e, W, V, out, b * width, mirrored)
                break
            if not mirrored:
                break
        out[b * width + EVALUATED] = W[sc.EVALUATIONS]
        if interrupted(L):
            return
        total -= allowed - L[tb.WORK_LEFT]
    L[tb.WORK_LEFT] = total
