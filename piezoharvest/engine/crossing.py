"""Which guard of a mode rises first within a step, and when."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine import state as st
from piezoharvest.engine import tables as tb
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.interpolation import crossing, peaks, quintic
from piezoharvest.engine.motion import FOUND, TRIAL, exact, taylor
from piezoharvest.engine.state import vector
from piezoharvest.engine.tables import block_of, slot_of
from piezoharvest.engine.vector import copy, dot

NONE = -1


@compiled
def noise_of(f0, d0, f1, d1, h, floor):
    """What a guard may be off zero by rounding."""
    return 1e-13 * (abs(f0) + abs(f1) + h * (abs(d0) + abs(d1))) + floor


@compiled
def locate(P, L, S, D, slot, row, sign, offset, low, high, tau, rises, out):
    """Time at which a guard rises through zero between low and high (s from the state), from the estimate tau.

    Safeguarded Newton on the exact motion; leaves the state there at `out`. `rises` tells that the guard is known to be
    above zero at `high`; without that the time is infinite where it only comes close to zero.
    """
    rows, block = L[pg.ROWS], block_of(L, slot)
    value_row = block + L[tb.LINES] + 2 * row * rows
    rate_row = value_row + rows
    longest, short = P[block + L[tb.STEPS]], P[block + L[tb.STEPS] + L[slot_of(L, slot) + tb.FINEST_LEVEL]]
    exact(P, L, S, D, slot, 0, tau, out)
    for _ in range(80):
        value = sign * dot(P, value_row, S, out, rows) + offset
        rate = sign * dot(P, rate_row, S, out, rows)
        if value > 0.0:
            high, rises = tau, True
        else:
            low = tau
        target = tau - value / rate if rate > 0.0 else 0.5 * (low + high)
        if not low <= target <= high:
            target = 0.5 * (low + high)
        shift = target - tau
        if abs(shift) <= short:
            taylor(P, L, S, D, block, out, shift, shift / short)
        else:
            exact(P, L, S, D, slot, 0, target, out)
        tau = target
        # Newton's next step would be about the square of this one, in units of 1/|A|.
        if abs(shift) <= 3e-5 * short and rate > 0.0:
            return tau
        if high - low <= 1e-15 * longest:
            break
    return tau if rises else np.inf


@compiled
def earliest(P, L, S, D, slot, now, then, step):
    """Guard that rises first within a step, and when; the state there is left in the scratch vector FOUND."""
    best, best_tau = NONE, np.inf
    at, forms, rows = slot_of(L, slot), L[tb.FORMS], L[pg.ROWS]
    found, trial = vector(L, D, FOUND), vector(L, D, TRIAL)
    events = L[at + tb.GUARD_COUNT] - pg.WATCHED
    for g in range(events):
        row, sign, offset = L[at + tb.FIRST_GUARD + 2 * g + 1], S[D[st.SIGN] + g], S[D[st.OFFSET] + g]
        f0, f1 = sign * S[now + row] + offset, sign * S[then + row] + offset
        d0, d1 = sign * S[now + forms + row], sign * S[then + forms + row]
        noise = noise_of(f0, d0, f1, d1, step, S[D[st.FLOOR] + g])
        s0, s1 = sign * S[now + 2 * forms + row], sign * S[then + 2 * forms + row]
        falls = peaks(f0, d0, s0, f1, d1, s1, step, noise)
        if not (f1 > noise or falls):
            continue
        c = quintic(f0, d0, s0, f1, d1, s1, step)
        low, high, guess = crossing(c, noise, f1 > noise and d0 > 0.0 and d1 > 0.0, falls)
        if low > high or low * step > best_tau:
            continue
        tau = 0.0
        if high > 0.0:
            # The interpolation is not exact, but at the ends of the step the guard is known.
            if f0 <= 0.0:
                low = 0.0
            certain = f1 > 0.0
            if certain:
                high = 1.0
            tau = locate(P, L, S, D, slot, row, sign, offset, low * step, high * step, guess * step, certain, trial)
        else:
            copy(S, 0, trial, rows)
        if tau < best_tau:
            best, best_tau = g, tau
            found, trial = trial, found
    if best != NONE and events > 1:
        best, best_tau, found = _before(P, L, S, D, slot, now, step, best, best_tau, found, trial)
    if found != vector(L, D, FOUND):
        copy(S, found, vector(L, D, FOUND), rows)
    return best, best_tau


@compiled
def _before(P, L, S, D, slot, now, step, best, best_tau, found, trial):
    """Look for a guard that is above zero when the first one rises: it has risen before, too briefly to be seen.

    Diodes that begin to conduct just before the extremum do so as a rule.
    """
    at, rows = slot_of(L, slot), L[pg.ROWS]
    lines = block_of(L, slot) + L[tb.LINES]
    for g in range(L[at + tb.GUARD_COUNT] - pg.WATCHED):
        row, sign, offset = L[at + tb.FIRST_GUARD + 2 * g + 1], S[D[st.SIGN] + g], S[D[st.OFFSET] + g]
        f0, d0 = sign * S[now + row] + offset, sign * S[now + L[tb.FORMS] + row]
        if g == best or f0 > 0.0:
            continue
        value = sign * dot(P, lines + 2 * row * rows, S, found, rows) + offset
        if value > S[D[st.FLOOR] + g] + 1e-12 * (abs(f0) + step * abs(d0)):
            tau = locate(P, L, S, D, slot, row, sign, offset, 0.0, best_tau, 0.5 * best_tau, True, trial)
            if tau < best_tau:
                best, best_tau = g, tau
                found, trial = trial, found
    return best, best_tau, found
