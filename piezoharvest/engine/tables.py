"""Tables of a linear mode: its matrix exponential on dyadic steps, its guards and its energies, built when first met.

A mode is a configuration of the shunt with the set of stop operators that slip. exp(A h) - 1, not exp(A h), is kept
and doubled: slow motions beside fast ones then lose no digits, however many times the step is doubled.

The tables of a mode are a block of P (numbers) and a block of L (integers). Matrices that act on the state stand column
by column, as `vector` wants them; forms that are only read here stand row by row.
"""

from __future__ import annotations

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine.compiled import compiled, inlined
from piezoharvest.engine.vector import LANES, grow, multiply, padded

MODES = 64  # kept at once; met again after that, they are built anew
# |A| h on the finest level: a Taylor series over half of that is short.
FINEST = 1.0 / 16.0
BOLD = 5  # levels above the finest on which a motion begins: |A| h is 2, and every motion of the mode is followed
ORDER = 10  # Taylor terms: on the finest level the rest is below 1e-20
LEVELS = 56
MOST_MAPPED = 4096  # keys of modes that are looked up directly
OUTPUT_ROWS = padded(len(pg.OUTPUTS))
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS

# Table of contents, L, behind the program's: sizes of the blocks,
(
    TABLES, BLOCK, SLOTS, SLOT, HELD, ROOM, MAP, MAPPED, FORMS, GUARD_ROWS, LEDGER, SCRATCH,
    # places within a mode's block of numbers,
    STEPS, MATRIX, GUARDS, LINES, VALUES, DEVIATION, LADDERS, SIZES, OUTPUTS, PRODUCTS, GROWTH, GRAMIAN,
) = range(pg.CONTENTS, pg.CONTENTS + 24)  # fmt: skip
# and within its block of integers: key, finest level, number of guards, then for every guard what it is and its row.
KEY, FINEST_LEVEL, GUARD_COUNT, FIRST_GUARD = range(4)


def contents(integers: np.ndarray, ledger: bool) -> tuple[np.ndarray, int]:
    """Complete the table of contents by the tables; returns it with the numbers that P has to hold."""
    head = integers.copy()
    c, g, h = head[pg.C], head[pg.G], head[pg.H]
    rows, columns, a = head[pg.ROWS], head[pg.COLUMNS], head[pg.A]
    square = columns * rows
    forms = padded(int(g + 1 + h + pg.WATCHED))  # distinct rows of guards
    sampled = head[pg.SIGNAL_KIND] == pg.RAMPS
    products, energies = head[pg.PRODUCTS] + h, head[pg.CATEGORY_COUNT] if ledger else 0
    sizes = {
        STEPS: LEVELS, MATRIX: square, GUARDS: 3 * forms * columns, LINES: 2 * forms * rows, VALUES: forms * columns,
        DEVIATION: forms * columns if sampled else 0,
        LADDERS: forms * padded(LEVELS) * columns if sampled else 0, SIZES: 3 * forms, OUTPUTS: OUTPUT_ROWS * columns,
        PRODUCTS: products * 2 * a, GROWTH: LEVELS * square, GRAMIAN: LEVELS * energies * square,
    }  # fmt: skip
    offset = 0
    for place, size in sizes.items():
        head[place] = offset
        offset += int(size)
    modes = int(min(MODES, c * 2 ** min(h, 10)))
    scratch = int((ORDER + 4) * square + 3 * forms * columns)
    slot = FIRST_GUARD + 2 * int(g + 1 + 2 * h + pg.WATCHED)
    head[[BLOCK, SLOT, ROOM, FORMS, LEDGER]] = offset, slot, modes, forms, energies
    head[GUARD_ROWS] = 3 * forms
    head[SCRATCH] = head[pg.LENGTH]
    head[TABLES] = head[SCRATCH] + scratch
    head[SLOTS] = len(head)
    head[HELD] = 0
    head[MAP], head[MAPPED] = len(head) + modes * slot, min(c * 2**h, MOST_MAPPED)
    lists = np.full(modes * slot, -1), np.zeros(head[MAPPED], np.int64)
    return np.concatenate([head, *lists]), int(head[TABLES] + modes * offset)


@inlined
def block_of(L, slot):
    """Where the numbers of a mode begin in P."""
    return L[TABLES] + slot * L[BLOCK]


@inlined
def slot_of(L, slot):
    """Where the integers of a mode begin in L."""
    return L[SLOTS] + slot * L[SLOT]


@compiled
def seek(L, D, configuration, slip):
    """Index of a mode in the tables, or -1; the stops' states stand from `slip` in D."""
    key = mode_key(L, D, configuration, slip)
    slot = L[L[MAP] + (key if key < L[MAPPED] else key % L[MAPPED])]
    return slot if slot < L[HELD] and L[slot_of(L, slot) + KEY] == key else -1


@compiled
def mode_key(L, D, configuration, slip):
    """One number for a mode."""
    key = configuration
    for j in range(L[pg.H]):
        key = 2 * key + (1 if D[slip + j] != 0 else 0)
    return key


@compiled
def build(P, L, D, configuration, slip):
    """Tables of a mode that is not there yet; all are dropped where there is no room left."""
    if L[HELD] == L[ROOM]:
        L[HELD] = 0
    slot = L[HELD]
    L[HELD] += 1
    key = mode_key(L, D, configuration, slip)
    L[slot_of(L, slot) + KEY] = key
    L[L[MAP] + key % L[MAPPED]] = slot
    _motion(P, L, D, slot, configuration, slip)
    _forms(P, L, D, slot, configuration, slip)
    # A switch that stays closed for a given time is stepped through in halves of that time.
    longest = P[L[pg.STEP]]
    if L[pg.SWITCHED] == 1 and L[L[pg.OPENED] + configuration] != configuration:
        longest = min(longest, P[L[pg.ON_TIME]])
    _exponentials(P, L, slot, longest)
    if L[LEDGER]:
        _energies(P, L, slot, configuration)  # goes on from the Taylor terms that the exponentials leave behind
    if L[pg.SIGNAL_KIND] == pg.RAMPS:
        _deviations(P, L, slot)


@inlined
def _add_row(P, row, step, out, factor, a):
    """Add a multiple of a strided row to another of stride 1."""
    for k in range(a):
        P[out + k] += factor * P[row + step * k]


@compiled
def _motion(P, L, D, slot, configuration, slip):
    """Z' = matrix z, the sticking stops tied to their inputs one after the other (Sherman-Morrison).

    The matrix is made row by row in scratch, and laid out by columns at the end.
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
def _rate_of(P, L, form, out, matrix):
    """Out = form matrix: the rate of a linear form."""
    a, rows = L[pg.A], L[pg.ROWS]
    for k in range(a):
        total = 0.0
        for i in range(a):
            total += P[form + i] * P[matrix + k * rows + i]
        P[out + k] = total


@compiled
def _enlist(L, slot, what, row):
    """Add a guard to the list of a mode."""
    at = slot_of(L, slot)
    count = L[at + GUARD_COUNT]
    L[at + FIRST_GUARD + 2 * count] = what
    L[at + FIRST_GUARD + 2 * count + 1] = row
    L[at + GUARD_COUNT] = count + 1


@compiled
def _forms(P, L, D, slot, configuration, slip):
    """Guards, outputs and products over the whole state.

    Guards are numbered: the circuit's, the extremum, two for each stop (its upper and its lower limit; a slipping one
    has the first alone), and behind them the watched outputs, which are no events.
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
            _enlist(L, slot, g, row)
            row += 1
    if L[pg.SWITCHED]:
        for k in range(a):
            P[line + k] = P[L[pg.TRIGGER_ROW] + k]
        _guard(P, L, slot, line, row)
        _enlist(L, slot, own, row)
        row += 1
    for j in range(h):
        if D[slip + j] == 0:
            for k in range(a):
                P[line + k] = 0.0
            P[line + L[L[pg.STOP_STATE] + j]] = 1.0
            _guard(P, L, slot, line, row)
            _enlist(L, slot, own + 1 + 2 * j, row)
            _enlist(L, slot, own + 2 + 2 * j, row)
        else:
            _over_state(P, L, line, -1, L[pg.STOP_INPUT] + j * n, matrix)
            _guard(P, L, slot, line, row)
            _enlist(L, slot, own + 1 + 2 * j, row)
        row += 1
    _outputs(P, L, slot, configuration, matrix, line, row)
    _products(P, L, D, slot, configuration, slip, matrix)


@compiled
def _guard(P, L, slot, line, row):
    """Lay out a guard's form with its rate and second rate, and note the largest coefficient of each."""
    a, forms, block = L[pg.A], L[FORMS], block_of(L, slot)
    for kind in range(3):
        size = 0.0
        here, there = line + kind * a, line + (kind + 1) * a
        for k in range(a):
            P[block + L[GUARDS] + k * 3 * forms + kind * forms + row] = P[here + k]
            size = max(size, abs(P[here + k]))
            if kind == 0:
                P[block + L[VALUES] + k * forms + row] = P[here + k]
            if kind < 2:
                P[block + L[LINES] + (2 * row + kind) * L[pg.ROWS] + k] = P[here + k]
        P[block + L[SIZES] + 3 * row + kind] = size
        for k in range(a, L[pg.ROWS]):
            if kind < 2:
                P[block + L[LINES] + (2 * row + kind) * L[pg.ROWS] + k] = 0.0
        if kind < 2:
            _rate_of(P, L, here, there, block + L[MATRIX])


@compiled
def _outputs(P, L, slot, configuration, matrix, line, row):
    n, a, block, count = L[pg.N], L[pg.A], block_of(L, slot), len(pg.OUTPUTS)
    for o in range(count):
        k = configuration * count + o
        _over_state(P, L, line, L[pg.OUTPUT_Z] + k * a, L[pg.OUTPUT_D] + k * n, matrix)
        for j in range(a):
            P[block + L[OUTPUTS] + j * OUTPUT_ROWS + o] = P[line + j]
        if o == pg.DISPLACEMENT or o == pg.VOLTAGE:
            _rate_of(P, L, line, line + 3 * a, matrix)
            for j in range(a):
                P[line + j] = P[line + 3 * a + j]
            _guard(P, L, slot, line, row)
            _enlist(L, slot, -1, row)
            row += 1
    # Rows that the mode does not use, and the column that makes their number even.
    for r in range(row, L[FORMS]):
        for j in range(a):
            for kind in range(3):
                P[block + L[GUARDS] + j * 3 * L[FORMS] + kind * L[FORMS] + r] = 0.0
            P[block + L[VALUES] + j * L[FORMS] + r] = 0.0
    for j in range(a, L[pg.COLUMNS]):
        for r in range(3 * L[FORMS]):
            P[block + L[GUARDS] + j * 3 * L[FORMS] + r] = 0.0
        for r in range(L[FORMS]):
            P[block + L[VALUES] + j * L[FORMS] + r] = 0.0
        for r in range(OUTPUT_ROWS):
            P[block + L[OUTPUTS] + j * OUTPUT_ROWS + r] = 0.0


@compiled
def _products(P, L, D, slot, configuration, slip, matrix):
    """Factors of the powers over the state; a slipping stop dissipates its output times the rate of its input."""
    n, a, count = L[pg.N], L[pg.A], L[pg.PRODUCTS]
    out = block_of(L, slot) + L[PRODUCTS]
    for k in range(2 * count):
        form = configuration * 2 * count + k
        _over_state(P, L, out + k * a, L[pg.PRODUCT_Z] + form * a, L[pg.PRODUCT_D] + form * n, matrix)
    for j in range(L[pg.H]):
        here = out + 2 * (count + j) * a
        for k in range(2 * a):
            P[here + k] = 0.0
        if D[slip + j] != 0:
            P[here + L[L[pg.STOP_STATE] + j]] = P[L[pg.STOP_WEIGHT] + j]
            _over_state(P, L, here + a, -1, L[pg.STOP_INPUT] + j * n, matrix)


@compiled
def _exponentials(P, L, slot, longest):
    """exp(A h) - 1 on the finest level by its Taylor series, then doubled up to the longest step."""
    a, rows, columns, block = L[pg.A], L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    matrix, square, powers = block + L[MATRIX], rows * columns, L[SCRATCH]
    norm = 0.0
    for i in range(a):
        total = 0.0
        for j in range(a):
            total += abs(P[matrix + j * rows + i])
        norm = max(norm, total)
    finest, h = 0, longest
    P[block + L[STEPS]] = h
    while norm * h > FINEST and finest < LEVELS - 1:
        finest += 1
        h *= 0.5
        P[block + L[STEPS] + finest] = h
    L[slot_of(L, slot) + FINEST_LEVEL] = finest
    growth = block + L[GROWTH] + finest * square
    for k in range(square):
        P[powers + k] = 0.0
    for j in range(a):
        P[powers + j * rows + j] = 1.0
    for k in range(1, ORDER + 1):
        before, here = powers + (k - 1) * square, powers + k * square
        for j in range(a):
            multiply(P, matrix, rows, columns, P, before + j * rows, here + j * rows)
        for j in range(a * rows):
            P[here + j] *= h / k
        for j in range(a * rows, square):
            P[here + j] = 0.0
    for j in range(square):
        total = 0.0
        for k in range(ORDER, 0, -1):
            total += P[powers + k * square + j]
        P[growth + j] = total
    for _ in range(finest):
        coarser = growth - square
        for j in range(a):
            # (1 + G)^2 - 1 = G + (1 + G) G
            grow(P, growth, rows, columns, P, growth + j * rows, coarser + j * rows)
        for j in range(square):
            P[coarser + j] = P[coarser + j] + P[growth + j] if j < a * rows else 0.0
        growth = coarser


@compiled
def _deviations(P, L, slot):
    """How far within a longest step a guard may be from the straight line between its ends.

    As forms of the state at the ends of all dyadic steps, a ladder for each guard, and as bounds for a unit of each
    state: twice what the ladder shows, for a transient may be higher between two of its rungs.
    """
    a, forms, rows, columns = L[pg.A], L[FORMS], L[pg.ROWS], L[pg.COLUMNS]
    block, square, finest = block_of(L, slot), rows * columns, L[slot_of(L, slot) + FINEST_LEVEL]
    values, deviation, growth = block + L[VALUES], block + L[DEVIATION], block + L[GROWTH]
    scratch, rungs = L[SCRATCH], rungs_of(finest)
    for k in range(forms * columns):
        P[deviation + k] = 0.0
    for k in range(forms * rungs * columns):
        P[block + L[LADDERS] + k] = 0.0
    for level in range(1, finest + 1):
        share = P[block + L[STEPS] + level] / P[block + L[STEPS]]
        for j in range(a):
            for k in range(rows):
                P[scratch + k] = P[growth + level * square + j * rows + k] - share * P[growth + j * rows + k]
            multiply(P, values, forms, columns, P, scratch, scratch + rows)
            for r in range(forms):
                off = P[scratch + rows + r]
                P[block + L[LADDERS] + (r * columns + j) * rungs + level - 1] = off
                P[deviation + j * forms + r] = max(P[deviation + j * forms + r], 2.0 * abs(off))


@inlined
def rungs_of(finest):
    """Padded number of rungs of a ladder."""
    return (finest + LANES - 1) // LANES * LANES


@compiled
def _energies(P, L, slot, configuration):
    """Energies of a step as quadratic forms of the state at its beginning, on every level.

    On the finest level by Gauss-Legendre quadrature of polynomials, exact to rounding; then doubled:
    the form of a double step is Q + (1 + G)' Q (1 + G).
    """
    a, rows, columns, block = L[pg.A], L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    finest, square, powers = L[slot_of(L, slot) + FINEST_LEVEL], rows * columns, L[SCRATCH]
    energies, own = L[LEDGER], L[pg.PRODUCTS]
    gramian = block + L[GRAMIAN] + finest * energies * square
    exponential = powers + (ORDER + 1) * square
    first = exponential + square
    second = first + rows
    for k in range(energies * square):
        P[gramian + k] = 0.0
    for q in range(len(NODES)):
        for k in range(square):
            total = 0.0
            for order in range(ORDER, -1, -1):
                total = total * NODES[q] + P[powers + order * square + k]
            P[exponential + k] = total
        for p in range(own + L[pg.H]):
            category, weight = pg.HYSTERESIS, WEIGHTS[q] * P[block + L[STEPS] + finest]
            if p < own:
                category = L[L[pg.PRODUCT_CATEGORY] + configuration * own + p]
                weight *= P[L[pg.PRODUCT_COEFFICIENT] + configuration * own + p]
            if category < 0 or weight == 0.0:
                continue
            _rate_of(P, L, block + L[PRODUCTS] + 2 * p * a, first, exponential)
            _rate_of(P, L, block + L[PRODUCTS] + (2 * p + 1) * a, second, exponential)
            form = gramian + category * square
            for j in range(a):
                factor = weight * P[second + j]
                for i in range(a):
                    P[form + j * rows + i] += factor * P[first + i]
    for level in range(finest, 0, -1):
        gramian = block + L[GRAMIAN] + level * energies * square
        coarser = gramian - energies * square
        growth = block + L[GROWTH] + level * square
        for e in range(energies):
            _double_form(P, L, gramian + e * square, coarser + e * square, growth, exponential)


@compiled
def _double_form(P, L, form, double, growth, scratch):
    """Double = Q + (1 + G)' Q (1 + G) for a symmetrised form Q."""
    a, rows, columns = L[pg.A], L[pg.ROWS], L[pg.COLUMNS]
    for k in range(rows * columns):
        P[double + k] = P[form + k]
    empty = True
    for k in range(rows * columns):
        empty &= P[form + k] == 0.0
    if empty:
        return
    for j in range(a):
        # Q (1 + G), a column at a time
        multiply(P, form, rows, columns, P, growth + j * rows, scratch)
        for i in range(rows):
            P[scratch + i] += P[form + j * rows + i]
        for i in range(a):
            total = P[scratch + i]
            for k in range(a):
                total += P[growth + i * rows + k] * P[scratch + k]
            P[double + j * rows + i] += total
