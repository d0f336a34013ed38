"""Tables of a linear mode: where its matrix exponentials, its guards and its energies stand.

A mode is a configuration of the shunt with the set of stop operators that slip. exp(A h) - 1, not exp(A h), is kept
and doubled: slow motions beside fast ones then lose no digits, however many times the step is doubled.

The tables of a mode are a block of P (numbers) and a block of L (integers). Matrices that act on the state stand column
by column, as `vector` wants them; forms that are only read here stand row by row.
"""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory.vector import LANES, padded, whole_lines

MODES = 64  # kept at once, as far as memory allows; met again after that, they are built anew
MOST_NUMBERS = 2**27  # of all modes together: 1 GiB
LEVELS = 56
BITS = 4  # of a digit of a number of finest steps
LARGEST = 2**BITS - 1
ORDER = 10  # Taylor terms: on the finest level the rest is below 1e-20
TERMS = 8  # of those, what a motion within a finest step needs: the rest is below 1e-16 at its end, 1e-19 half way
TAYLOR_ROWS = padded(TERMS + 1)
MOST_MAPPED = 4096  # keys of modes that are looked up directly
OUTPUT_ROWS = padded(len(pg.OUTPUTS))

# Table of contents, L, behind the program's: sizes of the blocks,
(
    TABLES, BLOCK, SLOTS, SLOT, HELD, ROOM, MAP, MAPPED, FORMS, GUARD_ROWS, LEDGER, SCRATCH,
    # places within a mode's block of numbers,
    STEPS, MATRIX, POWERS, GUARDS, LINES, VALUES, TAYLOR, DEVIATION, GLIDE, SIZES, OUTPUTS, PRODUCTS, GROWTH,
    GRAMIAN, DIGITS, GLIDE_ROWS, SETTLED,
    # the work that is left, and at what is left one looks whether to go on (see `budget`).
    LEFT, LOOK,
) = range(pg.CONTENTS, pg.CONTENTS + pg.ROOM)  # fmt: skip
# and within its block of integers: key, finest level, whether its energies are there, padded number of the guards' rows
# but for those that are only watched, where the form stands that conducting diodes hold at zero (-1: none), number of
# guards, then for every guard what it is and its row.
KEY, FINEST_LEVEL, ACCOUNTED, EVENT_ROWS, HELD_FORM, GUARD_COUNT, FIRST_GUARD = range(7)


def contents(integers: np.ndarray, ledger: bool) -> tuple[np.ndarray, int]:
    """Complete the table of contents by the tables; returns it with the numbers that P has to hold."""
    head = integers.copy()
    c, g, h = head[pg.C], head[pg.G], head[pg.H]
    rows, columns = head[pg.ROWS], head[pg.COLUMNS]
    square = columns * rows
    # Distinct rows of guards; those that are only watched begin a register of their own.
    forms = padded(int(g + 1 + h)) + padded(pg.WATCHED)
    sampled = head[pg.SIGNAL_KIND] == pg.RAMPS
    glide_rows = 2 * rows + 2 * forms + OUTPUT_ROWS
    products, energies = head[pg.PRODUCTS] + h, head[pg.CATEGORY_COUNT] if ledger else 0
    sizes = {
        STEPS: LEVELS, MATRIX: square, POWERS: TERMS * square, GUARDS: 3 * forms * columns, LINES: 2 * forms * rows,
        VALUES: forms * columns, TAYLOR: forms * TAYLOR_ROWS * columns,
        DEVIATION: forms * columns if sampled else 0,
        GLIDE: glide_rows * columns if sampled else 0,
        SETTLED: 3 * forms * columns, SIZES: 3 * forms, OUTPUTS: OUTPUT_ROWS * columns,
        PRODUCTS: products * 2 * rows, GROWTH: LEVELS * square, GRAMIAN: LEVELS * energies * square,
        DIGITS: -(-LEVELS // BITS) * LARGEST * square if sampled else 0,
    }  # fmt: skip
    offset = 0
    for place, size in sizes.items():
        head[place] = offset
        offset += whole_lines(int(size))
    modes = int(min(MODES, c * 2 ** min(h, 10), max(MOST_NUMBERS // offset, 1)))
    scratch = int((ORDER + 4) * square + (LEVELS if sampled else 3) * forms * columns)
    slot = FIRST_GUARD + 2 * int(g + 1 + 2 * h + pg.WATCHED)
    head[[BLOCK, SLOT, ROOM, FORMS, LEDGER]] = offset, slot, modes, forms, energies
    head[GUARD_ROWS], head[GLIDE_ROWS] = 3 * forms, glide_rows
    head[SCRATCH] = whole_lines(head[pg.LENGTH])
    head[TABLES] = head[SCRATCH] + whole_lines(scratch)
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


@inlined
def place_of(row):
    """Where a guard's value stands among those that are read; LANES behind it its rate, then its second rate."""
    return row + row // LANES * 2 * LANES


@inlined
def rows_read(L, tracked, slot):
    """How many rows of guards are looked at: those that are only watched stand behind the others."""
    return L[FORMS] if tracked else L[slot_of(L, slot) + EVENT_ROWS]


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
