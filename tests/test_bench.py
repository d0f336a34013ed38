"""`make bench` at its smallest: every alternative says the same, and the tables, figures and JSON are whole.

Nothing here asserts on a time.
"""

import json
import math

import numpy as np
import pytest

from reports.speed import (
    engine,
    events_ivp,
    explorer,
    ngspice,
    pages,
    plots,
    reference,
    steady,
    studies,
    timing,
    words,
)
from reports.speed import transient as runs
from reports.speed.bench import HERE, Extent, measure, write
from reports.speed.drives import Sine, Straight
from reports.speed.equations import Loaded
from reports.speed.exact_numpy import Stepper
from reports.speed.goals import Goal, exponent, goals, own
from reports.speed.sshi import SSHI
from reports.speed.summary import NAMES, chosen, summary

PERIODS = 4
SMALL = Extent(
    runs=runs.Sizes(timed_periods=20, compared_periods=3, repeats=2, samples=200, compared_samples=60, halvings=2),
    capacitors=(1e-6, 1e-5), designs=(100,), workers=(1,), repeats=1, fresh=False,
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def hurried():
    """Nobody reads these times."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(timing, "PATIENCE", 0.0)
        yield


@pytest.fixture(scope="module")
def results(hurried):
    return measure(SMALL)


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "stops"])
def run(request):
    """Case, its hand-written model, instants and the oracle's states."""
    case = studies.sshi(stops=request.param)
    times = studies.instants(PERIODS)
    truth = reference.sshi(case, times)
    return case, SSHI(case.table, Sine(case.table["excitation"])), times, truth


class TestAlternatives:
    def test_reference_is_precise(self, run):
        *_, truth = run
        assert truth.uncertainty < 1e-10

    def test_engine(self, run):
        case, _, times, truth = run
        assert studies.distance(engine.states(case, times), truth.states) < 1e-9

    @pytest.mark.parametrize(("depth", "error"), [(14, 1e-4), (36, 1e-10)])
    def test_exact_numpy(self, run, depth, error):
        _, model, times, truth = run
        assert studies.distance(model.readings(Stepper(model, depth).run(times)), truth.states) < error

    @pytest.mark.parametrize(("method", "rtol", "error"), [("LSODA", 1e-6, 1e-3), ("DOP853", 1e-10, 1e-3)])
    def test_events_ivp(self, run, method, rtol, error):
        _, model, times, truth = run
        assert studies.distance(model.readings(events_ivp.run(model, times, method, rtol)), truth.states) < error

    @pytest.mark.spice
    @pytest.mark.skipif(ngspice.NGSPICE is None, reason=ngspice.ABSENT)
    def test_ngspice(self, run):
        case, _, times, truth = run
        outcome = ngspice.run(case, times, studies.PERIOD / 1000)
        assert studies.distance(outcome.states, truth.states) < 1e-2
        assert outcome.seconds > 0

    def test_record(self, tmp_path):
        case = studies.record(tmp_path, 200)
        force = case.objects()[1].values
        times = np.arange(1, 101) / studies.SAMPLE_RATE
        truth = reference.record(case, force, studies.SAMPLE_RATE, times)
        model = Loaded(case.table, Straight(force, studies.SAMPLE_RATE))
        assert truth.uncertainty < 1e-10
        assert studies.distance(engine.states(case, times), truth.states) < 1e-9
        assert studies.distance(model.readings(Stepper(model, 30).run(times)), truth.states) < 1e-9

    def test_events_in_a_period(self):
        """The studies are what their titles say: 8 events a period, 20 with all three operators slipping to and fro."""
        for stops, events in ((False, 8), (True, 20)):
            from piezoharvest import simulate

            assert simulate(*studies.sshi(stops=stops).objects()).events_per_period == events
        assert simulate(*studies.sshc().objects()).events_per_period == 24


def test_answers_of_the_explorer_are_measured_against_a_goal():
    """Each is one to be trusted; how long it may take is a goal of the report, not of this test."""
    found = explorer.measure(1)
    assert [row["title"] for row in found["rows"]] == [
        "parallel SSHI", "parallel SSHI, three P-I operators", "SSHC with 4 capacitors",
    ]  # fmt: skip
    kept = json.loads((HERE / "speed.json").read_text(encoding="utf-8"))
    (goal,) = (goal for goal in goals({**kept, "explorer": found}) if "explore" in goal.what)
    assert (goal.limit, goal.unit, goal.at_most) == (0.1, "s", True)
    assert goal.found == max(row["seconds"] for row in found["rows"])


@pytest.mark.slow
class TestResults:
    def test_json(self, results, tmp_path):
        write(results, tmp_path)
        found = json.loads((tmp_path / "speed.json").read_text())
        assert set(found) == {
            "machine", "sshi", "sshi_stops", "sshc", "record", "campaign", "scaling", "steady", "gradient", "explorer",
            "sweep", "startup", "goals",
        }  # fmt: skip
        for key in ("sshi", "sshi_stops", "record"):
            names = {row["alternative"] for row in found[key]["rows"]}
            assert names - {"ngspice"} == {"piezoharvest", *NAMES[:-1]}
            assert own(found[key])["error"] < 1e-9
            assert all(row["seconds"] > 0 and math.isfinite(row["error"]) for row in found[key]["rows"])
        assert all(max(row["state_error"], row["power_error"]) < 1e-6 for row in found["steady"])
        for name in ("work_precision.png", "steady_state.png"):
            assert (tmp_path / name).stat().st_size > 10_000

    def test_startup(self, results):
        found = results["startup"]
        assert found["python"] > 0
        assert not found["compiled_anew"]

    def test_sweep(self, results):
        found = results["sweep"]
        assert [row["designs"] for row in found["rows"]] == [100]
        assert found["rows"][0]["memory"] > 50e6
        assert found["converged"] == 1.0
        assert found["power_error"] < 1e-6

    def test_page_names_no_machine(self, results):
        import platform

        text = pages.page(results) + json.dumps(results)
        assert platform.node() not in results["machine"].values()
        assert "/home" not in text
        assert "/tmp" not in text
        assert str(pages.__file__).rsplit("/", 3)[0] not in text

    def test_every_goal_is_in_the_page(self, results):
        text = pages.page(results)
        assert len(goals(results)) >= 15
        for goal in goals(results):
            assert f"| {goal.what} |" in text

    def test_summary_has_a_column_for_each(self, results):
        header, _, *rows = summary(results).splitlines()
        assert header == "|  | piezoharvest | " + " | ".join(NAMES) + " |"
        table = [row for row in rows if row.startswith("|")]
        assert len(table) == 6
        assert all(row.count("|") == header.count("|") for row in table)

    def test_readme_is_refreshed_between_its_comments(self, results, tmp_path):
        readme = tmp_path / "README.md"
        readme.write_text("before\n<!-- speed: begin -->\nold\n<!-- speed: end -->\nafter\n")
        pages.refresh(readme, results)
        lines = readme.read_text().splitlines()
        assert lines[:2] == ["before", "<!-- speed: begin -->"]
        assert lines[-2:] == ["<!-- speed: end -->", "after"]
        assert "old" not in lines
        readme.write_text("no comments\n")
        with pytest.raises(ValueError, match="found 0 places"):
            pages.refresh(readme, results)

    def test_absent_ngspice_is_said(self, results, monkeypatch):
        monkeypatch.setattr(ngspice, "NGSPICE", None)
        without = {**results, "sshi": runs.periodic(studies.sshi(), runs.Sizes(20, 1, 1))}
        assert without["sshi"]["ngspice"] == ngspice.ABSENT
        assert f"ngspice is missing: {ngspice.ABSENT}" in pages.page(without)
        assert chosen(without["sshi"], "ngspice") is None
        plots.work_precision(without)
        plots.steady_state(without)


class TestParts:
    @pytest.mark.parametrize(("patience", "made", "disturbed"), [(1e9, 5, 2), (0.0, 3, 2)], ids=["patient", "not"])
    def test_disturbed_repeats_are_made_again(self, monkeypatch, patience, made, disturbed):
        """The core is in use before the first repeat and after the second."""
        calm, runs = iter([False, True, False, *[True] * 20]), []
        monkeypatch.setattr(timing._yardstick, "calm", lambda: next(calm))
        monkeypatch.setattr(timing, "PATIENCE", patience)
        found = timing.repeat(lambda: runs.append(1), 3)
        assert len(runs) == made
        assert found.disturbed == disturbed
        assert 0.0 <= found.least <= found.median

    def test_waiting_ends_where_nothing_changes(self):
        row = steady.measure((1e-7,), 1)[0]
        assert 20 < row["periods_waited"] < 500
        assert row["power_error"] < 1e-6

    def test_goals(self):
        assert Goal("", 3.0, "s", True, 2.0).met is True
        assert Goal("", 3.0, "s", False, 2.0).met is False
        assert Goal("", 3.0, "s", True, None).met is None
        assert exponent([10, 100, 1000], [1.0, 5.0, 100.0]) == pytest.approx(1.0)

    @pytest.mark.parametrize(
        ("value", "text"), [(1.5, "1.50 s"), (0.0123, "12.3 ms"), (3.21e-6, "3.21 µs"), (12345.0, "12,300 s"),
                            (1e-3, "1.00 ms"), (999.9e-6, "1.00 ms")],
    )  # fmt: skip
    def test_seconds(self, value, text):
        assert words.seconds(value) == text

    def test_error_has_one_figure(self):
        assert words.error(3.1e-7) == "3e-7"
        assert words.error(2.6e-12) == "3e-12"
