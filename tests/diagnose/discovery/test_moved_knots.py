"""Corners of a table that move to where a law bends: closeness to laws that are given, by least squares."""

from dataclasses import replace

import numpy as np
import pytest

from piezoharvest.description.effects.nameless.places import Electrodes, Spring
from piezoharvest.diagnose.discovery.tables.knots import moved, table_for

X = np.linspace(-1.0, 1.0, 2001)


def stops(x):
    """Two end stops of unequal gaps and stiffnesses."""
    return 3.0 * np.maximum(x - 0.31, 0.0) - np.maximum(-x - 0.22, 0.0)


def jump(x):
    """Dry friction's curve, on which a square is."""
    return np.sign(x) * (0.3 + x**2)


def closest(table, law, *, bent):
    """The table of these corners that is closest to a law, and the root mean square of what it leaves."""
    columns = np.column_stack([replace(table, kinks=tuple(one)).values(X) for one in np.eye(len(table.knots))])
    every = np.column_stack([columns, X]) if bent else columns
    factors = np.linalg.lstsq(every, law(X))[0]
    return replace(table, kinks=tuple(factors[: len(table.knots)])), np.sqrt(np.mean((every @ factors - law(X)) ** 2))


@pytest.mark.parametrize(("place", "law", "times"), [(Spring(), stops, 5.0), (Electrodes(), jump, 2.5)])
@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_a_moved_table_comes_closer_to_a_law_with_sharp_bends(place, law, times, unit):
    table = table_for(place, unit * X)
    scaled = lambda some: replace(some, knots=tuple(np.array(some.knots) / unit))  # noqa: E731
    count, found, errors = len(table.knots), scaled(table), []
    for _ in range(4):
        found, error = closest(found, law, bent=place.bent)
        errors.append(error)
        found = scaled(moved(replace(found, knots=tuple(unit * np.array(found.knots))), unit * X))
    assert min(errors) < errors[0] / times
    assert len(found.knots) == count
    assert np.all(np.abs(found.knots) <= 1.0)


def test_of_a_curve_that_bends_evenly_corners_stay_even():
    table, _ = closest(table_for(Electrodes(), X), lambda x: x * np.abs(x), bent=False)
    inner = np.sort([knot for knot in moved(table, X).knots if knot != 0.0])
    outside = inner[inner > 0.0]
    assert np.ptp(np.diff(outside)) < 0.25 * np.diff(outside).mean()


@pytest.mark.parametrize("smooth", [False, True])
def test_a_moved_table_is_about_the_same_function(smooth):
    table, _ = closest(table_for(Electrodes(), X, smooth=smooth), np.sinh, bent=False)
    assert moved(table, X).values(X) == pytest.approx(table.values(X), abs=0.02 * np.sinh(1.0))


def test_a_table_that_is_straight_has_corners_evenly():
    knots = np.sort([knot for knot in moved(table_for(Electrodes(), X), X).knots if knot != 0.0])
    assert np.ptp(np.diff(knots)) < 1e-9
