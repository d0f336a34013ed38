"""Outputs of stops and hinges within a step, where they have corners: by their mean and their first moment.

The response to what acts within a step depends on little else than these two. A cubic with the values at both ends and
the same two moments therefore acts as an output with corners does, wherever these are in the step.
"""

from __future__ import annotations

import math

from piezoharvest.engine.compilation.compiled import compiled, inlined

MAX_BISECTIONS = 60  # until a corner is found to rounding, if Newton's method does not find it before
# Variables of an output: what it begins from, its threshold or knot, and the input's coefficients of s, s^2 and s^3.
BEGIN, LIMIT, VARIABLES = 0, 1, 5


@inlined
def turning_points(c1, c2, c3):
    """Places inside a step where the cubic c1 s + c2 s^2 + c3 s^3 turns, in their order; 1 where there is none."""
    root = c2 * c2 - 3.0 * c3 * c1
    if root <= 0.0:
        return 1.0, 1.0
    # Both roots without cancellation.
    q = -(c2 + math.copysign(math.sqrt(root), c2))
    s, t = c1 / q, q / (3.0 * c3)
    s = s if 0.0 < s < 1.0 else 1.0
    t = t if 0.0 < t < 1.0 else 1.0
    return min(s, t), max(s, t)


@inlined
def risen(c1, c2, c3, s):
    """Value of the cubic c1 s + c2 s^2 + c3 s^3."""
    return s * (c1 + s * (c2 + s * c3))


@compiled
def _crossing(c1, c2, c3, level, begin, end):
    """Place between two points at which the cubic, which does not turn between them, reaches a level."""
    a, b, s = begin, end, 0.5 * (begin + end)
    rising = risen(c1, c2, c3, end) > risen(c1, c2, c3, begin)
    if (risen(c1, c2, c3, begin) >= level) == rising:
        return begin
    for _ in range(MAX_BISECTIONS):
        off = risen(c1, c2, c3, s) - level
        if off == 0.0:
            return s
        if (off > 0.0) == rising:
            b = s
        else:
            a = s
        rate = c1 + s * (2.0 * c2 + 3.0 * s * c3)
        following = s - off / rate if rate != 0.0 else a
        if not a < following < b:
            following = 0.5 * (a + b)
        if abs(following - s) <= 1e-15:
            return following
        s = following
    return s


@inlined
def _add_moved(c, base, by_base, begin, end, moments):
    """Add to both moments and their derivatives a piece in which the output is a base plus the risen input."""
    p, r = begin, end
    for k in range(4):  # integrals of 1, s, s^2, s^3; those of s times these are the next
        over, further = (r - p) / (k + 1.0), (r * end - p * begin) / (k + 2.0)
        if k == 0:
            moments[0, VARIABLES] += base * over
            moments[1, VARIABLES] += base * further
            for v in range(VARIABLES):
                moments[0, v] += by_base[v] * over
                moments[1, v] += by_base[v] * further
        else:
            moments[0, VARIABLES] += c[k] * over
            moments[1, VARIABLES] += c[k] * further
            moments[0, LIMIT + k] += over
            moments[1, LIMIT + k] += further
        p, r = p * begin, r * end


@inlined
def _add_held(bound, begin, end, moments):
    """Add a piece in which a stop is at its threshold, of either sign."""
    side, further = math.copysign(1.0, bound), 0.5 * (end * end - begin * begin)
    moments[0, VARIABLES] += bound * (end - begin)
    moments[1, VARIABLES] += bound * further
    moments[0, LIMIT] += side * (end - begin)
    moments[1, LIMIT] += side * further


@compiled
def _to_cubic(begin, by_begin, moments, found):
    """Rows of `found`: the value at the end, given, then the cubic's coefficients of s (1 - s) and s^2 (1 - s).

    With their derivatives, and the values last, as in `moments`; `by_begin` is the derivative of the first value.
    """
    for v in range(VARIABLES + 1):
        at_begin = begin if v == VARIABLES else (by_begin if v == BEGIN else 0.0)
        mean = moments[0, v] - 0.5 * (at_begin + found[0, v])
        first = moments[1, v] - at_begin / 6.0 - found[0, v] / 3.0
        found[1, v], found[2, v] = 36.0 * mean - 60.0 * first, 120.0 * first - 60.0 * mean


@compiled
def stop_with_corners(before, limit, c, by_base, moments, found):
    """Stop whose input turns, or which reaches its threshold, within a step: into `found`, as in `_to_cubic`.

    Parameters
    ----------
    before, limit : float
        Output at the beginning, and threshold.
    c : (4,) array
        The input's coefficients; the first, its value at the beginning, has no influence.
    by_base, moments : arrays
        Memory, (VARIABLES,) and (2, VARIABLES + 1).
    found : (3, VARIABLES + 1) array
    """
    moments[:] = 0.0
    by_base[:] = 0.0
    by_base[BEGIN] = 1.0
    c1, c2, c3, base, begin = c[1], c[2], c[3], before, 0.0
    first, second = turning_points(c1, c2, c3)
    for k in range(3):
        end = first if k == 0 else second if k == 1 else 1.0
        if end <= begin:
            continue
        moved = risen(c1, c2, c3, end)
        if abs(base + moved) <= limit:
            _add_moved(c, base, by_base, begin, end, moments)
        else:
            bound = math.copysign(limit, base + moved)
            corner = _crossing(c1, c2, c3, bound - base, begin, end)
            _add_moved(c, base, by_base, begin, corner, moments)
            _add_held(bound, corner, end, moments)
            # The place of the corner has no influence to first order, nor has that of a turning point.
            base = bound - moved
            by_base[BEGIN], by_base[LIMIT] = 0.0, math.copysign(1.0, bound)
            power = end
            for n in range(LIMIT + 1, VARIABLES):
                by_base[n] = -power
                power *= end
        begin = end
    for v in range(VARIABLES):
        found[0, v] = by_base[v] + (1.0 if v > LIMIT else 0.0)
    found[0, VARIABLES] = min(max(base + risen(c1, c2, c3, 1.0), -limit), limit)
    _to_cubic(before, 1.0, moments, found)


@compiled
def hinge_with_corners(limit, c, by_base, moments, found):
    """Hinge whose knot the input passes within a step; as `stop_with_corners`, with the input less the knot as begin.

    The derivatives with respect to the input at the beginning, and to the knot, are those with respect to this
    difference and their opposites.
    """
    moments[:] = 0.0
    by_base[:] = 0.0
    by_base[BEGIN] = 1.0
    c1, c2, c3, base, begin = c[1], c[2], c[3], c[0] - limit, 0.0
    first, second = turning_points(c1, c2, c3)
    for k in range(3):
        end = first if k == 0 else second if k == 1 else 1.0
        if end <= begin:
            continue
        at_begin, at_end = base + risen(c1, c2, c3, begin), base + risen(c1, c2, c3, end)
        p, r = begin, end
        if at_begin < 0.0 < at_end:
            p = _crossing(c1, c2, c3, -base, begin, end)
        elif at_end < 0.0 < at_begin:
            r = _crossing(c1, c2, c3, -base, begin, end)
        if at_begin > 0.0 or at_end > 0.0:
            _add_moved(c, base, by_base, p, r, moments)
        begin = end
    value = base + risen(c1, c2, c3, 1.0)
    above = 1.0 if value > 0.0 else 0.0
    for v in range(VARIABLES):
        found[0, v] = 0.0 if v == LIMIT else above
    found[0, VARIABLES] = above * value
    _to_cubic(max(base, 0.0), 1.0 if base > 0.0 else 0.0, moments, found)
