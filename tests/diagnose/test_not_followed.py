"""Records that a model cannot follow are named, and a diagnosis stands without them."""

import pytest
from diagnose_runs import RECORDS, campaign

from piezoharvest.description.effects import Creep, Leakage
from piezoharvest.diagnose import diagnose, validation
from piezoharvest.diagnose.selection import candidate_fits
from piezoharvest.diagnose.summary import sentence
from piezoharvest.predict.prediction import PredictionError

HIDDEN = {"leakage": {"resistance": 3e6}}


@pytest.mark.parametrize("validated_with", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_records_that_cannot_be_followed_are_named(validated_with, tmp_path, monkeypatch):
    measured = campaign(tmp_path, HIDDEN, [*RECORDS, {**RECORDS[3], "load_resistance": 51.43e3}][: 3 + validated_with])
    lost = measured.of_role("validate")[0].name
    plain = validation.fit

    def failing(problem, model, *more, **options):
        if model.transducer.effects and lost in {data.name for data in problem.data}:
            raise PredictionError("no solution at sample 7")
        return plain(problem, model, *more, **options)

    monkeypatch.setattr(validation, "fit", failing)
    told = diagnose(measured, library=[Leakage])
    assert told.verdict == "effect"
    assert [named.effect.name for named in told.effects] == ["leakage"]
    assert told.unpredicted == (lost,)
    assert f"The model with these effects cannot predict {lost}" in sentence(told)


@pytest.mark.slow
def test_what_was_found_stands_where_one_effect_more_cannot_be_followed(tmp_path, monkeypatch):
    measured, plain, told = campaign(tmp_path, HIDDEN), candidate_fits.scores, []

    def failing(problem, found, *more):
        if found.model.transducer.effects:
            raise PredictionError("no solution at sample 7")
        return plain(problem, found, *more)

    monkeypatch.setattr(candidate_fits, "scores", failing)
    found = diagnose(measured, told.append, library=[Leakage, Creep])
    assert [named.effect.name for named in found.effects] == ["leakage"]
    assert any("no solution at sample 7" in text for text in told)
