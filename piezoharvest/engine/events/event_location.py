"""Location of the first guard of a mode that crosses zero upwards within a step."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.events.guard_interpolation import crossing, may_peak, quintic
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import vector
from piezoharvest.engine.memory.tables import block_of, place_of, rows_read, slot_of
from piezoharvest.engine.memory.vector import LANES, copy, dot, multiply, multiply_top
from piezoharvest.engine.motion.exact_step import (
    FOUND,
    MAX_FRACTION,
    SERIES,
    TRIAL,
    propagate_exactly,
    propagate_finest_steps,
    propagate_fraction,
)

TIE_TOLERANCE = 1e-9  # fraction of a step: crossings estimated closer together keep the order of their guards


@compiled
def rounding_noise(f0, d0, f1, d1, h, floor):
    """Rounding error of a guard near zero."""
    return 1e-13 * (abs(f0) + abs(f1) + h * (abs(d0) + abs(d1))) + floor


@inlined
def rounding_floor(P, L, S, D, slot, place, limit):
    """Rounding error of a guard from the size of its terms; a stop's limit is as large as the quantity it bounds."""
    return 1e-13 * (S[D[st.SIZE]] * P[block_of(L, slot) + L[tb.SIZES] + place] + abs(limit))


@compiled
def locate(P, L, S, D, slot, row, sign, offset, low, high, tau, out):
    """Time at which a guard that is above zero at `high` crosses zero after `low` (s from the present state).

    `tau` is an estimate; the state at the crossing is left at `out`. The state is propagated to the multiple of the
    finest step next to the estimate. From there the Taylor series of the motion gives that of the guard, a scalar
    polynomial whose zero is found. Where the guard keeps its sign over the range in which the series is valid, the
    search goes on beyond that range: by Newton's method, or by bisection where that does not halve the interval in two
    steps.
    """
    block, columns, terms, height = block_of(L, slot), L[pg.COLUMNS], D[st.TAYLOR], tb.TAYLOR_ROWS
    forms = block + L[tb.TAYLOR] + row * height * columns
    longest, short = P[block + L[tb.STEPS]], P[block + L[tb.STEPS] + L[slot_of(L, slot) + tb.FINEST_LEVEL]]
    per_second, share, width, wider = 1.0 / short, 0.0, np.inf, np.inf
    tau = min(max(tau, low), high)
    while True:
        base = tau - propagate_finest_steps(P, L, S, D, slot, 0, tau)
        multiply(P, forms, height, columns, S, vector(L, D, SERIES), terms)
        c = (
            sign * S[terms] + offset, sign * S[terms + 1], sign * S[terms + 2],
            sign * S[terms + 3], sign * S[terms + 4], sign * S[terms + 5],
            sign * S[terms + 6], sign * S[terms + 7], sign * S[terms + 8],
        )  # fmt: skip
        left, right = max((low - base) * per_second, -MAX_FRACTION), min((high - base) * per_second, MAX_FRACTION)
        if not _series_value(c, right) > 0.0:
            # At the end of the interval it counts as above zero, in spite of rounding.
            share, ends = right, right < MAX_FRACTION
            low = base + right * short
        elif _series_value(c, left) > 0.0:
            share, ends = left, left > -MAX_FRACTION
            high = base + left * short
        else:
            share, ends = _series_zero(c, left, right), True
        if ends or high - low <= 1e-15 * longest:
            break
        rate = _series_rate(c, share)
        tau = base + short * (share - _series_value(c, share) / rate) if rate > 0.0 else -1.0
        if not low < tau < high or high - low > 0.5 * wider:
            tau = 0.5 * (low + high)
        width, wider = high - low, width
    propagate_fraction(P, L, S, D, slot, share, out)
    return base + share * short


@compiled
def _series_zero(c, low, high):
    """Zero of a guard's Taylor series between two fractions of the finest step where it has different signs.

    Newton's method, with bisection where that leaves the bounds.
    """
    x = min(max(-c[0] / c[1], low), high) if c[1] > 0.0 else 0.5 * (low + high)
    for _ in range(60):
        value, rate = _series_value(c, x), _series_rate(c, x)
        if value > 0.0:
            high = x
        else:
            low = x
        target = x - value / rate if rate > 0.0 else 0.5 * (low + high)
        if not low <= target <= high:
            target = 0.5 * (low + high)
        shift, x = target - x, target
        # Newton's next step would be about the square of this one, in units of 1/|A|.
        if (abs(shift) <= 3e-6 and rate > 0.0) or high - low <= 1e-15:
            break
    return x


@compiled
def _series_rate(c, x):
    """Derivative of a series of order 8."""
    rate = 4 * c[4] + x * (5 * c[5] + x * (6 * c[6] + x * (7 * c[7] + x * (8 * c[8]))))
    return c[1] + x * (2 * c[2] + x * (3 * c[3] + x * rate))


@compiled
def _series_value(c, x):
    """Sum of a series of order 8."""
    value = c[4] + x * (c[5] + x * (c[6] + x * (c[7] + x * c[8])))
    return c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * value)))


@inlined
def bit_of(row):
    """Bit of a form in the masks of rising or falling forms; with more forms than bits several share one."""
    return 1 << (row & 31)


@compiled
def first_crossing(P, L, S, D, slot, now, then, step, rising, falling):
    """Guard that crosses zero first within a step, and its time; the state there is left in the scratch vector FOUND.

    Guards that may cross have the bits of their forms set: in `rising` if the form crosses upwards, in `falling` if it
    crosses downwards.

    Each crossing is estimated from the ends of the step; crossings are then located in the order of the estimates. Once
    one is found, the signs of the other guards at its state show which of them crossed before: only these are located.
    """
    best, best_tau, rows = NONE, np.inf, L[pg.ROWS]
    found, trial, guesses = vector(L, D, FOUND), vector(L, D, TRIAL), D[st.GUESS]
    at, count = slot_of(L, slot), 0
    for g in range(L[at + tb.GUARD_COUNT] - pg.WATCHED):
        ways = rising if S[D[st.SIGN] + g] > 0.0 else falling
        if ways & bit_of(L[at + tb.FIRST_GUARD + 2 * g + 1]) and _bracket_crossing(
            P, L, S, D, slot, now, then, step, g, count
        ):
            D[D[st.CANDIDATE] + count] = g
            count += 1
    for _ in range(count):
        first = 0
        for k in range(1, count):
            if S[guesses + k] < S[guesses + first] - TIE_TOLERANCE:
                first = k
        guess = S[guesses + first]
        if not guess * step < best_tau:
            break
        S[guesses + first] = np.inf
        if best != NONE and S[D[st.HIGH] + first] == 1.0:
            continue
        tau = _locate_candidate(P, L, S, D, slot, now, then, step, first, guess, trial)
        if tau < best_tau:
            best, best_tau = D[D[st.CANDIDATE] + first], tau
            found, trial = trial, found
    if best != NONE and L[at + tb.GUARD_COUNT] - pg.WATCHED > 1:
        best, best_tau, found = _earlier_crossing(P, L, S, D, slot, now, step, best, best_tau, found, trial)
    if found != vector(L, D, FOUND):
        copy(S, found, vector(L, D, FOUND), rows)
    return best, best_tau


@compiled
def _bracket_crossing(P, L, S, D, slot, now, then, step, g, candidate):
    """Store the fractions of a step between which a guard crosses zero, and an estimate; return True if it does."""
    row, sign, offset = L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * g + 1], S[D[st.SIGN] + g], S[D[st.OFFSET] + g]
    place = place_of(row)
    f0, f1 = sign * S[now + place] + offset, sign * S[then + place] + offset
    d0, d1 = sign * S[now + place + LANES], sign * S[then + place + LANES]
    noise = rounding_noise(f0, d0, f1, d1, step, rounding_floor(P, L, S, D, slot, place, offset))
    s0, s1 = sign * S[now + place + 2 * LANES], sign * S[then + place + 2 * LANES]
    falls = may_peak(f0, d0, s0, f1, d1, s1, step, noise)
    if not (f1 > noise or falls):
        return False
    c = quintic(f0, d0, s0, f1, d1, s1, step)
    low, high, x = crossing(c, noise, f1 > noise and d0 > 0.0 and d1 > 0.0, falls)
    S[D[st.GUESS] + candidate], S[D[st.LOW] + candidate], S[D[st.HIGH] + candidate] = x, low, high
    return low <= high


@compiled
def _locate_candidate(P, L, S, D, slot, now, then, step, candidate, guess, out):
    """Time at which a guard crosses zero within a step, from its stored estimate; the state there is left at `out`."""
    g, low, high = D[D[st.CANDIDATE] + candidate], S[D[st.LOW] + candidate], S[D[st.HIGH] + candidate]
    row, sign, offset = L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * g + 1], S[D[st.SIGN] + g], S[D[st.OFFSET] + g]
    if high == 0.0:
        copy(S, 0, out, L[pg.ROWS])
        return 0.0
    # The interpolation is not exact: if a guard is below zero at the end of the step, it is evaluated at its maximum.
    place = place_of(row)
    f0, f1 = sign * S[now + place] + offset, sign * S[then + place] + offset
    if f1 > 0.0:
        high = 1.0
    else:
        d0, d1 = sign * S[now + place + LANES], sign * S[then + place + LANES]
        propagate_exactly(P, L, S, D, slot, 0, high * step, out)
        highest = sign * dot(P, block_of(L, slot) + L[tb.LINES] + 2 * row * L[pg.ROWS], S, out, L[pg.ROWS]) + offset
        if not highest > rounding_noise(f0, d0, f1, d1, step, rounding_floor(P, L, S, D, slot, place, offset)):
            return np.inf
    if f0 <= 0.0 or low < 0.0:
        low = 0.0
    return locate(P, L, S, D, slot, row, sign, offset, low * step, high * step, guess * step, out)


@compiled
def _earlier_crossing(P, L, S, D, slot, now, step, best, best_tau, found, trial):
    """Look for a guard above zero at the time of the first crossing: it crossed earlier, too briefly for the estimates.

    This is common for diodes that begin to conduct just before the extremum.
    """
    at, rows, values = slot_of(L, slot), rows_read(L, False, slot), D[st.THERE_GUARDS]
    multiply_top(P, block_of(L, slot) + L[tb.VALUES], L[tb.FORMS], rows, L[pg.COLUMNS], S, found, values)
    own, beyond, lower, upper = L[at + tb.FIRST_GUARD + 2 * best + 1], False, D[st.LOWER], D[st.UPPER]
    for row in range(0, rows, LANES):
        for k in range(LANES):
            value = S[values + row + k]
            beyond |= ((value > S[upper + row + k]) | (value < S[lower + row + k])) & (row + k != own)
    for g in range(L[at + tb.GUARD_COUNT] - pg.WATCHED if beyond else 0):
        row, sign, offset = L[at + tb.FIRST_GUARD + 2 * g + 1], S[D[st.SIGN] + g], S[D[st.OFFSET] + g]
        if g == best or not sign * S[values + row] + offset > 0.0:
            continue
        f0, d0 = sign * S[now + place_of(row)] + offset, sign * S[now + place_of(row) + LANES]
        if f0 > 0.0:
            continue
        # Another guard may have crossed before the one that was found here.
        value = sign * dot(P, block_of(L, slot) + L[tb.LINES] + 2 * row * L[pg.ROWS], S, found, L[pg.ROWS]) + offset
        if value > rounding_floor(P, L, S, D, slot, place_of(row), offset) + 1e-12 * (abs(f0) + step * abs(d0)):
            tau = locate(P, L, S, D, slot, row, sign, offset, 0.0, best_tau, 0.5 * best_tau, trial)
            if tau < best_tau:
                best, best_tau = g, tau
                found, trial = trial, found
    return best, best_tau, found
