"""The set of effects that specimens share, with the costs of all sets given."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from piezoharvest.population import forms

NONE, ONE, OTHER = (frozenset(names) for names in ((), ("leakage",), ("creep",)))


def joint(monkeypatch, costs):
    """Joint form of specimens with the cost of each set in their order; NaN where one cannot be followed with it."""
    fits = [
        {form: None if np.isnan(row[n]) else SimpleNamespace(cost=row[n]) for form, row in costs.items()}
        for n in range(len(costs[NONE]))
    ]
    given = iter(fits)
    monkeypatch.setattr(forms, "_candidates", lambda found: {form: (None, None) for form in costs})
    monkeypatch.setattr(forms, "_fits", lambda *arguments: next(given))
    monkeypatch.setattr(forms, "_cost", lambda step, donor: np.inf if step is None else step.cost)
    monkeypatch.setattr(
        forms, "_own_form", lambda each: min(costs, key=lambda f: np.nan_to_num(costs[f], nan=1e9)[each])
    )
    found: Any = range(len(fits))
    return forms.joint_form(found, [f"film {n}" for n in found], lambda text: None)


def test_of_two_specimens_a_set_is_taken_that_both_can_be_followed_with(monkeypatch):
    found = joint(monkeypatch, {NONE: (50.0, 60.0), ONE: (-500.0, np.nan), OTHER: (np.nan, -500.0)})
    assert (found.form, found.apart, found.rivals) == (NONE, (), ())
    assert [each.cost for each in found.fits] == [50.0, 60.0]


def test_of_three_one_that_cannot_be_followed_is_apart_with_its_own_set(monkeypatch):
    found = joint(monkeypatch, {NONE: (50.0, 60.0, 70.0), ONE: (0.0, 0.0, np.nan), OTHER: (40.0, 40.0, -20.0)})
    assert (found.form, found.apart) == (ONE, (2,))
    assert [each.cost for each in found.fits] == [0.0, 0.0, -20.0]
    assert found.gain == pytest.approx(110.0)
