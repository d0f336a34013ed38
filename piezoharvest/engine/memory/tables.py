"""Tables of a linear mode: places of its matrix exponentials, its guards and its energies.

A mode is a configuration of the shunt with the set of stop operators that slip. exp(A h) - 1, not exp(A h), is stored
and doubled: slow motions beside fast ones then lose no digits, for any number of doublings.

The tables of a mode are a block of P (numbers) and a block of L (integers). Matrices that act on the state stand column
by column, as `vector` requires; forms that are used here only stand row by row.
"""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory.vector import LANES, padded, whole_lines

# Kept at the same time, as far as memory allows; later ones replace all, which are rebuilt when needed. A supply with
# phases goes through a hundred in turn.
MODES = 256
MAX_NUMBERS = 2**27  # of all modes together: 1 GiB
LEVELS = 56
DIGIT_BITS = 4  # of a digit in which numbers of finest steps are written
LARGEST = 2**DIGIT_BITS - 1
ORDER = 10  # Taylor terms: on the finest level the rest is below 1e-20
TERMS = 8  # of those, used for a motion within a finest step: the rest is below 1e-16 at its end, 1e-19 half way
TAYLOR_ROWS = padded(TERMS + 1)
MAX_MAPPED = 4096  # keys of modes that are looked up directly
OUTPUT_ROWS = padded(len(pg.OUTPUTS))
NODE_COUNT = 8  # of a Gauss-Legendre quadrature of energies
MAX_NODE_SETS = 16  # levels of a mode whose factors of powers are tabulated at these nodes

# Table of contents, L, behind the program's: sizes of the blocks,
(
    TABLES, BLOCK, SLOTS, SLOT, CLAMPED, ROOM, MAP, MAPPED, FORMS, GUARD_ROWS, LEDGER, SCRATCH,
    # places within a mode's block of numbers,
    STEPS, MATRIX, POWERS, GUARDS, LINES, VALUES, TAYLOR, DEVIATION, FREE_STEP, SIZES, OUTPUTS, PRODUCTS, GROWTH,
    GRAMIAN, FACTOR_COLUMNS, FACTOR_ROWS, NODE_FACTORS, DIGITS, FREE_STEP_ROWS, DELAYED, CONSTANT_SHARE,
    # 1 if the switch passes through several stages,
    STAGED,
    # the work that is left, and the value of it at the next check (see `work_limit`).
    WORK_LEFT, NEXT_CHECK,
) = range(pg.CONTENTS, pg.CONTENTS + pg.ROOM)  # fmt: skip
# and within its block of integers: key, finest level, bits of its energies (0 if they are not there), padded number of
# the guards' rows without those of watched outputs, place of the form that conducting diodes hold at zero (-1: none),
# number of levels whose factors of powers are tabulated at nodes, for every level how often they were asked for (or
# minus the number of its table), number of guards, then for every guard its kind and its row.
KEY, FINEST_LEVEL, ACCOUNTED, EVENT_ROWS, CLAMPED_FORM, NODE_SETS, NODE_USES = range(7)
GUARD_COUNT = NODE_USES + LEVELS
FIRST_GUARD = GUARD_COUNT + 1


def contents(integers: np.ndarray, ledger: bool) -> tuple[np.ndarray, int]:
    """Complete the table of contents by the tables; returns it with the numbers that P has to hold."""
    head = integers.copy()
    c, g, h = head[pg.C], head[pg.G], head[pg.H]
    rows, columns = head[pg.ROWS], head[pg.COLUMNS]
    square = columns * rows
    # Distinct rows of guards; those of watched outputs begin at a register of their own.
    forms = padded(int(g + 1 + h)) + padded(pg.WATCHED)
    sampled, staged = head[pg.SIGNAL_KIND] == pg.RAMPS, _staged(head)
    glide_rows = 2 * rows + 2 * forms + OUTPUT_ROWS
    products, energies = head[pg.PRODUCTS] + h, head[pg.CATEGORY_COUNT] if ledger else 0
    factors = 2 * padded(int(products)) if ledger else 0
    sizes = {
        STEPS: LEVELS, MATRIX: square, POWERS: TERMS * square, GUARDS: 3 * forms * columns, LINES: 2 * forms * rows,
        VALUES: forms * columns, TAYLOR: forms * TAYLOR_ROWS * columns,
        DEVIATION: forms * columns if sampled or staged else 0,
        FREE_STEP: glide_rows * columns if sampled or staged else 0,
        DELAYED: 3 * forms * columns, SIZES: 3 * forms, OUTPUTS: OUTPUT_ROWS * columns,
        PRODUCTS: products * 2 * rows, GROWTH: LEVELS * square, GRAMIAN: LEVELS * energies * square,
        FACTOR_COLUMNS: factors * columns, NODE_FACTORS: MAX_NODE_SETS * NODE_COUNT * factors * columns,
        DIGITS: -(-LEVELS // DIGIT_BITS) * LARGEST * square if sampled else 0, CONSTANT_SHARE: 1,
    }  # fmt: skip
    offset = 0
    for place, size in sizes.items():
        head[place] = offset
        offset += whole_lines(int(size))
    modes = int(min(MODES, c * 2 ** min(h, 10), max(MAX_NUMBERS // offset, 1)))
    scratch = int((ORDER + 4) * square + (LEVELS if sampled or staged else 3) * forms * columns)
    slot = FIRST_GUARD + 2 * int(g + 1 + 2 * h + pg.WATCHED)
    head[[BLOCK, SLOT, ROOM, FORMS, LEDGER]] = offset, slot, modes, forms, energies
    head[GUARD_ROWS], head[FREE_STEP_ROWS], head[STAGED], head[FACTOR_ROWS] = 3 * forms, glide_rows, staged, factors
    head[SCRATCH] = whole_lines(head[pg.LENGTH])
    head[TABLES] = head[SCRATCH] + whole_lines(scratch)
    head[SLOTS] = len(head)
    head[CLAMPED] = 0
    head[MAP], head[MAPPED] = len(head) + modes * slot, min(c * 2**h, MAX_MAPPED)
    lists = np.full(modes * slot, -1), np.zeros(head[MAPPED], np.int64)
    return np.concatenate([head, *lists]), int(head[TABLES] + modes * offset)


def _staged(head: np.ndarray) -> bool:
    """True if a stage of the switch is followed by another one."""
    opened = head[head[pg.OPENED] :][: head[pg.C]]
    return bool(head[pg.SWITCHED] == 1 and (opened[opened] != opened).any())


@inlined
def block_of(L, slot):
    """Offset of the numbers of a mode in P."""
    return L[TABLES] + slot * L[BLOCK]


@inlined
def slot_of(L, slot):
    """Offset of the integers of a mode in L."""
    return L[SLOTS] + slot * L[SLOT]


@inlined
def place_of(row):
    """Place of a guard's value among the evaluated ones; its rate and second rate follow at LANES and 2 LANES."""
    return row + row // LANES * 2 * LANES


@inlined
def rows_read(L, tracked, slot):
    """Number of rows of guards to evaluate: those of watched outputs stand behind the others."""
    return L[FORMS] if tracked else L[slot_of(L, slot) + EVENT_ROWS]


@compiled
def find_mode(L, D, configuration, slip):
    """Index of a mode in the tables, or -1; the stops' states begin at `slip` in D."""
    key = mode_key(L, D, configuration, slip)
    slot = L[L[MAP] + (key if key < L[MAPPED] else key % L[MAPPED])]
    return slot if slot < L[CLAMPED] and L[slot_of(L, slot) + KEY] == key else -1


@compiled
def mode_key(L, D, configuration, slip):
    """Integer key of a mode."""
    key = configuration
    for j in range(L[pg.H]):
        key = 2 * key + (1 if D[slip + j] != 0 else 0)
    return key
