"""Smooth curves of one input with their first and second derivatives, by their codes: for elements."""

from __future__ import annotations

import math

from piezoharvest.engine.compilation.compiled import inlined

# Codes, in the order of `description.effects.nameless.curves.CURVES`.
EXPONENTIAL, SINH, TANH, LANGEVIN, LOG, COULOMB, GAUSS = range(7)
STEEP = 100.0  # argument of an exponential from which on it is a straight line: nothing is e^100 times another
SERIES = 0.1  # argument below which the Langevin function is its series: the first term left out is below 1e-13 there
SATURATED = 20.0  # argument above which coth is 1 to rounding


@inlined
def _exponential(z):
    if z > STEEP:
        steep = math.exp(STEEP)
        return steep * (1.0 + z - STEEP) - 1.0, steep, 0.0
    steep = math.exp(z)
    return math.expm1(z), steep, steep


@inlined
def _langevin(z):
    if abs(z) < SERIES:
        s = z * z
        value = z * (1.0 / 3.0 - s * (1.0 / 45.0 - s * (2.0 / 945.0 - s * (1.0 / 4725.0 - s * 2.0 / 93555.0))))
        slope = 1.0 / 3.0 - s * (1.0 / 15.0 - s * (2.0 / 189.0 - s * (1.0 / 675.0 - s * 2.0 / 10395.0)))
        return value, slope, -z * (2.0 / 15.0 - s * (8.0 / 189.0 - s * (2.0 / 225.0 - s * 16.0 / 10395.0)))
    if abs(z) > SATURATED:
        return math.copysign(1.0, z) - 1.0 / z, 1.0 / (z * z), -2.0 / (z * z * z)
    coth, square = 1.0 / math.tanh(z), 1.0 / math.sinh(z) ** 2
    return coth - 1.0 / z, 1.0 / (z * z) - square, 2.0 * (square * coth - 1.0 / (z * z * z))


@inlined
def curve_of(code, z):
    """Value of a curve, its slope, and its second derivative."""
    if code == EXPONENTIAL:
        return _exponential(z)
    if code == SINH:
        rising, r, rr = _exponential(z)
        falling, f, ff = _exponential(-z)
        return 0.5 * (rising - falling), 0.5 * (r + f), 0.5 * (rr - ff)
    if code == TANH:
        value = math.tanh(z)
        slope = 1.0 - value * value
        return value, slope, -2.0 * value * slope
    if code == LANGEVIN:
        return _langevin(z)
    if code == LOG:
        far = 1.0 + abs(z)
        return math.copysign(math.log1p(abs(z)), z), 1.0 / far, -math.copysign(1.0, z) / (far * far)
    if code == COULOMB:
        root = 1.0 / math.sqrt(1.0 + z * z)
        return z * root, root**3, -3.0 * z * root**5
    value = math.exp(-z * z)
    return value, -2.0 * z * value, (4.0 * z * z - 2.0) * value
