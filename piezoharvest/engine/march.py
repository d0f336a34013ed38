"""Exact motion within one linear mode, up to the next event: steps, location of events, records on the way."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine import state as st
from piezoharvest.engine import tables as tb
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.interpolation import crossing, doubt, quintic
from piezoharvest.engine.state import dot_column, vector
from piezoharvest.engine.tables import FINEST, NODES, ORDER, WEIGHTS, block_of, slot_of
from piezoharvest.engine.vector import add_term, copy, dot, grow, multiply

NONE = -1
# Scratch vectors, by who uses them.
ARRIVED, FOUND, TRIAL, SAMPLE, KEPT, FLOW, TERM, SWAP = 0, 1, 2, 3, 4, 5, 6, 8
BELIEVED, SMOOTH = 0.05, 0.005  # doubt of a guard, relative, with which a step is taken and the next one doubled


@compiled
def taylor(P, L, S, D, block, z, tau, share):
    """Advance the vector at z in place by tau, no longer than the finest level; `share` is tau over it."""
    rows, columns, matrix = L[pg.ROWS], L[pg.COLUMNS], block + L[tb.MATRIX]
    source, target = z, vector(L, D, TERM)
    other = target + rows
    bound = 1.0
    for k in range(1, ORDER + 2):
        # |A tau|^k / k! bounds this term.
        bound *= FINEST * abs(share) / k
        if bound < 1e-17:
            break
        if k == 1:
            # The vector grows while its own product is formed, so that it is read from a copy.
            copy(S, z, other, rows)
            source = other
        add_term(P, matrix, rows, columns, tau / k, S, source, target, z)
        source, target = target, source


@compiled
def exact(P, L, S, D, slot, x, tau, out):
    """Out = exp(A tau) x for any 0 <= tau <= longest step: binary digits of tau, then a Taylor series.

    The digits are rounded to the nearest finest step, so that the series spans half of one, forwards or back.
    """
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    growth, steps, finest = block + L[tb.GROWTH], block + L[tb.STEPS], L[slot_of(L, slot) + tb.FINEST_LEVEL]
    short = P[steps + finest]
    source, rest = x, tau
    here, there = out, vector(L, D, SWAP)
    for level in range(finest + 1):
        h = P[steps + level]
        if rest >= (h if level < finest else 0.5 * h):
            grow(P, growth + level * rows * columns, rows, columns, S, source, here)
            rest -= h
            source = here
            here, there = there, here
    if source != out:
        copy(S, source, out, rows)
    if rest != 0.0:
        taylor(P, L, S, D, block, out, rest, rest / short)


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
        # Newton's next step would be about the square of this one.
        if abs(shift) <= 1e-7 * short and rate > 0.0:
            return tau
        if high - low <= 1e-15 * longest:
            break
    return tau if rises else np.inf


@compiled
def read_guards(P, L, S, D, slot, z, out):
    """Values, rates and second rates of all guards of a mode."""
    multiply(P, block_of(L, slot) + L[tb.GUARDS], L[tb.GUARD_ROWS], L[pg.COLUMNS], S, z, out)


@compiled
def _noise(f0, d0, f1, d1, h, floor):
    """What a guard may be off zero by rounding."""
    return 1e-13 * (abs(f0) + abs(f1) + h * (abs(d0) + abs(d1))) + floor


@compiled
def _earliest(P, L, S, D, slot, now, then, step):
    """Guard that rises first within a step, and when; the state there is left in the scratch vector FOUND."""
    best, best_tau = NONE, np.inf
    at, forms, rows = slot_of(L, slot), L[tb.FORMS], L[pg.ROWS]
    found, trial = vector(L, D, FOUND), vector(L, D, TRIAL)
    events = L[at + tb.GUARD_COUNT] - pg.WATCHED
    for g in range(events):
        row, sign, offset = L[at + tb.FIRST_GUARD + 2 * g + 1], S[D[st.SIGN] + g], S[D[st.OFFSET] + g]
        f0, f1 = sign * S[now + row] + offset, sign * S[then + row] + offset
        d0, d1 = sign * S[now + forms + row], sign * S[then + forms + row]
        noise = _noise(f0, d0, f1, d1, step, S[D[st.FLOOR] + g])
        if not (f1 > noise or (d0 > 0.0 and d1 < 0.0)):
            continue
        c = quintic(f0, d0, sign * S[now + 2 * forms + row], f1, d1, sign * S[then + 2 * forms + row], step)
        low, high, guess = crossing(c, noise, d0 > 0.0 and d1 < 0.0)
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


@compiled
def _look(L, S, D, slot, now, then, step):
    """Whether a guard may rise within a step, whether the step is too long to tell, whether it may be doubled."""
    at, forms, sign_at, offset_at, floor_at = slot_of(L, slot), L[tb.FORMS], D[st.SIGN], D[st.OFFSET], D[st.FLOOR]
    count = L[at + tb.GUARD_COUNT]
    events = count - pg.WATCHED
    rises, too_long, doubling = False, False, True
    for g in range(count if D[st.TRACKED] else events):
        row, sign, offset, floor = L[at + tb.FIRST_GUARD + 2 * g + 1], S[sign_at + g], S[offset_at + g], S[floor_at + g]
        f0, f1 = sign * S[now + row] + offset, sign * S[then + row] + offset
        row += forms
        d0, d1 = sign * S[now + row], sign * S[then + row]
        row += forms
        doubtful = doubt(f0, d0, sign * S[now + row], f1, d1, sign * S[then + row], step)
        size = max(abs(f0), abs(f1))
        if g < events:
            rises |= f1 > _noise(f0, d0, f1, d1, step, floor) or (d0 > 0.0 and d1 < 0.0)
        else:
            size += 1e4 * floor
        too_long |= doubtful > BELIEVED * size
        doubling &= doubtful <= SMOOTH * size
    return rises, too_long, doubling


@compiled
def _far(P, L, S, D, slot, now, then):
    """Whether no guard can have come near zero within a longest step, by the bounds of its deviation from a line.

    The values at both ends stand at `now` and `then`; what the bounds allow is left behind the latter.
    """
    at, forms, rows = slot_of(L, slot), L[tb.FORMS], L[pg.ROWS]
    size, bound = vector(L, D, TERM), then + forms
    for i in range(rows):
        S[size + i] = abs(S[i])
    multiply(P, block_of(L, slot) + L[tb.DEVIATION], forms, L[pg.COLUMNS], S, size, bound)
    count, signs, offsets = L[at + tb.GUARD_COUNT], D[st.SIGN], D[st.OFFSET]
    for g in range(count - pg.WATCHED):
        row, sign = L[at + tb.FIRST_GUARD + 2 * g + 1], S[signs + g]
        highest = max(sign * S[now + row], sign * S[then + row]) + S[offsets + g]
        if not highest + S[bound + row] < 0.0 and not highest + _deviation(P, L, S, D, slot, row) < 0.0:
            return False
    if D[st.TRACKED]:
        for g in range(count - pg.WATCHED, count):
            row = L[at + tb.FIRST_GUARD + 2 * g + 1]
            f0, f1 = S[now + row], S[then + row]
            if not f0 * f1 > 0.0:
                return False
            nearest = min(abs(f0), abs(f1))
            if not nearest > S[bound + row] and not nearest > _deviation(P, L, S, D, slot, row):
                return False
    return True


@compiled
def _deviation(P, L, S, D, slot, row):
    """How far a guard goes from the straight line between its ends within a longest step from the state now.

    Sharper than the bound, in which a displacement and the force that holds it there do not cancel.
    """
    rungs, columns, ladder = tb.rungs_of(L[slot_of(L, slot) + tb.FINEST_LEVEL]), L[pg.COLUMNS], D[st.LADDER]
    multiply(P, block_of(L, slot) + L[tb.LADDERS] + row * columns * rungs, rungs, columns, S, 0, ladder)
    largest = 0.0
    for k in range(rungs):
        largest = max(largest, abs(S[ladder + k]))
    return 2.0 * largest


@compiled
def glide(P, L, S, D, slot):
    """Make one longest step if no guard comes near zero on it; returns whether it was made.

    This is what most samples of a record are: four products of a matrix with a vector, and no look at rates.
    """
    rows, columns, block, forms = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot), L[tb.FORMS]
    now, then, arrived = D[st.NOW_GUARDS], D[st.THEN_GUARDS], vector(L, D, ARRIVED)
    multiply(P, block + L[tb.VALUES], forms, columns, S, 0, now)
    grow(P, block + L[tb.GROWTH], rows, columns, S, 0, arrived)
    multiply(P, block + L[tb.VALUES], forms, columns, S, arrived, then)
    if not _far(P, L, S, D, slot, now, then):
        return False
    step = P[block + L[tb.STEPS]]
    if D[st.SAMPLES_WANTED] > 0 or D[st.TRACKED] > 0:
        observe(P, L, S, D, slot, step, arrived)
    if D[st.ENERGIES] > 0 or D[st.SENSITIVITIES] > 0:
        account(P, L, S, D, slot, step, 0)
    copy(S, arrived, 0, rows)
    S[D[st.CLOCK]] += step
    return True


@compiled
def march(P, L, S, D, slot, t_stop):
    """Move within a mode until t_stop or until a guard rises through zero, and return its place in the list, or NONE.

    The guards at the beginning stand at NOW_GUARDS. The step begins where the fastest motion of the mode is resolved
    and doubles for as long as every guard is smooth over it, so that a transient that has died out costs nothing.
    """
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    growth, steps, finest = block + L[tb.GROWTH], block + L[tb.STEPS], L[slot_of(L, slot) + tb.FINEST_LEVEL]
    clock, arrived, now, then = D[st.CLOCK], vector(L, D, ARRIVED), D[st.NOW_GUARDS], D[st.THEN_GUARDS]
    watching = D[st.SAMPLES_WANTED] > 0 or D[st.TRACKED] > 0
    recording = watching or D[st.ENERGIES] > 0 or D[st.SENSITIVITIES] > 0
    level = max(finest - tb.BOLD, 0)
    while True:
        left = t_stop - S[clock]
        if left <= 0.0:
            return NONE
        step = P[steps + level]
        full = step <= left * (1 + 1e-12)
        if full:
            grow(P, growth + level * rows * columns, rows, columns, S, 0, arrived)
        else:
            step = left
            exact(P, L, S, D, slot, 0, step, arrived)
        read_guards(P, L, S, D, slot, arrived, then)
        rises, too_long, doubling = _look(L, S, D, slot, now, then, step)
        if too_long and level < finest:
            level += 1
            while level < finest and P[steps + level] >= left:
                level += 1
            continue
        guard, tau, target = NONE, step, arrived
        if rises:
            guard, tau = _earliest(P, L, S, D, slot, now, then, step)
            if guard != NONE:
                target = vector(L, D, FOUND)
            else:
                tau = step
        if recording:
            if watching:
                observe(P, L, S, D, slot, tau, target)
            account(P, L, S, D, slot, tau, level if full and guard == NONE else NONE)
        copy(S, target, 0, rows)
        S[clock] = S[clock] + tau if tau < left * (1 - 1e-12) else t_stop
        if guard != NONE or S[clock] >= t_stop:
            return guard
        now, then = then, now
        if doubling and level > 0:
            level -= 1


@compiled
def observe(P, L, S, D, slot, tau, arrived):
    """Samples and extremes between the state now and the state at `arrived`, tau later."""
    now = S[D[st.CLOCK]]
    end, z, outputs = now + tau, vector(L, D, SAMPLE), block_of(L, slot) + L[tb.OUTPUTS]
    while D[st.SAMPLED] < D[st.SAMPLES_WANTED] and S[D[st.SAMPLE_TIME] + D[st.SAMPLED]] <= end:
        k = D[st.SAMPLED]
        into = S[D[st.SAMPLE_TIME] + k] - now
        here = D[st.SAMPLES] + k * len(pg.OUTPUTS)
        if into <= 0.0:
            multiply(P, outputs, tb.OUTPUT_ROWS, L[pg.COLUMNS], S, 0, here)
        elif into >= tau:
            multiply(P, outputs, tb.OUTPUT_ROWS, L[pg.COLUMNS], S, arrived, here)
        else:
            exact(P, L, S, D, slot, 0, into, z)
            multiply(P, outputs, tb.OUTPUT_ROWS, L[pg.COLUMNS], S, z, here)
        D[st.SAMPLED] += 1
    if D[st.TRACKED]:
        at = slot_of(L, slot)
        first = L[at + tb.GUARD_COUNT] - pg.WATCHED
        for k in range(pg.WATCHED):
            output = outputs + (pg.DISPLACEMENT if k == 0 else pg.VOLTAGE)
            rate = block_of(L, slot) + L[tb.LINES] + 2 * L[at + tb.FIRST_GUARD + 2 * (first + k) + 1] * L[pg.ROWS]
            _turn(P, L, S, D, slot, tau, arrived, k, output, rate)


@compiled
def _turn(P, L, S, D, slot, tau, arrived, k, output, rate):
    """Widen the extremes by the ends of a step, and by the turning point where the output's rate changes sign."""
    a, rows, z = L[pg.A], L[pg.ROWS], vector(L, D, SAMPLE)
    _widen(S, D, k, dot_column(P, output, tb.OUTPUT_ROWS, S, 0, a))
    _widen(S, D, k, dot_column(P, output, tb.OUTPUT_ROWS, S, arrived, a))
    before, after = dot(P, rate, S, 0, rows), dot(P, rate, S, arrived, rows)
    if not before * after < 0.0:
        return
    low, high, low_rate, high_rate = 0.0, tau, before, after
    for _ in range(60):
        # Illinois variant of the secant method: the end that stays loses half its weight.
        x = low + (high - low) * low_rate / (low_rate - high_rate)
        exact(P, L, S, D, slot, 0, x, z)
        value = dot(P, rate, S, z, rows)
        if value * before > 0.0:
            low, low_rate, high_rate = x, value, 0.5 * high_rate
        else:
            high, high_rate, low_rate = x, value, 0.5 * low_rate
        if abs(value) <= 1e-9 * (abs(before) + abs(after)) or high - low <= 1e-12 * tau:
            break
    _widen(S, D, k, dot_column(P, output, tb.OUTPUT_ROWS, S, z, a))


@compiled
def _widen(S, D, k, value):
    lowest = D[st.EXTREMES] + 2 * k
    S[lowest] = min(S[lowest], value)
    S[lowest + 1] = max(S[lowest + 1], value)


@compiled
def _form_product(P, L, product, S, z):
    """Product of two linear forms that stand one after the other."""
    a, first, second = L[pg.A], 0.0, 0.0
    for j in range(a):
        first += P[product + j] * S[z + j]
        second += P[product + a + j] * S[z + j]
    return first * second


@compiled
def _collect_short(P, L, S, D, slot, tau):
    """Energies of a step shorter than the finest level, by Gauss-Legendre quadrature of its Taylor series."""
    block, z, a, own = block_of(L, slot), vector(L, D, SAMPLE), L[pg.A], L[pg.PRODUCTS]
    short, configuration = P[block + L[tb.STEPS] + L[slot_of(L, slot) + tb.FINEST_LEVEL]], D[st.CONFIGURATION]
    for q in range(len(NODES)):
        copy(S, 0, z, L[pg.ROWS])
        taylor(P, L, S, D, block, z, NODES[q] * tau, NODES[q] * tau / short)
        for p in range(own + L[pg.H]):
            category, weight = pg.HYSTERESIS, tau * WEIGHTS[q]
            if p < own:
                category = L[L[pg.PRODUCT_CATEGORY] + configuration * own + p]
                weight *= P[L[pg.PRODUCT_COEFFICIENT] + configuration * own + p]
            if category >= 0:
                S[D[st.ENERGY] + category] += weight * _form_product(P, L, block + L[tb.PRODUCTS] + 2 * p * a, S, z)


@compiled
def _full_step(P, L, S, D, slot, level):
    """Energies and sensitivities of a full step of one level from the state now."""
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    square, out = rows * columns, vector(L, D, FLOW)
    for e in range(D[st.ENERGIES]):
        multiply(P, block + L[tb.GRAMIAN] + (level * L[tb.LEDGER] + e) * square, rows, columns, S, 0, out)
        total = 0.0
        for i in range(rows):
            total += S[i] * S[out + i]
        S[D[st.ENERGY] + e] += total
    growth = block + L[tb.GROWTH] + level * square
    for s in range(D[st.SENSITIVITIES]):
        phi = D[st.PHI] + s * rows
        grow(P, growth, rows, columns, S, phi, out)
        copy(S, out, phi, rows)


@compiled
def account(P, L, S, D, slot, tau, level):
    """Energies and sensitivities of a motion by tau from the state now.

    `level` is the level of a full step, or NONE for any tau.
    """
    if level != NONE:
        _full_step(P, L, S, D, slot, level)
        return
    rows, columns, block = L[pg.ROWS], L[pg.COLUMNS], block_of(L, slot)
    finest, steps = L[slot_of(L, slot) + tb.FINEST_LEVEL], block + L[tb.STEPS]
    if D[st.ENERGIES] == 0:
        for s in range(D[st.SENSITIVITIES]):
            phi, out = D[st.PHI] + s * rows, vector(L, D, FLOW)
            exact(P, L, S, D, slot, phi, tau, out)
            copy(S, out, phi, rows)
        return
    rest, kept, out = tau, vector(L, D, KEPT), vector(L, D, FLOW)
    copy(S, 0, kept, rows)
    for k in range(finest + 1):
        if rest >= P[steps + k]:
            _full_step(P, L, S, D, slot, k)
            grow(P, block + L[tb.GROWTH] + k * rows * columns, rows, columns, S, 0, out)
            copy(S, out, 0, rows)
            rest -= P[steps + k]
    if rest > 0.0:
        _collect_short(P, L, S, D, slot, rest)
        for s in range(D[st.SENSITIVITIES]):
            taylor(P, L, S, D, block, D[st.PHI] + s * rows, rest, rest / P[steps + finest])
    copy(S, kept, 0, rows)
