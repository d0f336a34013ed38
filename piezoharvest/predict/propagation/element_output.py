"""Outputs of the elements at the end of a step, with derivatives.

A stop whose input reverses within the step is evaluated at the turning point first, which is found on the cubic through
values and rates at both ends.
"""

from __future__ import annotations

import math

import numpy as np

from piezoharvest.engine.compilation.compiled import inlined
from piezoharvest.engine.motion.curves import curve_of

# As in `record_model`, which depends on files that would count as sources of this.
STOP, _PRODUCT, _POWER, _HINGE, _CURVE = 0, 1, 2, 4, 5


@inlined
def _turning(a, da, b, db, h):
    """First extreme value between two samples of values a, b and rates da, db, with derivatives with respect to these.

    On the cubic through them; the value is NaN where there is none inside.
    """
    # p(s) = a + h da s + c2 s^2 + c3 s^3
    c2, c3 = 3.0 * (b - a) - h * (2.0 * da + db), 2.0 * (a - b) + h * (da + db)
    root = c2 * c2 - 3.0 * c3 * h * da
    if root < 0.0:
        return np.nan, 0.0, 0.0, 0.0, 0.0
    # Both roots without cancellation. Of two inside the first one is used: it appears and vanishes without a jump of
    # the path as b and db vary, which Newton's method requires.
    q = -(c2 + math.copysign(math.sqrt(root), c2))
    s, other = h * da / q, q / (3.0 * c3)
    if not 0.0 < s < 1.0 or 0.0 < other < s:
        s = other
    if not 0.0 < s < 1.0:
        return np.nan, 0.0, 0.0, 0.0, 0.0
    s2, s3 = s * s, s * s * s
    # At an extremum its place has no influence to first order: the derivatives are those of the interpolation.
    w_b, w_da, w_db = 3.0 * s2 - 2.0 * s3, h * (s - 2.0 * s2 + s3), h * (s3 - s2)
    return (1.0 - w_b) * a + w_da * da + w_b * b + w_db * db, 1.0 - w_b, w_da, w_b, w_db


@inlined
def _clip(value, limit):
    return min(max(value, -limit), limit)


@inlined
def element_output(kind, limit, before, a, da, b, db, second, h):
    """Output of an element, and its derivatives with respect to (previous output, a, da, b, db, second input, limit).

    a and da are input and rate at the previous sample, b and db the present ones.
    """
    if kind == STOP:
        turn, w_a, w_da, w_b, w_db = _turning(a, da, b, db, h)
        if turn == turn:
            middle = _clip(before + turn - a, limit)
            free = 1.0 if abs(before + turn - a) < limit else 0.0
            held = (1.0 - free) * math.copysign(1.0, before + turn - a)
            value = middle + b - turn
            if abs(value) < limit:
                return (
                    value, free, free * (w_a - 1.0) - w_a, free * w_da - w_da, free * w_b + 1.0 - w_b,
                    free * w_db - w_db, 0.0, held,
                )  # fmt: skip
            return _clip(value, limit), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.copysign(1.0, value)
        value = before + b - a
        if abs(value) < limit:
            return value, 1.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0
        return _clip(value, limit), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.copysign(1.0, value)
    if kind == _PRODUCT:
        return b * second, 0.0, 0.0, 0.0, second, 0.0, b, 0.0
    if kind == _POWER:
        below = 1.0
        for _ in range(int(limit) - 1):  # a whole exponent: the general power takes as long as all else of a step
            below *= b
        return b * below, 0.0, 0.0, 0.0, limit * below, 0.0, 0.0, 0.0
    if kind == _HINGE:
        if b <= limit:
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        return b - limit, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0
    if kind >= _CURVE:
        value, slope, _ = curve_of(kind - _CURVE, b)
        return value, 0.0, 0.0, 0.0, slope, 0.0, 0.0, 0.0
    if b <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    below = b ** (limit - 1.0)
    value = b * below
    return value, 0.0, 0.0, 0.0, limit * below, 0.0, 0.0, value * math.log(b)
