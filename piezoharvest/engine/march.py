"""Exact motion within one linear mode, up to the next event: steps, location of events, records on the way."""

from __future__ import annotations

import numpy as np
from numba import njit

from piezoharvest.engine import program as pg
from piezoharvest.engine.algebra import dot
from piezoharvest.engine.state import COLUMNS, CONFIGURATION, NOW, SAMPLED, STEPS
from piezoharvest.engine.tables import FIRST, NODES, ORDER, WEIGHTS, quadratic

NONE = -1
_FAST = {"reassoc", "contract"}  # sums may be reordered, so that they run in vector registers


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def grow(growth, slot, level, z, out):
    """Apply exp(A h) of one level: out = z + growth z."""
    a = len(z)
    for i in range(a):
        total = z[i]
        for j in range(a):
            total += growth[slot, level, i, j] * z[j]
        out[i] = total


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def taylor(matrix, z, tau, term):
    """Advance z in place by a step no longer than the finest level; `term` is scratch of shape (2, a)."""
    a = len(z)
    for i in range(a):
        term[0, i] = z[i]
    for k in range(1, ORDER + 1):
        source, target = (k + 1) % 2, k % 2
        change, size = 0.0, 0.0
        for i in range(a):
            total = 0.0
            for j in range(a):
                total += matrix[i, j] * term[source, j]
            total *= tau / k
            term[target, i] = total
            z[i] += total
            change = max(change, abs(total))
            size = max(size, abs(z[i]))
        if change <= 1e-18 * size:
            break


@njit(cache=True, error_model="numpy")
def exact(T, slot, longest, z, tau, out, scratch):
    """out = exp(A tau) z for any 0 <= tau <= longest step: binary digits of tau, then a Taylor series."""
    out[:] = z
    h, rest = longest, tau
    for level in range(T.finest[slot] + 1):
        if rest >= h:
            scratch[0] = out
            grow(T.growth, slot, level, scratch[0], out)
            rest -= h
        h *= 0.5
    if rest > 0.0:
        taylor(T.matrix[slot], out, rest, scratch)


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def read_guards(guards, slot, sign, z, values):
    """Value, rate and second rate of every guard, in a row."""
    a = len(z)
    for r in range(len(values)):
        total = 0.0
        for j in range(a):
            total += guards[slot, r, j] * z[j]
        values[r] = sign[r // 3] * total


@njit(cache=True, error_model="numpy")
def quintic(now, then, g, h, x):
    """Hermite interpolation of a guard from value, rate and second rate at both ends of a step, at the fraction x."""
    f0, d0, s0 = now[3 * g], now[3 * g + 1] * h, 0.5 * now[3 * g + 2] * h * h
    f1, d1, s1 = then[3 * g], then[3 * g + 1] * h, 0.5 * then[3 * g + 2] * h * h
    c3 = 10 * (f1 - f0) - 6 * d0 - 4 * d1 - 3 * s0 + s1
    c4 = -15 * (f1 - f0) + 8 * d0 + 7 * d1 + 3 * s0 - 2 * s1
    c5 = 6 * (f1 - f0) - 3 * d0 - 3 * d1 - s0 + s1
    return f0 + x * (d0 + x * (s0 + x * (c3 + x * (c4 + x * c5))))


@njit(cache=True, error_model="numpy")
def crossing(now, then, g, h):
    """Fractions (low, high) of a step between which a guard first rises through zero; low > high if it does not."""
    f0, d0, f1, d1 = now[3 * g], now[3 * g + 1], then[3 * g], then[3 * g + 1]
    noise = 1e-13 * (abs(f0) + abs(f1) + h * (abs(d0) + abs(d1)))
    low, before = 0.0, f0
    for k in range(1, 9):
        x = 0.125 * k
        value = quintic(now, then, g, h, x) if k < 8 else f1
        if value > noise:
            if k == 1 and before > -noise:
                # It starts at zero: either it rises at once, or it first dips below.
                for _ in range(20):
                    inner = 0.5 * x
                    if quintic(now, then, g, h, inner) < -noise:
                        return inner, x
                    x = inner
                return 0.0, 0.0
            return low, x
        low, before = x, value
    return 1.0, 0.0


@njit(cache=True, error_model="numpy")
def may_cross(now, then, g, h):
    """Whether `crossing` has to look: the guard ends above zero, or rises and falls within the step."""
    f0, d0, f1, d1 = now[3 * g], now[3 * g + 1], then[3 * g], then[3 * g + 1]
    return f1 > 1e-13 * (abs(f0) + abs(f1) + h * (abs(d0) + abs(d1))) or (d0 > 0.0 and d1 < 0.0)


@njit(cache=True, error_model="numpy")
def interpolated_root(now, then, g, h, low, high):
    """Fraction of a step at which the interpolated guard rises through zero, between low and high."""
    x, slope_step = 0.5 * (low + high), 1e-6
    for _ in range(8):
        value = quintic(now, then, g, h, x)
        if value > 0.0:
            high = x
        else:
            low = x
        slope = (quintic(now, then, g, h, x + slope_step) - value) / slope_step
        target = x - value / slope if slope > 0.0 else 0.5 * (low + high)
        if not low < target < high:
            target = 0.5 * (low + high)
        done = abs(target - x) < 1e-9
        x = target
        if done:
            break
    return x


@njit(cache=True, error_model="numpy")
def locate(P, T, slot, z, guard, sign, low, high, tau, out, scratch):
    """Time at which a guard rises through zero between low and high (s from z), from the estimate tau.

    Safeguarded Newton on the exact motion; leaves the state there in `out`.
    """
    value_row, rate_row, matrix = T.guards[slot, 3 * guard], T.guards[slot, 3 * guard + 1], T.matrix[slot]
    finest = P.step * 0.5 ** T.finest[slot]
    exact(T, slot, P.step, z, tau, out, scratch)
    for _ in range(80):
        value, rate = sign * dot(value_row, out), sign * dot(rate_row, out)
        if value > 0.0:
            high = min(high, tau)
        else:
            low = max(low, tau)
        # The interpolation that gave the bracket is not exact: a Newton step may leave it by a little.
        slack = 1e-3 * (high - low)
        target = tau - value / rate if rate > 0.0 else 0.5 * (low + high)
        if not max(low - slack, 0.0) <= target <= high + slack:
            target = 0.5 * (low + high)
        shift = target - tau
        if abs(shift) <= finest:
            taylor(matrix, out, shift, scratch)
        else:
            exact(T, slot, P.step, z, target, out, scratch)
        tau = target
        # Newton's next step would be about the square of this one.
        if abs(shift) <= 1e-9 * finest or high - low <= 1e-15 * P.step:
            break
    return tau


@njit(cache=True, error_model="numpy")
def _earliest(P, T, S, slot, step):
    """Guard that rises first within a step, and when; the state there is left in work[3]."""
    best, best_tau = NONE, np.inf
    now, then = S.guard_now, S.guard_next
    for g in range(len(S.sign)):
        if not may_cross(now, then, g, step):
            continue
        low, high = crossing(now, then, g, step)
        if low > high or low * step > best_tau:
            continue
        tau = 0.0
        if high > 0.0:
            guess = step * interpolated_root(now, then, g, step, low, high)
            tau = locate(P, T, slot, S.z, g, S.sign[g], low * step, high * step, guess, S.work[4], S.work[1:3])
        else:
            S.work[4] = S.z
        if tau < best_tau:
            best, best_tau = g, tau
            S.work[3] = S.work[4]
    return best, best_tau


@njit(cache=True, error_model="numpy")
def _collect_short(P, S, T, slot, tau):
    """Energies of a step shorter than the finest level, by Gauss-Legendre quadrature of its Taylor series."""
    scratch, z, configuration = S.work[6:8], S.work[5], S.discrete[CONFIGURATION]
    count = P.product_category.shape[1]
    for q in range(len(NODES)):
        z[:] = S.z
        taylor(T.matrix[slot], z, NODES[q] * tau, scratch)
        for p in range(T.products.shape[1]):
            category, weight = pg.HYSTERESIS, tau * WEIGHTS[q]
            if p < count:
                category = P.product_category[configuration, p]
                weight *= P.product_coefficient[configuration, p]
            if category >= 0:
                S.energy[category] += weight * dot(T.products[slot, p, 0], z) * dot(T.products[slot, p, 1], z)


@njit(cache=True, error_model="numpy")
def _account(S, T, slot, level):
    """Energies and sensitivities of a full step of one level from the state now."""
    for e in range(len(S.energy)):
        S.energy[e] += quadratic(T.gramian[slot, level, e], S.z)
    for s in range(S.discrete[COLUMNS]):
        S.work[6] = S.phi[s]
        grow(T.growth, slot, level, S.work[6], S.phi[s])


@njit(cache=True, error_model="numpy")
def commit(P, T, S, slot, tau, level, arrived):
    """Move on by tau to the state `arrived`, energies and sensitivities included.

    `level` is the level of a full step, or NONE for any tau.
    """
    if len(S.energy) or S.discrete[COLUMNS]:
        if level != NONE:
            _account(S, T, slot, level)
        else:
            rest, h = tau, P.step
            for k in range(T.finest[slot] + 1):
                if rest >= h:
                    _account(S, T, slot, k)
                    S.work[5] = S.z
                    grow(T.growth, slot, k, S.work[5], S.z)
                    rest -= h
                h *= 0.5
            if rest > 0.0:
                if len(S.energy):
                    _collect_short(P, S, T, slot, rest)
                for s in range(S.discrete[COLUMNS]):
                    taylor(T.matrix[slot], S.phi[s], rest, S.work[6:8])
    S.z[:] = arrived
    S.clock[NOW] += tau
    S.discrete[STEPS] += 1


@njit(cache=True, error_model="numpy")
def observe(P, T, S, slot, tau, arrived):
    """Samples and extremes between the state now and the state `arrived`, tau later."""
    end = S.clock[NOW] + tau
    z, scratch = S.work[5], S.work[6:8]
    while S.discrete[SAMPLED] < len(S.sample_time) and S.sample_time[S.discrete[SAMPLED]] <= end:
        k = S.discrete[SAMPLED]
        exact(T, slot, P.step, S.z, min(max(S.sample_time[k] - S.clock[NOW], 0.0), tau), z, scratch)
        for o in range(S.samples.shape[1]):
            S.samples[k, o] = dot(T.outputs[slot, o], z)
        S.discrete[SAMPLED] += 1
    for k in range(len(S.extremes)):
        row = T.outputs[slot, pg.DISPLACEMENT if k == 0 else pg.VOLTAGE]
        _widen(S, k, dot(row, S.z))
        _widen(S, k, dot(row, arrived))
        _turn(P, T, S, slot, tau, arrived, k, row)


@njit(cache=True, error_model="numpy")
def _turn(P, T, S, slot, tau, arrived, k, row):
    """Widen the extremes by the turning point of an output within a step."""
    z, scratch, rate = S.work[5], S.work[6:8], S.work[8]
    matrix, a = T.matrix[slot], len(S.z)
    for j in range(a):
        rate[j] = 0.0
        for i in range(a):
            rate[j] += row[i] * matrix[i, j]
    before, after = dot(rate, S.z), dot(rate, arrived)
    if not before * after < 0.0:
        return
    low, high, low_rate, high_rate = 0.0, tau, before, after
    x = tau * before / (before - after)
    for _ in range(60):
        exact(T, slot, P.step, S.z, x, z, scratch)
        value = dot(rate, z)
        # Illinois variant of the secant method: the end that stays loses half its weight.
        if value * before > 0.0:
            low, low_rate, high_rate = x, value, 0.5 * high_rate
        else:
            high, high_rate, low_rate = x, value, 0.5 * low_rate
        if abs(value) <= 1e-12 * (abs(before) + abs(after)) or high - low <= 1e-13 * tau:
            break
        x = low + (high - low) * low_rate / (low_rate - high_rate)
    _widen(S, k, dot(row, z))


@njit(cache=True, error_model="numpy")
def _widen(S, k, value):
    S.extremes[k, 0] = min(S.extremes[k, 0], value)
    S.extremes[k, 1] = max(S.extremes[k, 1], value)


@njit(cache=True, error_model="numpy")
def march(P, T, S, slot, t_stop):
    """Move within a mode until t_stop or until a guard rises through zero, and return that guard, or NONE.

    The step begins where the fastest motion of the mode is resolved and doubles for as long as every guard is smooth
    over it, so that a transient that has died out costs nothing.
    """
    guards, growth, sign = T.guards, T.growth, S.sign
    now, then, arrived, z = S.guard_now, S.guard_next, S.work[0], S.z
    count, finest, longest = len(sign), T.finest[slot], P.step
    level = max(finest - FIRST, 0)
    watching = len(S.sample_time) > 0 or len(S.extremes) > 0
    read_guards(guards, slot, sign, z, now)
    while True:
        left = t_stop - S.clock[NOW]
        if left <= 0.0:
            return NONE
        step = longest * 0.5**level
        while step > left and level < finest:
            level += 1
            step *= 0.5
        full = step <= left
        if full:
            grow(growth, slot, level, z, arrived)
        else:
            step = left
            arrived[:] = z
            taylor(T.matrix[slot], arrived, step, S.work[1:3])
        read_guards(guards, slot, sign, arrived, then)
        rises, too_long, doubling = False, False, True
        for g in range(count):
            # Cubic and quintic interpolation differ by this in the middle of the step.
            doubt = step * (now[3 * g + 1] - then[3 * g + 1]) / 32 + step * step * (now[3 * g + 2] + then[3 * g + 2]) / 64
            size = max(abs(now[3 * g]), abs(then[3 * g]))
            too_long |= abs(doubt) > 0.3 * size
            doubling &= abs(doubt) <= 0.02 * size
            rises |= may_cross(now, then, g, step)
        if too_long and level < finest and full:
            level += 1
            continue
        if rises:
            guard, tau = _earliest(P, T, S, slot, step)
            if guard != NONE:
                if watching:
                    observe(P, T, S, slot, tau, S.work[3])
                commit(P, T, S, slot, tau, NONE, S.work[3])
                return guard
        if watching:
            observe(P, T, S, slot, step, arrived)
        commit(P, T, S, slot, step, level if full else NONE, arrived)
        if not full:
            return NONE
        for r in range(3 * count):
            now[r] = then[r]
        if doubling and level > 0:
            level -= 1
