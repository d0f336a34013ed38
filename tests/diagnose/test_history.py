"""Records of a specimen with hysteresis that begin in the midst of a motion: operators remember what came before."""

import pytest
from diagnose_runs import RECORDS, STACK, campaign

from piezoharvest.description.effects import CouplingDrift, Friction, Leakage, NonlinearCoupling, Stiffening
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.selection.score_tests import extended
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.identify.preparation import prepared
from piezoharvest.records import load_campaign

LIBRARY = [CouplingDrift, Leakage, NonlinearCoupling, Stiffening]
HYSTERESIS = {"thresholds": [0.1e-6, 0.3e-6, 0.7e-6], "weights": [0.5e6, 1.5e6, 0.5e6]}
BEFORE = 640  # samples that are thrown away


@pytest.mark.parametrize(
    "effects",
    [
        pytest.param({}, id="healthy"),
        pytest.param({"leakage": {"resistance": 3e6}}, id="leakage", marks=pytest.mark.slow),
    ],
)
def test_what_came_before_the_record_is_no_effect(effects, tmp_path, monkeypatch):
    monkeypatch.setitem(STACK, "hysteresis", HYSTERESIS)
    whole = campaign(tmp_path, effects, RECORDS[1:], duration=2.0 + 1e-3 * BEFORE)
    for file in whole.path.parent.glob("*.csv"):
        head, *rows = file.read_text().splitlines(keepends=True)
        file.write_text(head + "".join(rows[BEFORE:]))
    found = diagnose(load_campaign(whole.path), library=LIBRARY)
    assert [named.effect.name for named in found.effects] == list(effects)
    assert found.verdict == ("effect" if effects else "adequate")
    first, *_ = found.before.records
    assert max(abs(first.own[f"history q{j}"]) for j in range(3)) > 0.95


def test_the_stop_of_a_new_effect_begins_where_the_last_known_one_does(tmp_path, monkeypatch):
    monkeypatch.setitem(STACK, "hysteresis", HYSTERESIS)
    measured = campaign(tmp_path, records=RECORDS[1:3])
    problem = Problem(prepared(measured, "fit"), measured.transducer, ("displacement",))
    before = Model(measured.transducer, (), ("displacement",))
    after = extended(before, [Friction(stiffness=1e6, threshold=1e-6)], [])
    names = problem.nuisance_names(before, problem.data[0])
    nuisance = [[share if name == "history q2" else 0.0 for name in names] for share in (0.8, -0.3)]
    for data, mine, last in zip(
        problem.data, nuisance_for_model(problem, before, nuisance, after), (0.8, -0.3), strict=True
    ):
        values = dict(zip(problem.nuisance_names(after, data), mine, strict=True))
        assert (values["history x10"], values["history q2"], values["history q1"]) == (last, last, 0.0)
