"""Construction of the tables of a mode when it is first used."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory.tables import (
    ACCOUNTED,
    CLAMPED,
    CONSTANT_SHARE,
    KEY,
    LEVELS,
    MAP,
    MAPPED,
    MATRIX,
    ROOM,
    SCRATCH,
    STAGED,
    block_of,
    mode_key,
    slot_of,
)
from piezoharvest.engine.motion.exponentials import digits, exponentials, free_step_matrix, line_deviations
from piezoharvest.engine.motion.mode_forms import delayed_forms, forms_of_mode
from piezoharvest.engine.motion.term_sizes import bound_by_clamp, constant_share
from piezoharvest.engine.work_limit import spend_products


@compiled
def build(P, L, D, configuration, slip):
    """Build the tables of a new mode; if there is no room left, all others are dropped."""
    if L[CLAMPED] == L[ROOM]:
        L[CLAMPED] = 0
    slot = L[CLAMPED]
    L[CLAMPED] += 1
    spend_products(L, LEVELS * L[pg.A])
    key = mode_key(L, D, configuration, slip)
    L[slot_of(L, slot) + KEY], L[slot_of(L, slot) + ACCOUNTED] = key, 0
    L[L[MAP] + key % L[MAPPED]] = slot
    _motion(P, L, D, slot, configuration, slip)
    forms_of_mode(P, L, D, slot, configuration, slip)
    # A switch that stays closed, or a clock that runs, for a given time is stepped through in halves of that time.
    longest, timed = P[L[pg.STEP]], L[L[pg.OPENED] + configuration] != configuration
    if L[pg.SWITCHED] in (1, pg.CLOCKED) and timed:
        longest = min(longest, P[L[pg.ON_TIME]] * P[L[pg.STAGE] + configuration])
    exponentials(P, L, slot, configuration, longest)
    P[block_of(L, slot) + L[CONSTANT_SHARE]] = constant_share(P, L, slot)
    bound_by_clamp(P, L, slot)
    delayed_forms(P, L, slot)
    if L[pg.SIGNAL_KIND] == pg.RAMPS:
        digits(P, L, slot)
    staged = L[STAGED] and timed
    if L[pg.SIGNAL_KIND] == pg.RAMPS or staged:
        line_deviations(P, L, slot, staged)
        free_step_matrix(P, L, slot, staged)


@compiled
def _motion(P, L, D, slot, configuration, slip):
    """Matrix of z' = matrix z, with the sticking stops tied to their inputs one after the other (Sherman-Morrison).

    The matrix is built row by row in scratch, and stored by columns at the end.
    """
    n, a, h, rows = L[pg.N], L[pg.A], L[pg.H], L[pg.ROWS]
    work = L[SCRATCH]
    response = work + a * a
    row = response + n * h
    rate = L[pg.RATE] + configuration * n * a
    for k in range(n * a):
        P[work + k] = P[rate + k]
    for k in range(n * a, a * a):
        P[work + k] = 0.0
    for i in range(a - n):
        for j in range(a - n):
            P[work + (n + i) * a + n + j] = P[L[pg.EXOSYSTEM] + i * (a - n) + j]
    for k in range(n * h):
        P[response + k] = P[L[pg.STOP_RESPONSE] + configuration * n * h + k]
    for j in range(h):
        if D[slip + j] != 0:
            continue
        into = L[pg.STOP_INPUT] + j * n
        gain = 1.0
        for k in range(a):
            P[row + k] = 0.0
        for i in range(n):
            if P[into + i] != 0.0:
                gain -= P[into + i] * P[response + i * h + j]
                _add_row(P, work + i * a, 1, row, P[into + i], a)
        for i in range(n):
            _add_row(P, row, 1, work + i * a, P[response + i * h + j] / gain, a)
        for other in range(j + 1, h):
            shared = 0.0
            for i in range(n):
                shared += P[into + i] * P[response + i * h + other]
            for i in range(n):
                P[response + i * h + other] += P[response + i * h + j] * shared / gain
    matrix = block_of(L, slot) + L[MATRIX]
    for k in range(L[pg.COLUMNS] * rows):
        P[matrix + k] = 0.0
    for i in range(a):
        for j in range(a):
            P[matrix + j * rows + i] = P[work + i * a + j]


@inlined
def _add_row(P, row, step, out, factor, a):
    """Add a multiple of a strided row to another of stride 1."""
    for k in range(a):
        P[out + k] += factor * P[row + step * k]
