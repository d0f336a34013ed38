"""Hermite interpolation of guards between the ends of a step: its error, and estimates of zero crossings."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled

# Error of a maximum, relative to the rise and fall in a step; the longest steps keep it below 1e-4.
MAXIMUM_ERROR = 1e-3


@compiled
def quintic(f0, d0, s0, f1, d1, s1, h):
    """Coefficients of the quintic over a step of length h with given value, rate and second rate at both ends."""
    d0, d1, s0, s1 = d0 * h, d1 * h, 0.5 * s0 * h * h, 0.5 * s1 * h * h
    rise = f1 - f0
    c3 = 10 * rise - 6 * d0 - 4 * d1 - 3 * s0 + s1
    c4 = -15 * rise + 8 * d0 + 7 * d1 + 3 * s0 - 2 * s1
    c5 = 6 * rise - 3 * d0 - 3 * d1 - s0 + s1
    return f0, d0, s0, c3, c4, c5


@compiled
def at(c, x):
    """Value of the interpolation at the fraction x of the step."""
    return c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))


@compiled
def slope(c, x):
    """Derivative of the interpolation at the fraction x of the step."""
    return c[1] + x * (2 * c[2] + x * (3 * c[3] + x * (4 * c[4] + x * 5 * c[5])))


@compiled
def interpolation_error(f0, d0, s0, f1, d1, s1, h):
    """Difference of cubic and quintic interpolation within a step, a measure of the error.

    The even part of the difference is taken in the middle, the odd part by its slope there.
    """
    even = h * ((d0 - d1) / 32 + h * (s0 + s1) / 64)
    odd = 3 * (f1 - f0) / 32 - h * (3 * (d0 + d1) / 64 - h * (s1 - s0) / 128)
    return max(abs(even), abs(odd))


@compiled
def crossing(c, noise, rising, falls):
    """Fractions (low, high) of a step between which a guard first crosses zero upwards, and an estimate.

    low > high if it does not cross. A rise that does not exceed `noise` does not count. `rising`: the guard ends above
    zero and rises at both ends, so that it crosses once; `falls`: it may be above zero in between (`may_peak`). If its
    maximum is too near to zero to decide, low is -1 and high is the place of the maximum.
    """
    if c[0] < -noise and rising:
        return 0.0, 1.0, bracketed_zero(c, 0.0, 1.0, inverse_zero(c))
    low, before = 0.0, c[0]
    end = c[0] + c[1] + c[2] + c[3] + c[4] + c[5]
    if falls and before < -noise and end <= noise:
        return _crossing_at_maximum(c, noise, end)
    for k in range(1, 9):
        x = 0.125 * k
        value = at(c, x) if k < 8 else end
        if value > noise:
            if k == 1 and before > -noise:
                # It starts at zero: either it rises immediately, or it first falls below zero, perhaps by less than the
                # noise.
                deep = 0.0 if c[1] < 0.0 else -noise
                for _ in range(20):
                    inner = 0.5 * x
                    if at(c, inner) < deep:
                        return inner, x, bracketed_zero(c, inner, x, secant_zero(c, inner, x))
                    x = inner
                return 0.0, 0.0, 0.0
            return low, x, bracketed_zero(c, low, x, secant_zero(c, low, x))
        low, before = x, value
    return _crossing_at_maximum(c, noise, end) if falls else (1.0, 0.0, 0.0)


@compiled
def _crossing_at_maximum(c, noise, end):
    """As `crossing`, for a guard below zero at both ends that rises, then falls."""
    x = maximum(c)
    highest = at(c, x)
    if highest > noise:
        return 0.0, x, bracketed_zero(c, 0.0, x, secant_zero(c, 0.0, x))
    if highest > -MAXIMUM_ERROR * (abs(c[0]) + abs(end)):
        return -1.0, x, x
    return 1.0, 0.0, 0.0


@compiled
def may_peak(f0, d0, s0, f1, d1, s1, h, noise):
    """True if a function that rises at the beginning of a step and falls at its end may be above zero between.

    A concave function stays below its tangents, which meet between the ends. Without branches, so that the compiler can
    vectorise it.
    """
    meet = (f0 - noise) * (d0 - d1) + d0 * (f1 - f0 - h * d1)
    return (d0 > 0.0) & (d1 < 0.0) & ((meet > 0.0) | (s0 > 0.0) | (s1 > 0.0))


@compiled
def may_have_two_extrema(f0, d0, f1, d1, h, highest, noise):
    """True if a function with rates of one sign at both ends of a step may have two extrema between them, near zero.

    A cubic that begins and ends with such rates is monotone where none is above three times the mean one (Fritsch &
    Carlson, SIAM J. Numer. Anal. 17, 238-246, 1980), and rises above its ends by 4/27 of a rate times the step at most;
    twice that is allowed for here. `highest` is the larger of its ends, in the sense in which zero is above them.
    """
    rise, steep = f1 - f0, h * max(abs(d0), abs(d1))
    up = (d0 > 0.0) & (d1 > 0.0) & (3.0 * rise < steep)
    down = (d0 < 0.0) & (d1 < 0.0) & (-3.0 * rise < steep)
    return (up | down) & (highest + 0.3 * steep > 0.0) & (steep > noise)


@compiled
def maximum(c):
    """Place of the interpolation's maximum, the downward zero crossing of its derivative, by safeguarded Newton."""
    low, high, x = 0.0, 1.0, c[1] / (c[1] - slope(c, 1.0))
    for _ in range(20):
        rate = slope(c, x)
        if rate > 0.0:
            low = x
        else:
            high = x
        bend = 2 * c[2] + x * (6 * c[3] + x * (12 * c[4] + x * 20 * c[5]))
        target = x - rate / bend if bend < 0.0 else 0.5 * (low + high)
        if not low < target < high:
            target = 0.5 * (low + high)
        shift, x = target - x, target
        if abs(shift) < 1e-6:
            break
    return x


@compiled
def secant_zero(c, low, high):
    """Zero of the straight line between two points of the interpolation."""
    below, above = at(c, low), at(c, high)
    return low + (high - low) * below / (below - above) if below < 0.0 < above else 0.5 * (low + high)


@compiled
def inverse_zero(c):
    """Zero of a function that increases over the whole step, by cubic interpolation of its inverse."""
    end, rate = at(c, 1.0), slope(c, 1.0)
    rise = end - c[0]
    y = -c[0] / rise
    x = y + y * (1.0 - y) * ((rise / c[1] - 1.0) * (1.0 - y) - (rise / rate - 1.0) * y)
    return x if 0.0 < x < 1.0 else y


@compiled
def bracketed_zero(c, low, high, x):
    """Upward zero crossing of the interpolation between low and high, by safeguarded Newton from x."""
    for _ in range(12):
        value = at(c, x)
        if value > 0.0:
            high = x
        else:
            low = x
        rate = slope(c, x)
        target = x - value / rate if rate > 0.0 else 0.5 * (low + high)
        if not low < target < high:
            target = 0.5 * (low + high)
        shift, x = target - x, target
        if abs(shift) < 1e-3:
            break
    return x
