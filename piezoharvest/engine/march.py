"""Exact motion within one linear mode, up to the next event: steps, location of events, records on the way."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine.algebra import dot
from piezoharvest.engine.compiled import compiled, compiled_sums
from piezoharvest.engine.state import COLUMNS, CONFIGURATION, NOW, SAMPLED
from piezoharvest.engine.tables import FINEST, FIRST, NODES, ORDER, WEIGHTS, quadratic

NONE = -1


@compiled_sums
def grow(growth, slot, level, z, out):
    """Apply exp(A h) of one level: out = z + growth z."""
    a = len(z)
    for i in range(a):
        total = z[i]
        for j in range(a):
            total += growth[slot, level, i, j] * z[j]
        out[i] = total


@compiled_sums
def taylor(matrix, slot, z, tau, share, term):
    """Advance z in place by tau, no longer than the finest level; `share` is tau over it, `term` scratch (2, a)."""
    a = len(z)
    for i in range(a):
        term[0, i] = z[i]
    bound = 1.0
    for k in range(1, ORDER + 1):
        # |A tau|^k / k! bounds what is still to come.
        bound *= FINEST * abs(share) / k
        source, target, factor = (k + 1) % 2, k % 2, tau / k
        for i in range(a):
            total = 0.0
            for j in range(a):
                total += matrix[slot, i, j] * term[source, j]
            total *= factor
            term[target, i] = total
            z[i] += total
        if bound < 1e-17:
            break


@compiled
def exact(matrix, growth, slot, finest, longest, z, tau, out, scratch):
    """Out = exp(A tau) z for any 0 <= tau <= longest step: binary digits of tau, then a Taylor series."""
    a = len(z)
    for i in range(a):
        out[i] = z[i]
    h, rest, before = longest, tau, scratch[0]
    for level in range(finest + 1):
        if rest >= h:
            for i in range(a):
                before[i] = out[i]
            grow(growth, slot, level, before, out)
            rest -= h
        h *= 0.5
    if rest > 0.0:
        taylor(matrix, slot, out, rest, 0.5 * rest / h, scratch)


@compiled_sums
def read_guards(guards, slot, sign, z, values):
    """Value, rate and second rate of every guard, in a row."""
    a = len(z)
    for r in range(len(values)):
        total = 0.0
        for j in range(a):
            total += guards[slot, r, j] * z[j]
        values[r] = sign[r // 3] * total


@compiled
def quintic(now, then, g, h):
    """Coefficients of the Hermite interpolation of a guard over a step: value, rate, second rate at both ends."""
    f0, d0, s0 = now[3 * g], now[3 * g + 1] * h, 0.5 * now[3 * g + 2] * h * h
    f1, d1, s1 = then[3 * g], then[3 * g + 1] * h, 0.5 * then[3 * g + 2] * h * h
    c3 = 10 * (f1 - f0) - 6 * d0 - 4 * d1 - 3 * s0 + s1
    c4 = -15 * (f1 - f0) + 8 * d0 + 7 * d1 + 3 * s0 - 2 * s1
    c5 = 6 * (f1 - f0) - 3 * d0 - 3 * d1 - s0 + s1
    return f0, d0, s0, c3, c4, c5


@compiled
def at(c, x):
    """Value of the interpolation at the fraction x of the step."""
    return c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))


@compiled
def crossing(now, then, floor, g, h):
    """Fractions (low, high) of a step between which a guard first rises through zero, and an estimate of where.

    low > high if it does not rise. What does not exceed `floor`, the rounding of the guard's terms, is no rise.
    """
    c, d0 = quintic(now, then, g, h), now[3 * g + 1]
    noise = 1e-13 * (abs(c[0]) + abs(then[3 * g]) + abs(c[1]) + h * abs(then[3 * g + 1])) + floor[g]
    low, before = 0.0, c[0]
    for k in range(1, 9):
        x = 0.125 * k
        value = at(c, x) if k < 8 else then[3 * g]
        if value > noise:
            if k == 1 and before > -noise:
                # It starts at zero: either it rises at once, or it first dips below.
                for _ in range(20):
                    inner = 0.5 * x
                    if at(c, inner) < -noise:
                        return inner, x, _root(c, inner, x)
                    x = inner
                return 0.0, 0.0, 0.0
            return low, x, _root(c, low, x)
        low, before = x, value
    if d0 > 0.0 and then[3 * g + 1] < 0.0:
        # It may rise and fall between two samples: look at the top.
        x = _root_of_rate(c)
        if at(c, x) > noise:
            return 0.0, x, _root(c, 0.0, x)
    return 1.0, 0.0, 0.0


@compiled
def _root_of_rate(c):
    """Where the interpolation has its top: bisection on its derivative, which falls through zero."""
    low, high = 0.0, 1.0
    for _ in range(30):
        x = 0.5 * (low + high)
        if c[1] + x * (2 * c[2] + x * (3 * c[3] + x * (4 * c[4] + x * 5 * c[5]))) > 0.0:
            low = x
        else:
            high = x
    return 0.5 * (low + high)


@compiled
def _root(c, low, high):
    """Where the interpolation rises through zero between low and high: safeguarded Newton."""
    x = 0.5 * (low + high)
    for _ in range(12):
        value = at(c, x)
        if value > 0.0:
            high = x
        else:
            low = x
        slope = c[1] + x * (2 * c[2] + x * (3 * c[3] + x * (4 * c[4] + x * 5 * c[5])))
        target = x - value / slope if slope > 0.0 else 0.5 * (low + high)
        if not low < target < high:
            target = 0.5 * (low + high)
        shift, x = target - x, target
        if abs(shift) < 1e-5:
            break
    return x


@compiled
def doubtful(now, then, g, h):
    """How much cubic and quintic interpolation of a guard differ within a step, and how far the guard is from zero.

    The even part of the difference is taken in the middle, the odd part by its slope there.
    """
    f0, d0, s0 = now[3 * g], now[3 * g + 1] * h, now[3 * g + 2] * h * h
    f1, d1, s1 = then[3 * g], then[3 * g + 1] * h, then[3 * g + 2] * h * h
    even = (d0 - d1) / 32 + (s0 + s1) / 64
    odd = 3 * (f1 - f0) / 32 - 3 * (d0 + d1) / 64 + (s1 - s0) / 128
    return max(abs(even), abs(odd)), max(abs(f0), abs(f1))


@compiled
def may_cross(now, then, floor, g, h):
    """Whether `crossing` has to look: the guard ends above zero, or rises and falls within the step."""
    f0, d0, f1, d1 = now[3 * g], now[3 * g + 1], then[3 * g], then[3 * g + 1]
    noise = 1e-13 * (abs(f0) + abs(f1) + h * (abs(d0) + abs(d1))) + floor[g]
    return f1 > noise or (d0 > 0.0 and d1 < 0.0)


@compiled
def locate(guards, matrix, growth, slot, finest, longest, z, guard, sign, low, high, tau, rises, out, scratch):
    """Time at which a guard rises through zero between low and high (s from z), from the estimate tau.

    Safeguarded Newton on the exact motion; leaves the state there in `out`. `rises` tells that the guard is known to be
    above zero at `high`; without that the time is infinite where it only comes close to zero.
    """
    value_row, rate_row = guards[slot, 3 * guard], guards[slot, 3 * guard + 1]
    short = longest * 0.5**finest
    exact(matrix, growth, slot, finest, longest, z, tau, out, scratch)
    for _ in range(80):
        value, rate = sign * dot(value_row, out), sign * dot(rate_row, out)
        if value > 0.0:
            high, rises = tau, True
        else:
            low = tau
        target = tau - value / rate if rate > 0.0 else 0.5 * (low + high)
        if not low <= target <= high:
            target = 0.5 * (low + high)
        shift = target - tau
        if abs(shift) <= short:
            taylor(matrix, slot, out, shift, shift / short, scratch)
        else:
            exact(matrix, growth, slot, finest, longest, z, target, out, scratch)
        tau = target
        # Newton's next step would be about the square of this one.
        if abs(shift) <= 1e-7 * short and rate > 0.0:
            return tau
        if high - low <= 1e-15 * longest:
            break
    return tau if rises else np.inf


@compiled
def _earliest(P, T, S, slot, step):
    """Guard that rises first within a step, and when; the state there is left in work[3]."""
    best, best_tau = NONE, np.inf
    now, then, floor, sign, z = S.guard_now, S.guard_next, S.guard_floor, S.sign, S.z
    guards, matrix, growth, finest, longest = T.guards, T.matrix, T.growth, T.finest[slot], P.step
    scratch, found, trial = S.work[1:3], S.work[3], S.work[4]
    for g in range(len(sign) - pg.WATCHED):
        if not may_cross(now, then, floor, g, step):
            continue
        low, high, guess = crossing(now, then, floor, g, step)
        if low > high or low * step > best_tau:
            continue
        tau = 0.0
        if high > 0.0:
            # The interpolation is not exact, but at the ends of the step the guard is known.
            if now[3 * g] <= 0.0:
                low = 0.0
            certain = then[3 * g] > 0.0
            if certain:
                high = 1.0
            tau = locate(guards, matrix, growth, slot, finest, longest, z, g, sign[g], low * step, high * step,
                         guess * step, certain, trial, scratch)  # fmt: skip
        else:
            trial[:] = z
        if tau < best_tau:
            best, best_tau = g, tau
            found[:] = trial
    # A guard that is above zero there has risen before, too briefly for its interpolation: diodes that begin to conduct
    # just before the extremum do so as a rule.
    for g in range(len(sign) - pg.WATCHED):
        if best == NONE or g == best or now[3 * g] > 0.0:
            continue
        value = sign[g] * dot(guards[slot, 3 * g], found)
        if value > floor[g] + 1e-12 * (abs(now[3 * g]) + step * abs(now[3 * g + 1])):
            tau = locate(guards, matrix, growth, slot, finest, longest, z, g, sign[g], 0.0, best_tau, 0.5 * best_tau,
                         True, trial, scratch)  # fmt: skip
            if tau < best_tau:
                best, best_tau = g, tau
                found[:] = trial
    return best, best_tau


@compiled
def _collect_short(P, S, T, slot, tau):
    """Energies of a step shorter than the finest level, by Gauss-Legendre quadrature of its Taylor series."""
    scratch, z, configuration = S.work[5:7], S.work[8], S.discrete[CONFIGURATION]
    count = P.product_category.shape[1]
    for q in range(len(NODES)):
        z[:] = S.z
        taylor(T.matrix, slot, z, NODES[q] * tau, 1.0, scratch)
        for p in range(T.products.shape[1]):
            category, weight = pg.HYSTERESIS, tau * WEIGHTS[q]
            if p < count:
                category = P.product_category[configuration, p]
                weight *= P.product_coefficient[configuration, p]
            if category >= 0:
                S.energy[category] += weight * dot(T.products[slot, p, 0], z) * dot(T.products[slot, p, 1], z)


@compiled
def _full_step(S, T, slot, level):
    """Energies and sensitivities of a full step of one level from the state now."""
    for e in range(len(S.energy)):
        S.energy[e] += quadratic(T.gramian[slot, level, e], S.z)
    for s in range(S.discrete[COLUMNS]):
        S.work[6] = S.phi[s]
        grow(T.growth, slot, level, S.work[6], S.phi[s])


@compiled
def account(P, T, S, slot, tau, level):
    """Energies and sensitivities of a motion by tau from the state now.

    `level` is the level of a full step, or NONE for any tau.
    """
    if level != NONE:
        _full_step(S, T, slot, level)
        return
    rest, h, kept = tau, P.step, S.work[7]
    kept[:] = S.z
    for k in range(T.finest[slot] + 1):
        if rest >= h:
            _full_step(S, T, slot, k)
            S.work[5] = S.z
            grow(T.growth, slot, k, S.work[5], S.z)
            rest -= h
        h *= 0.5
    if rest > 0.0:
        if len(S.energy):
            _collect_short(P, S, T, slot, rest)
        for s in range(S.discrete[COLUMNS]):
            taylor(T.matrix, slot, S.phi[s], rest, 1.0, S.work[5:7])
    S.z[:] = kept


@compiled
def observe(P, T, S, slot, tau, arrived):
    """Samples and extremes between the state now and the state `arrived`, tau later."""
    end = S.clock[NOW] + tau
    z, scratch = S.work[5], S.work[6:8]
    while S.discrete[SAMPLED] < len(S.sample_time) and S.sample_time[S.discrete[SAMPLED]] <= end:
        k = S.discrete[SAMPLED]
        into = min(max(S.sample_time[k] - S.clock[NOW], 0.0), tau)
        exact(T.matrix, T.growth, slot, T.finest[slot], P.step, S.z, into, z, scratch)
        for o in range(S.samples.shape[1]):
            S.samples[k, o] = dot(T.outputs[slot, o], z)
        S.discrete[SAMPLED] += 1
    for k in range(len(S.extremes)):
        row = T.outputs[slot, pg.DISPLACEMENT if k == 0 else pg.VOLTAGE]
        _widen(S, k, dot(row, S.z))
        _widen(S, k, dot(row, arrived))
        _turn(P, T, S, slot, tau, arrived, k, row)


@compiled
def _turn(P, T, S, slot, tau, arrived, k, row):
    """Widen the extremes by the turning point of an output within a step, where its rate changes sign."""
    z, scratch = S.work[5], S.work[6:8]
    rate = T.guards[slot, T.guards.shape[1] - 3 * (pg.WATCHED - k)]
    before, after = dot(rate, S.z), dot(rate, arrived)
    if not before * after < 0.0:
        return
    low, high, low_rate, high_rate = 0.0, tau, before, after
    for _ in range(60):
        # Illinois variant of the secant method: the end that stays loses half its weight.
        x = low + (high - low) * low_rate / (low_rate - high_rate)
        exact(T.matrix, T.growth, slot, T.finest[slot], P.step, S.z, x, z, scratch)
        value = dot(rate, z)
        if value * before > 0.0:
            low, low_rate, high_rate = x, value, 0.5 * high_rate
        else:
            high, high_rate, low_rate = x, value, 0.5 * low_rate
        if abs(value) <= 1e-9 * (abs(before) + abs(after)) or high - low <= 1e-12 * tau:
            break
    _widen(S, k, dot(row, z))


@compiled
def _widen(S, k, value):
    S.extremes[k, 0] = min(S.extremes[k, 0], value)
    S.extremes[k, 1] = max(S.extremes[k, 1], value)


@compiled
def march(P, T, S, slot, t_stop):
    """Move within a mode until t_stop or until a guard rises through zero, and return that guard, or NONE.

    The step begins where the fastest motion of the mode is resolved and doubles for as long as every guard is smooth
    over it, so that a transient that has died out costs nothing.
    """
    # Taken out of the records once: every look into one counts references, which costs as much as the arithmetic.
    guards, growth, matrix, sign, z, clock = T.guards, T.growth, T.matrix, S.sign, S.z, S.clock
    now, then, arrived, scratch, found = S.guard_now, S.guard_next, S.work[0], S.work[1:3], S.work[3]
    a, finest, longest = len(z), T.finest[slot], P.step
    events = len(sign) - pg.WATCHED
    count = len(sign) if len(S.extremes) else events
    level = max(finest - FIRST, 0)
    watching = len(S.sample_time) > 0 or len(S.extremes) > 0
    recording = watching or len(S.energy) > 0 or S.discrete[COLUMNS] > 0
    read_guards(guards, slot, sign, z, now)
    size, floor = 0.0, S.guard_floor
    for i in range(a):
        size += abs(z[i])
    for g in range(count):
        floor[g] = 1e-13 * size * T.guard_size[slot, 3 * g]
    while True:
        left = t_stop - clock[NOW]
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
            taylor(matrix, slot, arrived, step, 1.0, scratch)
        read_guards(guards, slot, sign, arrived, then)
        rises, too_long, doubling = False, False, True
        for g in range(count):
            doubt, size = doubtful(now, then, g, step)
            if g < events:
                rises |= may_cross(now, then, floor, g, step)
            else:
                size += 1e4 * floor[g]
            too_long |= doubt > 0.05 * size
            doubling &= doubt <= 0.005 * size
        if too_long and level < finest and full:
            level += 1
            continue
        guard, tau, target = NONE, step, arrived
        if rises:
            guard, tau = _earliest(P, T, S, slot, step)
            if guard != NONE:
                target = found
            else:
                tau = step
        if recording:
            if watching:
                observe(P, T, S, slot, tau, target)
            account(P, T, S, slot, tau, level if full and guard == NONE else NONE)
        for i in range(a):
            z[i] = target[i]
        clock[NOW] += tau
        if guard != NONE or not full:
            return guard
        for r in range(3 * count):
            now[r] = then[r]
        if doubling and level > 0:
            level -= 1
