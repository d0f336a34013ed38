"""Exact motion within one linear mode, up to the next event: steps, location of events, records on the way."""

from __future__ import annotations

import numpy as np
from numba import njit

from piezoharvest.engine.state import NOW, SAMPLED, STEPS
from piezoharvest.engine.tables import NODES, ORDER, WEIGHTS

NONE = -1
TINY = 1e-12  # a guard this small, relative to its terms, is zero


@njit(cache=True, fastmath={"reassoc", "contract"})
def grow(growth, z, out):
    """Apply exp(A h): out = z + growth z."""
    a = len(z)
    for i in range(a):
        total = z[i]
        for j in range(a):
            total += growth[i, j] * z[j]
        out[i] = total


@njit(cache=True, fastmath={"reassoc", "contract"})
def dot(row, z):
    """Linear form of the state."""
    total = 0.0
    for j in range(len(z)):
        total += row[j] * z[j]
    return total


@njit(cache=True, fastmath={"reassoc", "contract"})
def taylor(matrix, z, tau, term):
    """Advance z by a step so short that |A| tau <= 1/2, in place; `term` is scratch of shape (2, a)."""
    a = len(z)
    term[0, :a] = z
    for k in range(1, ORDER + 1):
        source, target = (k + 1) % 2, k % 2
        largest = 0.0
        for i in range(a):
            total = 0.0
            for j in range(a):
                total += matrix[i, j] * term[source, j]
            total *= tau / k
            term[target, i] = total
            z[i] += total
            largest = max(largest, abs(total))
        if largest == 0.0:
            break


@njit(cache=True)
def exact(P, T, slot, z, tau, out, scratch):
    """out = exp(A tau) z for any 0 <= tau <= step: binary digits of tau, then a Taylor series."""
    matrix, growth = T.matrix[slot], T.growth[slot]
    out[:] = z
    h = P.step
    rest = tau
    for level in range(T.finest[slot] + 1):
        if rest >= h:
            scratch[0] = out
            grow(growth[level], scratch[0], out)
            rest -= h
        h *= 0.5
    if rest > 0.0:
        taylor(matrix, out, rest, scratch)


@njit(cache=True)
def read_guards(T, slot, z, direction, trigger, values):
    """Value, rate and second rate of every guard; the extremum's guard is signed by the direction of motion."""
    rows = T.guards[slot]
    for g in range(rows.shape[0]):
        sign = -1.0 * direction if g == trigger else 1.0
        for k in range(3):
            values[g, k] = sign * dot(rows[g, k], z)


@njit(cache=True)
def quintic(f0, d0, s0, f1, d1, s1, h, x):
    """Hermite interpolation of value, rate and second rate at both ends of a step, at the fraction x of it."""
    d0, d1, s0, s1 = d0 * h, d1 * h, 0.5 * s0 * h * h, 0.5 * s1 * h * h
    c3 = 10 * (f1 - f0) - 6 * d0 - 4 * d1 - 3 * s0 + s1
    c4 = -15 * (f1 - f0) + 8 * d0 + 7 * d1 + 3 * s0 - 2 * s1
    c5 = 6 * (f1 - f0) - 3 * d0 - 3 * d1 - s0 + s1
    return f0 + x * (d0 + x * (s0 + x * (c3 + x * (c4 + x * c5))))


@njit(cache=True)
def crossing(now, then, h):
    """Fractions (low, high) of a step between which a guard first rises through zero; low > high if it does not."""
    f0, d0, s0, f1, d1, s1 = now[0], now[1], now[2], then[0], then[1], then[2]
    noise = 1e-13 * (abs(f0) + abs(f1) + h * (abs(d0) + abs(d1)))
    if f1 <= noise and not (d0 > 0.0 and d1 < 0.0):
        return 1.0, 0.0
    low, before = 0.0, f0
    for k in range(1, 9):
        x = 0.125 * k
        value = quintic(f0, d0, s0, f1, d1, s1, h, x) if k < 8 else f1
        if value > noise:
            if k == 1 and before > -noise:
                # It starts at zero: either it rises at once, or it first dips below.
                for _ in range(20):
                    x_in = 0.5 * x
                    dip = quintic(f0, d0, s0, f1, d1, s1, h, x_in)
                    if dip < -noise:
                        return x_in, x
                    x = x_in
                return 0.0, 0.0
            return low, x
        low, before = x, value
    return 1.0, 0.0


@njit(cache=True)
def rough(now, then, h):
    """Whether a step is too long for a guard to be followed by its interpolation, and whether it could be doubled."""
    d = h * (now[1] - then[1]) / 32 + h * h * (now[2] + then[2]) / 64
    size = max(abs(now[0]), abs(then[0]))
    return abs(d) > 0.3 * size, abs(d) <= 0.02 * size


@njit(cache=True)
def locate(P, T, slot, z, guard, sign, low, high, out, scratch):
    """Time at which a guard rises through zero between low and high (s from z): safeguarded Newton on the exact motion.

    Leaves the state there in `out`.
    """
    value_row, rate_row = T.guards[slot, guard, 0], T.guards[slot, guard, 1]
    tau = 0.5 * (low + high)
    short = 0.5 * P.step * 0.5 ** T.finest[slot]
    exact(P, T, slot, z, tau, out, scratch)
    for _ in range(80):
        value, rate = sign * dot(value_row, out), sign * dot(rate_row, out)
        if value > 0.0:
            high = tau
        else:
            low = tau
        target = tau - value / rate if rate > 0.0 else 0.5 * (low + high)
        if not low <= target <= high:
            target = 0.5 * (low + high)
        shift = target - tau
        if abs(shift) < 1e-4 * short and tau + shift >= 0.0:
            taylor(T.matrix[slot], out, shift, scratch)
        else:
            exact(P, T, slot, z, target, out, scratch)
        tau = target
        if abs(shift) <= 1e-15 * P.step or high - low <= 1e-15 * P.step:
            break
    return tau


@njit(cache=True)
def _spread(growth, phi, scratch):
    """Advance the sensitivities by one step."""
    for s in range(phi.shape[1]):
        scratch[0] = phi[:, s]
        grow(growth, scratch[0], scratch[1])
        phi[:, s] = scratch[1]


@njit(cache=True)
def _collect(S, T, slot, level):
    """Energies of a full step of one level from the state now."""
    for e in range(len(S.energy)):
        total = 0.0
        for i in range(len(S.z)):
            total += S.z[i] * dot(T.gramian[slot, level, e, i], S.z)
        S.energy[e] += total


@njit(cache=True)
def _collect_short(P, S, T, slot, tau):
    """Energies of a step shorter than the finest level, by Gauss-Legendre quadrature of its Taylor series."""
    scratch, z = S.work[6:8], S.work[5]
    configuration = S.discrete[0]
    count = P.product_category.shape[1]
    for q in range(len(NODES)):
        z[:] = S.z
        taylor(T.matrix[slot], z, NODES[q] * tau, scratch)
        for p in range(T.products.shape[1]):
            category = P.product_category[configuration, p] if p < count else 2
            if category >= 0:
                weight = P.product_coefficient[configuration, p] if p < count else 1.0
                power = weight * dot(T.products[slot, p, 0], z) * dot(T.products[slot, p, 1], z)
                S.energy[category] += tau * WEIGHTS[q] * power


@njit(cache=True)
def commit(P, T, S, slot, tau, level, arrived):
    """Move on by tau to the state `arrived`, energies and sensitivities included.

    `level` is the level of a full step, or NONE for any tau.
    """
    if level != NONE:
        if len(S.energy):
            _collect(S, T, slot, level)
        if S.phi.shape[1]:
            _spread(T.growth[slot, level], S.phi, S.work[6:8])
    elif len(S.energy) or S.phi.shape[1]:
        rest, h = tau, P.step
        for k in range(T.finest[slot] + 1):
            if rest >= h:
                if len(S.energy):
                    _collect(S, T, slot, k)
                if S.phi.shape[1]:
                    _spread(T.growth[slot, k], S.phi, S.work[6:8])
                S.work[5] = S.z
                grow(T.growth[slot, k], S.work[5], S.z)
                rest -= h
            h *= 0.5
        if rest > 0.0:
            if len(S.energy):
                _collect_short(P, S, T, slot, rest)
            for s in range(S.phi.shape[1]):
                S.work[5] = S.phi[:, s]
                taylor(T.matrix[slot], S.work[5], rest, S.work[6:8])
                S.phi[:, s] = S.work[5]
    S.z[:] = arrived
    S.clock[NOW] += tau
    S.discrete[STEPS] += 1


@njit(cache=True)
def observe(P, T, S, slot, tau, arrived):
    """Samples and extremes between the state now and the state `arrived`, tau later."""
    end = S.clock[NOW] + tau
    z, scratch = S.work[5], S.work[6:8]
    while S.discrete[SAMPLED] < len(S.sample_time) and S.sample_time[S.discrete[SAMPLED]] <= end:
        k = S.discrete[SAMPLED]
        exact(P, T, slot, S.z, min(max(S.sample_time[k] - S.clock[NOW], 0.0), tau), z, scratch)
        for o in range(S.samples.shape[1]):
            S.samples[k, o] = dot(T.outputs[slot, o], z)
        S.discrete[SAMPLED] += 1
    for k in range(len(S.extremes)):
        row = T.outputs[slot, 1 if k == 0 else 3]
        _widen(S, k, dot(row, S.z))
        _widen(S, k, dot(row, arrived))
        rate = row @ T.matrix[slot]
        second = rate @ T.matrix[slot]
        before, after = dot(rate, S.z), dot(rate, arrived)
        if before * after < 0.0:
            low, high = 0.0, tau
            x = tau * before / (before - after)
            for _ in range(60):
                exact(P, T, slot, S.z, x, z, scratch)
                value, slope = dot(rate, z), dot(second, z)
                if value * before > 0.0:
                    low = x
                else:
                    high = x
                x_new = x - value / slope if slope != 0.0 else 0.5 * (low + high)
                if not low <= x_new <= high:
                    x_new = 0.5 * (low + high)
                close = abs(x_new - x) <= 1e-9 * tau
                x = x_new
                if close:
                    break
            exact(P, T, slot, S.z, x, z, scratch)
            _widen(S, k, dot(row, z))


@njit(cache=True)
def _widen(S, k, value):
    S.extremes[k, 0] = min(S.extremes[k, 0], value)
    S.extremes[k, 1] = max(S.extremes[k, 1], value)


@njit(cache=True)
def march(P, T, S, slot, t_stop):
    """Move within a mode until t_stop or until a guard rises through zero, and return that guard, or NONE.

    The step begins where the fastest motion of the mode is resolved and doubles for as long as every guard is smooth
    over it, so that a transient that has died out costs nothing.
    """
    trigger = P.guard_target.shape[1]
    direction = S.discrete[1]
    now, then = S.guard_now, S.guard_next
    arrived, scratch = S.work[0], S.work[1:3]
    finest = T.finest[slot]
    level = finest
    watching = len(S.sample_time) > 0 or len(S.extremes) > 0
    read_guards(T, slot, S.z, direction, trigger, now)
    while True:
        left = t_stop - S.clock[NOW]
        if left <= 0.0:
            return NONE
        step = P.step * 0.5**level
        while step > left and level < finest:
            level += 1
            step *= 0.5
        full = step <= left
        if full:
            grow(T.growth[slot, level], S.z, arrived)
        else:
            step = left
            arrived[:] = S.z
            taylor(T.matrix[slot], arrived, step, scratch)
        read_guards(T, slot, arrived, direction, trigger, then)
        rises, too_long, doubling = False, False, True
        for g in range(now.shape[0]):
            coarse, smooth = rough(now[g], then[g], step)
            low, high = crossing(now[g], then[g], step)
            too_long |= coarse and level < finest and full
            doubling &= smooth
            rises |= low <= high
        if too_long:
            level += 1
            continue
        if rises:
            guard, tau = _earliest(P, T, S, slot, step, now, then, direction, trigger)
            if watching:
                observe(P, T, S, slot, tau, S.work[3])
            commit(P, T, S, slot, tau, NONE, S.work[3])
            return guard
        if watching:
            observe(P, T, S, slot, step, arrived)
        commit(P, T, S, slot, step, level if full else NONE, arrived)
        now[:] = then
        if not full:
            return NONE
        if doubling and level > 0:
            level -= 1


@njit(cache=True)
def _earliest(P, T, S, slot, step, now, then, direction, trigger):
    """Guard that rises first within a step, and when; the state there is left in work[3]."""
    best, best_tau = NONE, np.inf
    for g in range(now.shape[0]):
        low, high = crossing(now[g], then[g], step)
        if low > high or low * step > best_tau:
            continue
        sign = -1.0 * direction if g == trigger else 1.0
        tau = 0.0
        if high > 0.0:
            tau = locate(P, T, slot, S.z, g, sign, low * step, high * step, S.work[4], S.work[1:3])
        else:
            S.work[4][:] = S.z
        if tau < best_tau:
            best, best_tau = g, tau
            S.work[3][:] = S.work[4]
    return best, best_tau
