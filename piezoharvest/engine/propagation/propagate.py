"""Moving within one linear mode up to the next event."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.events.event_location import bit_of, earliest, floor_of, noise_of
from piezoharvest.engine.events.guard_interpolation import doubt, peaks, turns_twice
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import vector
from piezoharvest.engine.memory.tables import block_of, place_of, rows_read, slot_of
from piezoharvest.engine.memory.vector import LANES, copy, grow, multiply_top
from piezoharvest.engine.motion.exact_step import ARRIVED, FOUND, exact
from piezoharvest.engine.motion.exponentials import BOLD
from piezoharvest.engine.motion.mode_forms import DIES_OUT, STIFF
from piezoharvest.engine.propagation.recording import SAME_TIME, account, observe
from piezoharvest.engine.work_limit import STEP, goes_on, products

# Doubt of a guard, relative, with which a step is taken, and with which the next is twice or four times as long.
BELIEVED, SMOOTH, CALM = 0.05, 0.005, 1e-4


@compiled
def read_guards(P, L, S, D, slot, forms, z, out):
    """Values, rates and second rates of the guards of a mode, each register of forms with its rates behind it.

    `forms` is where their forms stand in its block: those of this moment, or those of a stiff mode that has settled.
    """
    stride, rows = L[tb.GUARD_ROWS], 3 * rows_read(L, D[st.TRACKED], slot)
    multiply_top(P, block_of(L, slot) + forms, stride, rows, L[pg.COLUMNS], S, z, out)


@compiled
def _look(P, L, S, D, slot, now, then, step):
    """Which guards may rise within a step, whether that is too long to tell, how many times it may be doubled.

    Guards are bits as in `earliest`. Forms are looked at from both limits, a register of them at a time; without a
    branch, so that vectors are made of it. What is watched has no limits.
    """
    lower, upper, events = D[st.LOWER], D[st.UPPER], rows_read(L, False, slot)
    rising, falling, too_long, bent, uneven = 0, 0, False, False, False
    for row in range(0, events, LANES):
        for k in range(LANES):
            f0, d0, s0, f1, d1, s1 = _ends(S, now, then, row, k)
            high, low = S[upper + row + k], S[lower + row + k]
            above0, above1, below0, below1 = f0 - high, f1 - high, low - f0, low - f1
            floor = floor_of(P, L, S, D, slot, place_of(row) + k, high)
            rising |= _may_rise(above0, d0, s0, above1, d1, s1, step, floor) * bit_of(row + k)
            floor = floor_of(P, L, S, D, slot, place_of(row) + k, low)
            falling |= _may_rise(below0, -d0, -s0, below1, -d1, -s1, step, floor) * bit_of(row + k)
            size, doubtful = min(_size(above0, above1), _size(below0, below1)), doubt(f0, d0, s0, f1, d1, s1, step)
            highest = max(max(above0, above1), max(below0, below1))
            too_long |= (doubtful > BELIEVED * size) | turns_twice(f0, d0, f1, d1, step, highest, 1e4 * floor)
            bent |= doubtful > SMOOTH * size
            uneven |= doubtful > CALM * size
    for row in range(events, rows_read(L, D[st.TRACKED], slot), LANES):
        for k in range(LANES):
            f0, d0, s0, f1, d1, s1 = _ends(S, now, then, row, k)
            floor = floor_of(P, L, S, D, slot, place_of(row) + k, 0.0)
            size, doubtful = _size(f0, f1) + 1e4 * floor, doubt(f0, d0, s0, f1, d1, s1, step)
            highest = abs(f0) if f0 * f1 < 0.0 else -min(abs(f0), abs(f1))
            too_long |= (doubtful > BELIEVED * size) | turns_twice(f0, d0, f1, d1, step, highest, 1e4 * floor)
            bent |= doubtful > SMOOTH * size
            uneven |= doubtful > CALM * size
    return rising, falling, too_long, 0 if bent else 1 if uneven else 2


@inlined
def _ends(S, now, then, row, k):
    """Value, rate and second rate of a form at both ends of a step."""
    here, there = now + place_of(row) + k, then + place_of(row) + k
    return S[here], S[here + LANES], S[here + 2 * LANES], S[there], S[there + LANES], S[there + 2 * LANES]


@inlined
def _size(f0, f1):
    """The larger size of two numbers."""
    return max(abs(f0), abs(f1))


@inlined
def _may_rise(f0, d0, s0, f1, d1, s1, step, floor):
    """Whether a guard may rise within a step, one that is infinitely far below zero excepted."""
    noise = noise_of(f0, d0, f1, d1, step, floor)
    return (f1 > noise) | (peaks(f0, d0, s0, f1, d1, s1, step, noise) & (f0 > -np.inf))


@compiled
def march(P, L, S, D, slot, t_stop):
    """Move within a mode until t_stop or until a guard rises through zero, and return its place in the list, or NONE.

    Where no work is left (see `budget`) the motion ends with a state that is not a number.
    The guards at the beginning stand at NOW_GUARDS. The step begins where the fastest motion of the mode is resolved
    and doubles for as long as every guard is smooth over it, so that a transient that has died out costs nothing. What
    follows samples begins with all that is left of one: mostly nothing fast is excited, and if it is, that shows in the
    rates at the ends.
    """
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    growth, steps, finest = block + L[tb.GROWTH], block + L[tb.STEPS], L[slot_of(L, slot) + tb.FINEST_LEVEL]
    clock, arrived, now, then = D[st.CLOCK], vector(L, D, ARRIVED), D[st.NOW_GUARDS], D[st.THEN_GUARDS]
    watching = D[st.SAMPLES_WANTED] > 0 or D[st.TRACKED] > 0
    recording = watching or D[st.ENERGIES] > 0 or D[st.SENSITIVITIES] > 0
    resolved = max(finest - BOLD, 0)
    level = 0 if L[pg.SIGNAL_KIND] == pg.RAMPS else resolved
    # When fast motion has died out, and the forms by which guards are read.
    settled, forms = S[clock] + P[steps + finest - DIES_OUT] if finest >= STIFF else np.inf, L[tb.GUARDS]
    while True:
        L[tb.LEFT] -= STEP * (1 + L[pg.ELEMENTS])
        products(L, 2)
        if L[tb.LEFT] < L[tb.LOOK] and not goes_on(L):
            S[0] = np.nan
            return NONE
        left = t_stop - S[clock]
        if left <= 0.0:
            return NONE
        step = P[steps + level]
        full = step <= left * (1 + SAME_TIME)
        if full:
            grow(P, growth + level * rows * columns, rows, columns, S, 0, arrived)
        else:
            step = left
            exact(P, L, S, D, slot, 0, step, arrived)
        wanted = L[tb.SETTLED] if S[clock] >= settled and level <= finest - STIFF else L[tb.GUARDS]
        if forms != wanted:
            forms = wanted
            read_guards(P, L, S, D, slot, forms, 0, now)
        read_guards(P, L, S, D, slot, forms, arrived, then)
        rising, falling, too_long, longer = _look(P, L, S, D, slot, now, then, step)
        if too_long and level < finest:
            level, resolved = max(level + 1, resolved), 0
            while level < finest and P[steps + level] >= left:
                level += 1
            continue
        guard, tau, target = NONE, step, arrived
        if rising | falling:
            guard, tau = earliest(P, L, S, D, slot, now, then, step, rising, falling)
            if guard != NONE:
                target = vector(L, D, FOUND)
            else:
                tau = step
        # Not the sum: rounding would leave out a sample that is wanted there.
        end = S[clock] + tau if tau < left * (1 - 1e-12) else t_stop
        if recording:
            if watching:
                observe(P, L, S, D, slot, tau, end, target)
            account(P, L, S, D, slot, tau, level if full and guard == NONE else NONE)
        copy(S, target, 0, rows)
        S[clock] = end
        if guard != NONE or S[clock] >= t_stop:
            return guard
        now, then = then, now
        level, resolved = max(level - longer, 0), 0
