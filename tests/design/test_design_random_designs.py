"""No random design is better than the tuned one; all of them, and many, in `python -m reports.optima`."""

import dataclasses

import pytest

from piezoharvest.design import Bound
from reports.optima.comparison import PROMISE, Comparison, compared
from reports.optima.page import write
from reports.optima.plants import HYSTERETIC, LINEAR, SWITCHED, Case
from reports.optima.trial import attempt

CASES = [
    Case(201, "weak", "sine", "harvest", kinds=("rectifier", "parallel_sshi")),
    Case(202, "strong", "band", "damping", kinds=("series_rl",)),
    Case(203, "strong", "noise", "harvest", kinds=("parallel_rl",)),
    Case(204, "strong", "sine", "harvest", hysteresis=True, kinds=("resistor",)),
    # The optimum lies where the periodic motion ends: one simplex search stopped 0.8 % below.
    pytest.param(Case(2, "strong", "sine", "harvest", kinds=("parallel_sshi",)), marks=pytest.mark.slow),
    pytest.param(Case(7, "strong", "sine", "harvest", True, HYSTERETIC), marks=pytest.mark.slow),
    pytest.param(Case(205, "weak", "band", "harvest", kinds=(*LINEAR, *SWITCHED)), marks=pytest.mark.slow),
]


@pytest.fixture(autouse=True)
def without_bound(monkeypatch):
    monkeypatch.setattr("piezoharvest.design.search.bound_of", lambda view: Bound())


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_no_random_design_is_better(case, request):
    slow = request.node.get_closest_marker("slow") is not None
    count = 3000 if slow else 300
    found, _ = compared(case.study(), count, count)
    assert [each.kind for each in found] == list(case.kinds)
    assert all(each.designs > 30 for each in found)
    assert {each.kind: each.gain for each in found if not each.gain <= PROMISE} == {}


def test_a_design_that_is_not_the_best_is_found_out():
    comparison = Comparison(CASES[0].study(), 300, 300)
    (candidate,) = (c for c in comparison.result.candidates if c.shunt.kind == "rectifier")
    worse = dataclasses.replace(candidate.shunt, load_resistance=1.1 * candidate.shunt.load_resistance)
    comparison.__dict__["result"] = dataclasses.replace(
        comparison.result, candidates=(dataclasses.replace(candidate, shunt=worse),)
    )
    kinds = [draft for draft in comparison._drafts if draft.kind == "rectifier"]
    (row,) = (comparison._compare(draft, worse) for draft in kinds)
    assert row.gain > 10 * PROMISE


def test_page(tmp_path):
    rows = [attempt(Case(206, "weak", "sine", "harvest", kinds=("resistor",)), 100, 100)]
    write(rows, tmp_path / "optima.md")
    text = (tmp_path / "optima.md").read_text(encoding="utf-8")
    assert "by more than 0.0001: 0." in text and "| resistor | 100 |" in text
