"""The page of `make recovery`, from trials whose outcome is made up."""

import json

import numpy as np
import pytest

from reports.diagnosis.page import NAMES, summary, write_page
from reports.diagnosis.plan import WEAK, plan
from reports.diagnosis.plan import held_out as held_out_plan
from reports.diagnosis.sensitivity import TABLE, lines
from reports.diagnosis.summary import confusion, coverage, power, smallest
from reports.diagnosis.trials import DRAWS, Trial, effects_of
from reports.diagnosis.varied import Varied
from reports.kept import line_of


def made_up(kind, names, sigma, found, verdict, right, value=1.0, seed=1, day="2026-01-02"):
    return {
        "key": f"{kind} {names} {sigma} {seed}", "kind": kind, "names": list(names), "sigma": sigma, "seed": seed,
        "found": found, "verdict": verdict, "right": right, "alternatives": [], "reached": sigma or None,
        "cpu": 12.0, "wall": 20.0, "diagnosed": f"{day}T10:00+00:00",
        "truth": {name: {"size": 1.0} for name in names}, "values": [{"size": [value, 0.1, "V"]} for _ in found],
        "deviations": {"stiffness": 2.0}, "left": [["0 to 0.25 Hz", "a.csv", "voltage", 1e-9]],
    }  # fmt: skip


RESULTS = [
    made_up("single", ("creep",), 20.0, ["creep"], "effect", True),
    made_up("single", ("creep",), 30.0, ["leakage"], "effect", False),
    made_up("single", ("leakage",), 5.0, [], "adequate", False),  # too small to count
    made_up("single", ("friction",), 50.0, [], "unexplained", False),
    made_up("healthy", (), 0.0, [], "adequate", True),
    made_up("withheld", ("creep",), 40.0, [], "unexplained", True),
    made_up("weak", ("creep",), 3.5, [], "adequate", False, day="2026-01-01"),
    *(made_up("weak", ("creep",), sigma, ["creep"], "effect", True, value=1.5) for sigma in (5.0, 7.0, 9.0)),
]


def test_counts():
    columns, table = confusion(RESULTS, NAMES)
    row = table[NAMES.index("creep")]
    assert row[columns.index("creep")] == row[columns.index("leakage")] == 1
    assert table[NAMES.index("friction"), columns.index("unexplained")] == 1
    assert table.sum() == 3
    assert coverage(RESULTS)["creep: size"] == (pytest.approx(1 / 4), 4)  # three of four are five errors off
    numbers = summary(RESULTS)
    assert numbers["alarms"] == 0
    assert numbers["shares"]["single effects of 10 σ or more"]["right"] == 1


def test_power_is_told_by_the_sizes_without_the_noise():
    """A specimen on which a unit is worth 1.5 sigma, and a noise that adds one to whatever is reached."""
    rng, threshold, trials = np.random.default_rng(3), 5.0, []
    for seed in range(40):
        unit, noise = rng.uniform(0.7, 1.5), rng.standard_normal()
        for sigma in WEAK:
            reached = abs(unit * sigma + noise)
            found = ["creep"] * bool(reached > threshold)
            trial = made_up("weak", ("creep",), sigma, found, "effect" if found else "adequate", bool(found), seed=seed)
            trials.append({**trial, "reached": reached, "unit": unit})
    trials[len(WEAK) + 2]["reached"] *= 3.0  # the fit without the effect was caught beside its minimum
    sizes, named = power(trials, "creep")
    truth = [trial["unit"] * trial["sigma"] for trial in trials]
    assert np.allclose(sizes, truth, rtol=1e-9)
    size, std = smallest(sizes, named)
    assert 0.05 < std < 0.3
    assert size == pytest.approx(threshold + 1.2816, abs=3 * std)
    assert smallest(sizes[named], named[named]) is None


def test_page(tmp_path):
    page = write_page(RESULTS, tmp_path).read_text(encoding="utf-8")
    assert "10 campaigns" in page
    assert "to themselves" not in page
    assert "These campaigns were diagnosed 2026-01-01 to 2026-01-02." in page
    assert '<td data-label="diagnosed">2026-01-02</td>' in page
    json.loads((tmp_path / "results.json").read_text())
    for figure in ("confusion", "power", "coverage", "time"):
        assert (tmp_path / f"{figure}.png").stat().st_size > 5_000


def test_page_says_how_long_those_took_that_had_the_machine_to_themselves(tmp_path):
    alone = [{**RESULTS[0], "wall": wall} for wall in (9.0, 11.0, 22.0)]
    page = write_page(RESULTS, tmp_path, alone=alone).read_text(encoding="utf-8")
    said = "the 3 that took longest were diagnosed again with both cores to themselves (2026-01-02)"
    assert said in page
    assert "11 s (median) and at most 22 s" in page


def held_out(kind, right, **varied):
    return {"key": kind, "kind": kind, "right": right, "varied": varied}


def test_thresholds_on_held_out_campaigns(tmp_path):
    """Of three campaigns one is lost with a smaller threshold, and one is won with a larger one."""
    results = [
        held_out("single", True, **{"CLOSE_COST 0.7": False, "CLOSE_COST 1.3": True}),
        held_out("healthy", True, **{"MAX_RISE 1.3": True}),
        held_out("healthy", False, **{"CLOSE_COST 1.3": True}),
    ]
    found = {line.name: line for line in lines(results)}
    assert set(found) == set(TABLE)
    assert found["CLOSE_COST"].right == (1, 2, 3)
    assert (found["CLOSE_COST"].tried, found["CLOSE_COST"].changed) == (2, 2)
    assert found["CLOSE_COST"].steady == (1.0, 1.0)
    assert (found["MAX_RISE"].tried, found["MAX_RISE"].changed, found["MAX_RISE"].steady) == (1, 0, (0.7, 1.3))
    page = write_page(RESULTS, tmp_path, held_out=results).read_text(encoding="utf-8")
    assert "Right answers on the 3 held-out campaigns" in page
    assert all(f"<code>{name}</code>" in page for name in TABLE)


def test_held_out_campaigns_are_no_others():
    others = {trial.seed for trial in plan(small=False)}
    trials = held_out_plan()
    assert len({trial.seed for trial in trials}) == len(trials) >= 40
    assert not others & {trial.seed for trial in trials}
    assert {trial.kind for trial in trials} == {"single", "pair", "healthy", "ideal", "withheld", "foreign"}


def test_a_varied_number_knows_which_change_would_decide_otherwise():
    close = set()
    limit = Varied(10.0, {("limit", 0.7): 7.0, ("limit", 1.3): 13.0}, close)
    factor = Varied(2.0, {("factor", 0.7): 1.4, ("factor", 1.3): 2.6}, close)
    assert not np.float64(3.0) > limit
    assert limit < 30.0
    assert not close
    assert np.float64(12.0) > limit
    assert close == {("limit", 1.3)}
    close.clear()
    assert not np.float64(1.0) * limit * factor - 0.0 < 16.0
    assert close == {("limit", 0.7), ("factor", 0.7)}
    close.clear()
    assert (np.array([5.0, 8.0]) > limit).tolist() == [False, False]
    assert close == {("limit", 0.7)}
    close.clear()
    assert 1.0 / limit < 0.11
    assert 5.0 - limit < -2.5
    assert close == {("limit", 0.7)}
    assert int(limit) == 10


def test_rows_keep_what_their_numbers_say():
    row = {"value": [1.23456789012e-7, 0.1 + 0.2], "count": 123456789012, "text": "0.30000000000000004", "none": None}
    kept = json.loads(line_of(row))
    assert kept == {**row, "value": [1.2345679e-7, 0.3]}


def test_plan_has_every_effect_and_no_trial_twice():
    trials = plan(small=False)
    assert len({trial.key for trial in trials}) == len(trials)
    assert {trial.names[0] for trial in trials if trial.kind == "single"} == set(DRAWS)
    assert sum(trial.kind == "healthy" for trial in trials) >= 100
    assert {trial.sigma for trial in trials if trial.kind == "weak"} == set(WEAK)
    assert {trial.key for trial in plan(small=True)} <= {trial.key for trial in trials}


def test_effects_follow_from_the_seed_and_grow_with_sigma():
    for name in DRAWS:
        small, large = (effects_of(Trial("single", (name,), sigma, 5))[name] for sigma in (10.0, 40.0))
        assert effects_of(Trial("single", (name,), 10.0, 5))[name] == small
        changed = [
            key for key in small if isinstance(small[key], float) and not np.isclose(small[key], large[key], atol=0.0)
        ]
        assert len(changed) == 1
        assert large[changed[0]] / small[changed[0]] == pytest.approx(0.25 if name == "leakage" else 4.0)
