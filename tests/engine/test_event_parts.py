"""Interpolation and series of guards against the polynomials and roots of NumPy."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import BPoly, CubicHermiteSpline

from piezoharvest.engine.compilation import compiled


def interpreted(name):
    """A module of compiled parts as Python runs it: parts that return several values are for compiled code only."""
    spec = importlib.util.find_spec(name)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled, "compiled", lambda function: function)
        spec.loader.exec_module(module)
    return module


gi, el = (interpreted(f"piezoharvest.engine.events.{name}") for name in ("guard_interpolation", "event_location"))
SEEDS = range(40)
NOISE = 1e-12


def ends(seed):
    """Value, rate and second rate at both ends of a step, and its length."""
    rng = np.random.default_rng(seed)
    return *rng.normal(size=6), rng.uniform(0.5, 2.0)


def values(c, *places):
    return [Polynomial(c)(x) for x in places]


def upward_zeros(polynomial, low=0.0):
    """Places between `low` and 1 at which a polynomial crosses zero upwards."""
    roots = polynomial.roots()
    real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
    return [x for x in real if low < x < 1.0 and polynomial.deriv()(x) > 0.0]


def falling_back(seed):
    """Coefficients of a function that rises at the beginning of a step and falls at its end, with one maximum."""
    rng = np.random.default_rng(seed)
    c = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    while not (c[1] > 0.0 > gi.slope(c, 1.0) and len(upward_zeros(-Polynomial(c).deriv())) == 1):
        c = tuple(rng.normal(size=6) * (1.0, 1.0, 3.0, 3.0, 3.0, 3.0))
    (place,) = upward_zeros(-Polynomial(c).deriv())
    return c, place


@pytest.mark.parametrize("seed", SEEDS)
def test_the_quintic_has_the_values_and_rates_of_both_ends(seed):
    f0, d0, s0, f1, d1, s1, h = ends(seed)
    c = gi.quintic(f0, d0, s0, f1, d1, s1, h)
    known = BPoly.from_derivatives([0.0, h], [[f0, d0, s0], [f1, d1, s1]])
    for x in (0.0, 0.2, 0.5, 0.9, 1.0):
        assert gi.at(c, x) == pytest.approx(known(x * h), rel=1e-12, abs=1e-12)
        assert gi.slope(c, x) == pytest.approx(h * known(x * h, 1), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_error_is_the_difference_of_cubic_and_quintic(seed):
    f0, d0, s0, f1, d1, s1, h = ends(seed)
    cubic, quintic = (
        BPoly.from_derivatives([0.0, h], known) for known in ([[f0, d0], [f1, d1]], [[f0, d0, s0], [f1, d1, s1]])
    )
    # In the middle the odd part is zero: it is measured by its slope there, over a quarter of the step.
    even = abs(cubic(h / 2) - quintic(h / 2))
    odd = h * abs(cubic(h / 2, 1) - quintic(h / 2, 1))
    assert gi.interpolation_error(f0, d0, s0, f1, d1, s1, h) == pytest.approx(max(even, odd / 4), rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_maximum_is_where_the_slope_is_zero(seed):
    c, place = falling_back(seed)
    assert gi.maximum(c) == pytest.approx(place, abs=2e-6)


def rising_once(seed):
    """Coefficients of a function that crosses zero once in a step, upwards, and where."""
    rng = np.random.default_rng(seed)
    while True:
        c = tuple(rng.normal(size=6))
        zeros = upward_zeros(Polynomial(c))
        if c[0] < -0.1 and Polynomial(c)(1.0) > 0.1 and len(zeros) == 1:
            return c, zeros[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_crossing_is_bracketed_and_estimated(seed):
    c, zero = rising_once(seed)
    low, high, x = gi.crossing(c, NOISE, False, False)
    assert low <= zero <= high == low + 0.125
    # Newton's method ends with a step below 1e-3, behind which it has converged far below that.
    assert x == pytest.approx(zero, abs=1e-4)
    assert gi.bracketed_zero(c, 0.0, 1.0, 0.5) == pytest.approx(zero, abs=1e-4)
    assert gi.secant_zero(c, low, high) == pytest.approx(np.interp(0.0, values(c, low, high), [low, high]))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_guard_that_rises_throughout_crosses_where_its_inverse_does(seed):
    rng = np.random.default_rng(seed)
    d0, d1 = rng.uniform(0.6, 1.4, 2)
    f0 = -rng.uniform(0.2, 0.8)
    c = gi.quintic(f0, d0, 0.0, f0 + 1.0, d1, 0.0, 1.0)
    inverse = CubicHermiteSpline([f0, f0 + 1.0], [0.0, 1.0], [1.0 / d0, 1.0 / d1])
    assert gi.inverse_zero(c) == pytest.approx(inverse(0.0), rel=1e-12)
    (zero,) = upward_zeros(Polynomial(c))
    low, high, x = gi.crossing(c, NOISE, True, False)
    assert (low, high) == (0.0, 1.0)
    assert x == pytest.approx(zero, abs=1e-4)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_peak_crosses_if_it_is_above_zero_and_is_decided_elsewhere_if_it_is_near(seed):
    c, place = falling_back(seed)
    peak, start, end = values(c, place, 0.0, 1.0)
    height = peak - max(start, end)

    def with_peak(value):
        return c[0] + value - peak, *c[1:]

    for value in (0.5 * height, 1e-3 * height):
        (zero,) = upward_zeros(Polynomial(with_peak(value)))
        low, high, x = gi.crossing(with_peak(value), NOISE, False, True)
        assert low <= zero <= high
        assert x == pytest.approx(zero, abs=5e-3)  # its slope is small there
    near = gi.MAXIMUM_ERROR * (2.0 * peak - start - end)  # rise and fall
    low, high, x = gi.crossing(with_peak(-0.9 * near), NOISE, False, True)
    assert low == -1.0
    assert high == x == pytest.approx(place, abs=2e-6)
    low, high, _ = gi.crossing(with_peak(-1.1 * near), NOISE, False, True)
    assert low > high


def test_a_guard_that_starts_at_zero_crosses_at_once_or_after_it_has_fallen():
    assert gi.crossing((0.0, 1.0, 0.0, 0.0, 0.0, 0.0), NOISE, False, False) == (0.0, 0.0, 0.0)
    zero = 1e-3  # of x (x - zero), which is below zero before
    low, high, x = gi.crossing((0.0, -zero, 1.0, 0.0, 0.0, 0.0), NOISE, False, False)
    assert 0.0 < low < zero < high
    assert x == pytest.approx(zero, abs=1e-4)
    # One that only falls, or that ends within its noise, does not cross.
    for c in ((0.0, -1.0, 0.0, 0.0, 0.0, 0.0), (-1.0, 1.0, 0.0, 0.0, 0.0, 0.0)):
        low, high, _ = gi.crossing(c, NOISE, False, False)
        assert low > high


@pytest.mark.parametrize("seed", SEEDS)
def test_a_concave_guard_may_peak_where_its_tangents_meet_above_the_noise(seed):
    rng = np.random.default_rng(seed)
    f0, f1, d0, d1 = -rng.uniform(0.0, 1.0), -rng.uniform(0.0, 1.0), rng.uniform(0.0, 2.0), -rng.uniform(0.0, 2.0)
    h, noise = rng.uniform(0.5, 2.0), 0.05
    # f0 + d0 t = f1 + d1 (t - h)
    _, meet = np.linalg.solve([[-d0, 1.0], [-d1, 1.0]], [f0, f1 - d1 * h])
    assert gi.may_peak(f0, d0, -1.0, f1, d1, -1.0, h, noise) == (meet > noise)
    assert gi.may_peak(f0, d0, 1.0, f1, d1, -1.0, h, noise)
    assert gi.may_peak(f0, d0, -1.0, f1, d1, 1.0, h, noise)
    assert not gi.may_peak(f0, -d0, 1.0, f1, d1, 1.0, h, noise)
    assert not gi.may_peak(f0, d0, 1.0, f1, -d1, 1.0, h, noise)


def test_two_extrema_are_expected_of_every_cubic_that_has_them_above_zero():
    rng, seen = np.random.default_rng(0), 0
    for _ in range(4000):
        f0, f1, d0, d1 = (*-rng.uniform(0.0, 0.3, 2), *rng.uniform(0.0, 4.0, 2) * rng.choice([-1.0, 1.0]))
        h = rng.uniform(0.5, 2.0)
        cubic = Polynomial(CubicHermiteSpline([0.0, h], [f0, f1], [d0, d1]).c[::-1, 0])
        expected = gi.may_have_two_extrema(f0, d0, f1, d1, h, max(f0, f1), NOISE)
        times = np.linspace(0.0, h, 101)
        if cubic(times).max() > 1e-3:
            seen += 1
            assert expected
        if h * max(abs(d0), abs(d1)) <= 3.0 * (f1 - f0) * np.sign(d0):  # monotone
            assert not expected
    assert seen > 100
    assert not gi.may_have_two_extrema(-10.0, 1.0, -10.0, 1.0, 1.0, -10.0, NOISE)
    assert not gi.may_have_two_extrema(0.0, 1e-3, 0.0, 1e-3, 1.0, 0.0, 1e-2)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_series_is_that_polynomial_and_its_zero_is_exact(seed):
    rng = np.random.default_rng(seed)
    c = (rng.uniform(-0.3, 0.3), *rng.normal(size=8) * 0.3 ** np.arange(8))
    for x in (-0.4, 0.0, 0.3):
        assert el._series_value(c, x) == pytest.approx(Polynomial(c)(x), rel=1e-12)
        assert el._series_rate(c, x) == pytest.approx(Polynomial(c).deriv()(x), rel=1e-12)
    steady = (c[0], abs(c[1]) + 3.0, *c[2:])
    (zero,) = upward_zeros(Polynomial(steady), -1.0)
    assert el._series_zero(steady, -1.0, 1.0) == pytest.approx(zero, abs=1e-11)
    # Bisection finds it where Newton's method begins at a slope of zero.
    flat = (-0.2, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert el._series_zero(flat, -1.0, 1.0) == pytest.approx(0.2 ** (1 / 3), rel=1e-10)


@pytest.mark.parametrize("seed", SEEDS)
def test_noise_is_above_what_is_rounded_whichever_term_is_the_largest(seed):
    rng = np.random.default_rng(seed)
    f0, d0, f1, d1 = rng.normal(size=4) * 10.0 ** rng.uniform(-3, 3, 4)
    h, floor = 10.0 ** rng.uniform(-3, 3, 2)
    noise = el.rounding_noise(f0, d0, f1, d1, h, 0.0)
    assert noise >= 100 * np.finfo(float).eps * max(abs(f0), abs(f1), h * abs(d0), h * abs(d1))
    assert noise <= 1e-12 * max(abs(f0), abs(f1), h * abs(d0), h * abs(d1))  # or crossings would be overlooked
    assert el.rounding_noise(f1, d1, f0, d0, h, 0.0) == pytest.approx(noise)
    assert el.rounding_noise(f0, d0, f1, d1, h, floor) == pytest.approx(noise + floor, rel=1e-12)
