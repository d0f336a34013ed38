"""Propagation within one linear mode up to the next event."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.events.event_location import bit_of, first_crossing, rounding_floor, rounding_noise
from piezoharvest.engine.events.guard_interpolation import interpolation_error, may_have_two_extrema, may_peak
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import vector
from piezoharvest.engine.memory.tables import block_of, place_of, rows_read, slot_of
from piezoharvest.engine.memory.vector import LANES, copy, grow, multiply_top
from piezoharvest.engine.motion.exact_step import ARRIVED, FOUND, propagate_exactly
from piezoharvest.engine.motion.exponentials import FIRST_STEP_LEVEL
from piezoharvest.engine.motion.mode_forms import DECAY_LEVEL, STIFF_LEVELS
from piezoharvest.engine.propagation.recording import TIME_TOLERANCE, record_energies, record_outputs
from piezoharvest.engine.propagation.tangents import propagate_sensitivities
from piezoharvest.engine.work_limit import STEP_WORK, may_continue, spend_products

# Relative interpolation error of a guard with which a step is accepted, and with which the next is twice or four times
# as long.
MAX_ERROR, DOUBLING_ERROR, QUADRUPLING_ERROR = 0.05, 0.005, 1e-4
# Less than this share of a step would be left after it: both are taken at once.
LAST_SHARE = 0.25


@compiled
def read_guards(P, L, S, D, slot, forms, z, out):
    """Values, rates and second rates of the guards of a mode, each register of forms with its rates behind it.

    `forms` is the place of their forms in its block: those of the present rates, or of the delayed rates of a stiff
    mode.
    """
    stride, rows = L[tb.GUARD_ROWS], 3 * rows_read(L, D[st.TRACKED], slot)
    multiply_top(P, block_of(L, slot) + forms, stride, rows, L[pg.COLUMNS], S, z, out)


@compiled
def _scan_guards(P, L, S, D, slot, now, then, step):
    """Guards that may rise within a step, True if it is too long to tell, and the number of times it may be doubled.

    Guards are bits as in `first_crossing`. Forms are tested against both limits, a register of them at a time, without
    branches, so that the compiler vectorises it. Watched outputs have no limits.
    """
    lower, upper, events = D[st.LOWER], D[st.UPPER], rows_read(L, False, slot)
    rising, falling, too_long, bent, uneven = 0, 0, False, False, False
    for row in range(0, events, LANES):
        for k in range(LANES):
            f0, d0, s0, f1, d1, s1 = _ends(S, now, then, row, k)
            high, low = S[upper + row + k], S[lower + row + k]
            above0, above1, below0, below1 = f0 - high, f1 - high, low - f0, low - f1
            over = rounding_floor(P, L, S, D, slot, place_of(row) + k, high)
            rising |= _may_rise(above0, d0, s0, above1, d1, s1, step, over) * bit_of(row + k)
            floor = rounding_floor(P, L, S, D, slot, place_of(row) + k, low)
            falling |= _may_rise(below0, -d0, -s0, below1, -d1, -s1, step, floor) * bit_of(row + k)
            # An error below rounding is no reason for short steps: a guard may be zero, and its rate may not.
            size = min(_size(above0, above1) + over, _size(below0, below1) + floor)
            doubtful = interpolation_error(f0, d0, s0, f1, d1, s1, step)
            highest = max(max(above0, above1), max(below0, below1))
            too_long |= (doubtful > MAX_ERROR * size) | may_have_two_extrema(f0, d0, f1, d1, step, highest, 1e4 * floor)
            bent |= doubtful > DOUBLING_ERROR * size
            uneven |= doubtful > QUADRUPLING_ERROR * size
    for row in range(events, rows_read(L, D[st.TRACKED], slot), LANES):
        for k in range(LANES):
            f0, d0, s0, f1, d1, s1 = _ends(S, now, then, row, k)
            floor = rounding_floor(P, L, S, D, slot, place_of(row) + k, 0.0)
            size, doubtful = _size(f0, f1) + 1e4 * floor, interpolation_error(f0, d0, s0, f1, d1, s1, step)
            highest = abs(f0) if f0 * f1 < 0.0 else -min(abs(f0), abs(f1))
            too_long |= (doubtful > MAX_ERROR * size) | may_have_two_extrema(f0, d0, f1, d1, step, highest, 1e4 * floor)
            bent |= doubtful > DOUBLING_ERROR * size
            uneven |= doubtful > QUADRUPLING_ERROR * size
    return rising, falling, too_long, 0 if bent else 1 if uneven else 2


@inlined
def _ends(S, now, then, row, k):
    """Value, rate and second rate of a form at both ends of a step."""
    here, there = now + place_of(row) + k, then + place_of(row) + k
    return S[here], S[here + LANES], S[here + 2 * LANES], S[there], S[there + LANES], S[there + 2 * LANES]


@inlined
def _size(f0, f1):
    """Larger absolute value of two numbers."""
    return max(abs(f0), abs(f1))


@inlined
def _may_rise(f0, d0, s0, f1, d1, s1, step, floor):
    """True if a guard may rise within a step; a guard at minus infinity may not."""
    noise = rounding_noise(f0, d0, f1, d1, step, floor)
    return (f1 > noise) | (may_peak(f0, d0, s0, f1, d1, s1, step, noise) & (f0 > -np.inf))


@compiled
def propagate_mode(P, L, S, D, slot, t_stop):
    """Propagate within a mode until t_stop or until a guard crosses zero, and return its place in the list, or NONE.

    If no work is left (see `work_limit`) the state becomes NaN. The guards at the beginning stand at NOW_GUARDS. The
    first step resolves the fastest motion of the mode, and steps are doubled while every guard is smooth over them, so
    that a decayed transient costs nothing. A run through samples begins with the whole rest of a sample: usually no
    fast motion is excited, and if it is, the rates at the ends show it. Sensitivities, which no guard reads, follow at
    the end, or when they are a longest step behind.
    """
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    growth, steps, finest = block + L[tb.GROWTH], block + L[tb.STEPS], L[slot_of(L, slot) + tb.FINEST_LEVEL]
    clock, arrived, now, then = D[st.CLOCK], vector(L, D, ARRIVED), D[st.NOW_GUARDS], D[st.THEN_GUARDS]
    watching = D[st.SAMPLES_WANTED] > 0 or D[st.TRACKED] > 0
    recording, moves, behind = watching or D[st.ENERGIES] > 0, D[st.SENSITIVITIES] > 0, 0.0
    resolved = max(finest - FIRST_STEP_LEVEL, 0)
    level = 0 if L[pg.SIGNAL_KIND] == pg.RAMPS else resolved
    # Time after which fast motion has decayed, and the forms of the guards.
    settled, forms = S[clock] + P[steps + finest - DECAY_LEVEL] if finest >= STIFF_LEVELS else np.inf, L[tb.GUARDS]
    while True:
        L[tb.WORK_LEFT] -= STEP_WORK * (1 + L[pg.ELEMENTS])
        spend_products(L, 2)
        if L[tb.WORK_LEFT] < L[tb.NEXT_CHECK] and not may_continue(L):
            S[0] = np.nan
            return NONE
        left = t_stop - S[clock]
        if left <= 0.0:
            return NONE
        step = P[steps + level]
        over = left - step
        full = over >= -TIME_TOLERANCE * left and (level == 0 or not TIME_TOLERANCE * left < over < LAST_SHARE * step)
        if full:
            grow(P, growth + level * rows * columns, rows, columns, S, 0, arrived)
        else:
            step = left
            propagate_exactly(P, L, S, D, slot, 0, step, arrived)
        wanted = L[tb.DELAYED] if S[clock] >= settled and level <= finest - STIFF_LEVELS else L[tb.GUARDS]
        if forms != wanted:
            forms = wanted
            read_guards(P, L, S, D, slot, forms, 0, now)
        read_guards(P, L, S, D, slot, forms, arrived, then)
        rising, falling, too_long, longer = _scan_guards(P, L, S, D, slot, now, then, step)
        if too_long and level < finest:
            level, resolved = max(level + 1, resolved), 0
            while level < finest and P[steps + level] >= left:
                level += 1
            continue
        guard, tau, target = NONE, step, arrived
        if rising | falling:
            guard, tau = first_crossing(P, L, S, D, slot, now, then, step, rising, falling)
            if guard != NONE:
                target = vector(L, D, FOUND)
            else:
                tau = step
        # Not the sum: with its rounding a sample at this time would be missed.
        end = S[clock] + tau if tau < left * (1 - 1e-12) else t_stop
        if recording:
            if watching:
                record_outputs(P, L, S, D, slot, tau, end, target)
            record_energies(P, L, S, D, slot, tau, level if full and guard == NONE else NONE)
        if moves and behind + tau > P[steps]:
            propagate_sensitivities(P, L, S, D, slot, behind)
            behind = 0.0
        copy(S, target, 0, rows)
        S[clock], behind = end, behind + tau
        if guard != NONE or S[clock] >= t_stop:
            if moves:
                propagate_sensitivities(P, L, S, D, slot, behind)
            return guard
        now, then = then, now
        level, resolved = max(level - longer, 0), 0
