"""Linear forms of a mode over its whole state: guards, outputs and the factors of powers."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory.tables import (
    DELAYED,
    EVENT_ROWS,
    FINEST_LEVEL,
    FIRST_GUARD,
    FORMS,
    GROWTH,
    GUARD_COUNT,
    GUARDS,
    LINES,
    MATRIX,
    OUTPUT_ROWS,
    OUTPUTS,
    PRODUCTS,
    SCRATCH,
    SIZES,
    VALUES,
    block_of,
    place_of,
    slot_of,
)
from piezoharvest.engine.memory.vector import LANES, copy

# A motion as fast as the norm of the mode's matrix has decayed after 2^10 finest steps, each 1/16 of its time constant;
# in a step 2^6 times as long this delay is negligible.
DECAY_LEVEL, STIFF_LEVELS = 10, 16


@compiled
def forms_of_mode(P, L, D, slot, configuration, slip):
    """Forms of guards, outputs and products over the augmented state.

    Order of the guards: the circuit's, the extremum, two for each stop (its upper and its lower limit; a slipping one
    has the first only), and last the watched outputs, which are no events.
    """
    n, a, h, own = L[pg.N], L[pg.A], L[pg.H], L[pg.G]
    at, matrix, line = slot_of(L, slot), block_of(L, slot) + L[MATRIX], L[SCRATCH]
    L[at + GUARD_COUNT] = 0
    row = 0
    for g in range(own):
        if L[L[pg.GUARD_TARGET] + configuration * own + g] >= 0:
            k = configuration * own + g
            _over_state(P, L, line, L[pg.GUARD_Z] + k * a, L[pg.GUARD_D] + k * n, matrix)
            _guard(P, L, slot, line, row)
            _append_guard(L, slot, g, row)
            row += 1
    if L[pg.SWITCHED] and L[pg.SWITCHED] != pg.CLOCKED:
        for k in range(a):
            P[line + k] = P[L[pg.TRIGGER_ROW] + k]
        _guard(P, L, slot, line, row)
        _append_guard(L, slot, own, row)
        row += 1
    for j in range(h):
        if D[slip + j] == 0:
            for k in range(a):
                P[line + k] = 0.0
            P[line + L[L[pg.STOP_STATE] + j]] = 1.0
            _guard(P, L, slot, line, row)
            _append_guard(L, slot, own + 1 + 2 * j, row)
            _append_guard(L, slot, own + 2 + 2 * j, row)
        else:
            _over_state(P, L, line, -1, L[pg.STOP_INPUT] + j * n, matrix)
            _guard(P, L, slot, line, row)
            _append_guard(L, slot, own + 1 + 2 * j, row)
        row += 1
    L[at + EVENT_ROWS] = -(-row // LANES) * LANES
    _clear(P, L, slot, row)
    _outputs(P, L, slot, configuration, matrix, line, L[at + EVENT_ROWS])
    _products(P, L, D, slot, configuration, slip, matrix)


@compiled
def _over_state(P, L, out, form_z, form_d, matrix):
    """Out = form_z + form_d z': a linear form over the augmented state alone, the matrix by columns."""
    n, a, rows = L[pg.N], L[pg.A], L[pg.ROWS]
    for k in range(a):
        total = P[form_z + k] if form_z >= 0 else 0.0
        for i in range(n):
            total += P[form_d + i] * P[matrix + k * rows + i]
        P[out + k] = total


@compiled
def rate_of(P, L, form, out, matrix):
    """Out = form matrix: the rate of a linear form."""
    a, rows = L[pg.A], L[pg.ROWS]
    for k in range(a):
        total = 0.0
        for i in range(a):
            total += P[form + i] * P[matrix + k * rows + i]
        P[out + k] = total


@compiled
def delayed_forms(P, L, slot):
    """Tabulate guards whose rates are taken after a delay in which the fastest motion of a stiff mode has decayed.

    With a time constant of 1e-9 of the period, the rate of a current computed from the state is rounding: it is a small
    difference of large numbers, divided by that time. In the form c (1 + G) A (1 + G), where 1 + G propagates over the
    delay, the large numbers have decayed before they are divided. These rates are used for steps much longer than the
    delay.
    """
    a, forms, block = L[pg.A], L[FORMS], block_of(L, slot)
    finest, size = L[slot_of(L, slot) + FINEST_LEVEL], 3 * L[FORMS] * L[pg.COLUMNS]
    copy(P, block + L[GUARDS], block + L[DELAYED], size)
    if finest < STIFF_LEVELS:
        return
    growth = block + L[GROWTH] + (finest - DECAY_LEVEL) * L[pg.ROWS] * L[pg.COLUMNS]
    form, out = L[SCRATCH], L[SCRATCH] + a
    for row in range(forms):
        for k in range(a):
            P[form + k] = P[block + L[VALUES] + k * forms + row]
        _delayed_form(P, L, form, out, growth)
        for kind in range(1, 3):
            rate_of(P, L, form, out, block + L[MATRIX])
            for k in range(a):
                P[form + k] = P[out + k]
            _delayed_form(P, L, form, out, growth)
            for k in range(a):
                P[block + L[DELAYED] + k * 3 * forms + place_of(row) + kind * LANES] = P[form + k]


@compiled
def _delayed_form(P, L, form, scratch, growth):
    """Turn a form of the state into a form of the state a delay earlier: form (1 + G)."""
    rate_of(P, L, form, scratch, growth)
    for k in range(L[pg.A]):
        P[form + k] += P[scratch + k]


@compiled
def _append_guard(L, slot, what, row):
    """Append a guard to the list of a mode."""
    at = slot_of(L, slot)
    count = L[at + GUARD_COUNT]
    L[at + FIRST_GUARD + 2 * count] = what
    L[at + FIRST_GUARD + 2 * count + 1] = row
    L[at + GUARD_COUNT] = count + 1


@compiled
def _guard(P, L, slot, line, row):
    """Tabulate a guard's form with its rate and second rate, and store the largest coefficient of each."""
    a, forms, block = L[pg.A], L[FORMS], block_of(L, slot)
    for kind in range(3):
        size = 0.0
        here, there = line + kind * a, line + (kind + 1) * a
        for k in range(a):
            P[block + L[GUARDS] + k * 3 * forms + place_of(row) + kind * LANES] = P[here + k]
            size = max(size, abs(P[here + k]))
            if kind == 0:
                P[block + L[VALUES] + k * forms + row] = P[here + k]
            if kind < 2:
                P[block + L[LINES] + (2 * row + kind) * L[pg.ROWS] + k] = P[here + k]
        P[block + L[SIZES] + place_of(row) + kind * LANES] = size
        for k in range(a, L[pg.ROWS]):
            if kind < 2:
                P[block + L[LINES] + (2 * row + kind) * L[pg.ROWS] + k] = 0.0
        if kind < 2:
            rate_of(P, L, here, there, block + L[MATRIX])


@compiled
def _outputs(P, L, slot, configuration, matrix, line, row):
    """Tabulate the outputs, and from `row` on the rates of the watched ones."""
    n, a, block, count = L[pg.N], L[pg.A], block_of(L, slot), len(pg.OUTPUTS)
    for o in range(count):
        k = configuration * count + o
        _over_state(P, L, line, L[pg.OUTPUT_Z] + k * a, L[pg.OUTPUT_D] + k * n, matrix)
        for j in range(a):
            P[block + L[OUTPUTS] + j * OUTPUT_ROWS + o] = P[line + j]
        if o == pg.DISPLACEMENT or o == pg.VOLTAGE:
            rate_of(P, L, line, line + 3 * a, matrix)
            for j in range(a):
                P[line + j] = P[line + 3 * a + j]
            _guard(P, L, slot, line, row)
            _append_guard(L, slot, -1, row)
            row += 1
    # The padding columns that make their number even.
    for j in range(a, L[pg.COLUMNS]):
        for r in range(3 * L[FORMS]):
            P[block + L[GUARDS] + j * 3 * L[FORMS] + r] = 0.0
        for r in range(L[FORMS]):
            P[block + L[VALUES] + j * L[FORMS] + r] = 0.0
        for r in range(OUTPUT_ROWS):
            P[block + L[OUTPUTS] + j * OUTPUT_ROWS + r] = 0.0


@compiled
def _clear(P, L, slot, row):
    """Set forms from a row on to zero: unused ones, and those of watched outputs, which are filled later."""
    block, forms = block_of(L, slot), L[FORMS]
    for r in range(row, forms):
        for j in range(L[pg.A]):
            for kind in range(3):
                P[block + L[GUARDS] + j * 3 * forms + place_of(r) + kind * LANES] = 0.0
            P[block + L[VALUES] + j * forms + r] = 0.0


@compiled
def _products(P, L, D, slot, configuration, slip, matrix):
    """Factors of the powers over the state; a slipping stop dissipates its output times the rate of its input."""
    n, a, count, rows = L[pg.N], L[pg.A], L[pg.PRODUCTS], L[pg.ROWS]
    out = block_of(L, slot) + L[PRODUCTS]
    for k in range(2 * (count + L[pg.H]) * rows):
        P[out + k] = 0.0
    for k in range(2 * count):
        form = configuration * 2 * count + k
        _over_state(P, L, out + k * rows, L[pg.PRODUCT_Z] + form * a, L[pg.PRODUCT_D] + form * n, matrix)
    for j in range(L[pg.H]):
        here = out + 2 * (count + j) * rows
        if D[slip + j] != 0:
            P[here + L[L[pg.STOP_STATE] + j]] = P[L[pg.STOP_WEIGHT] + j]
            _over_state(P, L, here + rows, -1, L[pg.STOP_INPUT] + j * n, matrix)
