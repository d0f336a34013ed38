"""Outputs of the elements within a step, with derivatives: cubics of time, by what happens to their inputs.

An input is the cubic with the values and rates at both ends of the step, of which that part is known to be a cubic that
outputs reach directly. A smooth element's output is a cubic through its values at four points of it; that of a stop or
a hinge with a corner in the step has the same mean and first moment.
An output is w(s) = w0 (1 - s) + w1 s + p s (1 - s) + r s^2 (1 - s) over the share s of the step: `StepMemory.outputs`
has w1, p and r of all elements.
"""

from __future__ import annotations

import math

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.motion.curves import curve_of
from piezoharvest.predict.propagation.arguments import BEFORE, BY_LIMIT, FIRST, SECOND, SLOPES
from piezoharvest.predict.propagation.element_kinds import CURVE, HINGE, POWER, PRODUCT, SQUARED_HINGE, STOP
from piezoharvest.predict.propagation.within_step import (
    BEGIN,
    LIMIT,
    VARIABLES,
    hinge_with_corners,
    risen,
    stop_with_corners,
)

# Points inside a step of the Gauss-Lobatto rule, which integrates polynomials of the fifth degree. From the excess over
# the straight line there, a cubic's coefficients are r = _SPREAD (other - one) and p = 5 one - r _INSIDE.
_INSIDE, _OUTER = 0.5 * (1.0 - 1.0 / math.sqrt(5.0)), 0.5 * (1.0 + 1.0 / math.sqrt(5.0))
_SPREAD = 5.0 * math.sqrt(5.0)


@inlined
def _cubic_of(old, trial, place, elements, h, c):
    """Coefficients of an input's cubic over a step; a straight line where its rate is not known."""
    half, added = len(elements.rated), elements.added[place]
    a, b = old[place], trial[place]
    c[0], c[1], c[2], c[3] = a, b - a, 0.0, 0.0
    if elements.rated[place]:
        da, db = h * old[half + place], h * trial[half + place]
        c[1], c[2], c[3] = da, 3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db
    if added >= 0:
        one, two = trial[added], trial[added + elements.reached]
        c[1] += one
        c[2] += two
        c[3] -= one + two


@inlined
def _set_slopes(slopes, at, rated, h, g0, g1, g2, g3):
    """Derivatives with respect to values and rates at both ends from those with respect to the cubic's coefficients."""
    if rated:
        slopes[at], slopes[at + 2] = g0 - 3.0 * g2 + 2.0 * g3, 3.0 * g2 - 2.0 * g3
        slopes[at + 1], slopes[at + 3] = h * (g1 - 2.0 * g2 + g3), h * (g3 - g2)
        slopes[at + 4], slopes[at + 5] = g1 - g3, g2 - g3
    else:
        slopes[at], slopes[at + 2] = g0 - g1, g1
        slopes[at + 1], slopes[at + 3], slopes[at + 4], slopes[at + 5] = 0.0, 0.0, 0.0, 0.0


@compiled
def _smooth(kind, limit, x):
    """Value of an element of one input without memory, its slope, and its derivative with respect to its parameter."""
    if kind == POWER:
        below = 1.0
        for _ in range(int(limit) - 1):  # a whole exponent: the general power takes as long as all else of a step
            below *= x
        return x * below, limit * below, 0.0
    if kind >= CURVE:
        value, slope, _ = curve_of(kind - CURVE, x)
        return value, slope, 0.0
    if kind == SQUARED_HINGE:
        above = max(x - limit, 0.0)
        return above * above, 2.0 * above, -2.0 * above
    if x <= 0.0:
        return 0.0, 0.0, 0.0
    below = x ** (limit - 1.0)
    return x * below, limit * below, x * below * math.log(x)


@inlined
def _set_smooth(j, kind, s, step, elements, memory, at):
    """Value and derivatives of a smooth element's output at a share of the step, into a row of `memory.inside`."""
    c, e, inside = memory.first, memory.second, memory.inside
    a, b, limit = elements.places[j, 0], elements.places[j, 1], elements.limits[j]
    x = c[0] + risen(c[1], c[2], c[3], s)
    if kind == PRODUCT:
        y = e[0] + risen(e[1], e[2], e[3], s)
        value, slope, by_limit = x * y, y, 0.0
        _set_slopes(inside[at], SECOND, elements.rated[b], step.h, x, x * s, x * s * s, x * s * s * s)
    else:
        value, slope, by_limit = _smooth(kind, limit, x)
        _set_slopes(inside[at], SECOND, True, step.h, 0.0, 0.0, 0.0, 0.0)
    _set_slopes(inside[at], FIRST, elements.rated[a], step.h, slope, slope * s, slope * s * s, slope * s * s * s)
    inside[at, BEFORE], inside[at, BY_LIMIT], inside[at, SLOPES] = 0.0, by_limit, value


@inlined
def _below(knot, c):
    """A cubic does not pass a knot: it stays within the hull of its control points."""
    return max(c[0], c[0] + c[1] / 3.0, c[0] + (2.0 * c[1] + c[2]) / 3.0, c[0] + risen(c[1], c[2], c[3], 1.0)) <= knot


@inlined
def _set_off(j, memory):
    """Output of an element that is zero throughout the step."""
    count = len(memory.before)
    memory.outputs[j], memory.outputs[count + j], memory.outputs[2 * count + j] = 0.0, 0.0, 0.0
    memory.off[j] = True


@compiled
def _smooth_output(j, kind, step, elements, memory):
    """Output of a smooth element: through its values at the ends and at two points inside the step."""
    slopes, outputs, inside, count = memory.slopes, memory.outputs, memory.inside, len(memory.before)
    if kind == SQUARED_HINGE and _below(elements.limits[j], memory.first):
        _set_off(j, memory)
        return
    _set_smooth(j, kind, 1.0, step, elements, memory, 0)
    outputs[j] = inside[0, SLOPES]
    for v in range(SLOPES):
        slopes[0, j, v] = inside[0, v]
    if not elements.acts[j]:
        return
    _set_smooth(j, kind, _INSIDE, step, elements, memory, 1)
    _set_smooth(j, kind, _OUTER, step, elements, memory, 2)
    for v in range(SLOPES + 1):
        begin, end = memory.before[j] if v == SLOPES else (1.0 if v == BEFORE else 0.0), inside[0, v]
        one = inside[1, v] - begin * _OUTER - end * _INSIDE
        other = inside[2, v] - begin * _INSIDE - end * _OUTER
        r = _SPREAD * (other - one)
        p = 5.0 * one - r * _INSIDE
        if v == SLOPES:
            outputs[count + j], outputs[2 * count + j] = p, r
        else:
            slopes[1, j, v], slopes[2, j, v] = p, r


@compiled
def _set_moved(j, value, by_begin, by_limit, step, elements, memory):
    """Output of an element that moves by as much as its input over the whole step."""
    c, rated = memory.first, elements.rated[elements.places[j, 0]]
    slopes, outputs, count = memory.slopes, memory.outputs, len(memory.before)
    outputs[j], outputs[count + j], outputs[2 * count + j] = value, -c[2] - c[3], -c[3]
    _set_slopes(slopes[0, j], FIRST, rated, step.h, by_begin, 1.0, 1.0, 1.0)
    _set_slopes(slopes[1, j], FIRST, rated, step.h, 0.0, 0.0, -1.0, -1.0)
    _set_slopes(slopes[2, j], FIRST, rated, step.h, 0.0, 0.0, 0.0, -1.0)
    slopes[0, j, BEFORE], slopes[0, j, BY_LIMIT] = 1.0 - by_begin, by_limit


@compiled
def _set_corners(j, step, elements, memory, begin, by_knot):
    """Output of an element with corners in the step, from `memory.corners`.

    `begin` is the variable of the slopes that its first value depends on, `by_knot` its derivative to the limit.
    """
    found, slopes, outputs, count = memory.corners, memory.slopes, memory.outputs, len(memory.before)
    rated = elements.rated[elements.places[j, 0]]
    for q in range(3):
        outputs[q * count + j] = found[q, VARIABLES]
        g0 = found[q, BEGIN] if begin == FIRST else 0.0
        _set_slopes(slopes[q, j], FIRST, rated, step.h, g0, found[q, 2], found[q, 3], found[q, 4])
        if begin == BEFORE:
            slopes[q, j, BEFORE] = found[q, BEGIN]
        slopes[q, j, BY_LIMIT] = found[q, LIMIT] + by_knot * found[q, BEGIN]


@compiled
def _stop_output(j, step, elements, memory):
    """Output of a stop: of a play's distance from its input."""
    c, limit, before, count = memory.first, elements.limits[j], memory.before[j], len(memory.before)
    # A cubic stays within the hull of its control points, and rises as they do.
    one, total = c[1] / 3.0, c[1] + c[2] + c[3]
    other = (2.0 * c[1] + c[2]) / 3.0
    if max(one, other, total) + before <= limit and min(one, other, total) + before >= -limit:
        _set_moved(j, before + total, 0.0, 0.0, step, elements, memory)
        return
    side = 1.0 if before > 0.0 else -1.0
    if side * before >= limit and 0.0 <= side * one <= side * other <= side * total:
        memory.outputs[j] = side * limit
        memory.slopes[0, j, BY_LIMIT] = side
        memory.outputs[count + j], memory.outputs[2 * count + j] = 0.0, 0.0
        return
    stop_with_corners(before, limit, c, memory.by_base, memory.moments, memory.corners)
    _set_corners(j, step, elements, memory, BEFORE, 0.0)


@compiled
def _hinge_output(j, step, elements, memory):
    """Output of a hinge: what its input exceeds its knot by."""
    c, knot = memory.first, elements.limits[j]
    if _below(knot, c):
        _set_off(j, memory)
        return
    a, b = c[0] + c[1] / 3.0, c[0] + (2.0 * c[1] + c[2]) / 3.0
    end = c[0] + risen(c[1], c[2], c[3], 1.0)
    if min(c[0], a, b, end) >= knot:
        _set_moved(j, end - knot, 1.0, -1.0, step, elements, memory)
        return
    hinge_with_corners(knot, c, memory.by_base, memory.moments, memory.corners)
    _set_corners(j, step, elements, memory, FIRST, -1.0)


@inlined
def set_output(j, step, elements, memory):
    """Output of an element over a step, and its derivatives, from the inputs at both ends."""
    kind, slopes = elements.kinds[j], memory.slopes
    a, b = elements.places[j, 0], elements.places[j, 1]
    memory.off[j] = False
    for q in range(3):
        slopes[q, j, BEFORE], slopes[q, j, BY_LIMIT] = 0.0, 0.0
        for v in range(FIRST, SECOND):
            slopes[q, j, v] = 0.0
    if step.held and kind == STOP:
        memory.outputs[j] = memory.before[j]
        slopes[0, j, BEFORE] = 1.0
        return
    _cubic_of(memory.old, memory.trial, a, elements, step.h, memory.first)
    if kind == STOP:
        _stop_output(j, step, elements, memory)
    elif kind == HINGE:
        _hinge_output(j, step, elements, memory)
    else:
        _cubic_of(memory.old, memory.trial, b, elements, step.h, memory.second)
        _smooth_output(j, kind, step, elements, memory)
