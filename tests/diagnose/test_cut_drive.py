"""A load cell whose range is too small: named, and what its records hold after that is left out."""

from dataclasses import replace

import pytest
from diagnose_runs import RECORDS, campaign

from piezoharvest.description.effects import Clipping, Leakage
from piezoharvest.diagnose import diagnose, diagnosis
from piezoharvest.diagnose.preparation.drive_saturation import find_saturated_drive
from piezoharvest.diagnose.summary import sentence
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.finding import Finding

LIMIT = 880.0  # N: the sine of 4 Hz comes to 1000, that of 200 N to 500
CLIPPED = {"clipping": {"limit": LIMIT, "channel": "force"}}
SMALL = {"load_resistance": 97.78e3, "excitation": {"amplitude": 300.0, "offset": 400.0}}
WITH_SMALL = [*RECORDS, SMALL, {**SMALL, "load_resistance": 51.43e3, "role": "validate"}]


@pytest.mark.parametrize("others", [{}, pytest.param({"leakage": {"resistance": 1e6}}, marks=pytest.mark.slow)])
def test_a_drive_that_is_cut_off_is_named_beside_what_else_is_missing(tmp_path, others):
    found = diagnose(campaign(tmp_path, {**CLIPPED, **others}, WITH_SMALL))
    assert found.verdict == "effect"
    assert [named.effect.name for named in found.effects] == ["clipping", *others]
    cut = found.effects[0]
    assert cut.effect.channel == "force"
    assert cut.effect.limit == pytest.approx(LIMIT, rel=1e-3)
    assert cut.gain > 0.95
    assert sum(named.gain for named in found.effects) <= 1.0
    assert found.validation_before.rms["voltage"] > 10.0 * found.validation_after.rms["voltage"]
    assert len(found.cut) == 3
    assert all(name in sentence(found) for name in found.cut)
    for estimate in found.estimates:
        if estimate.parameter.name in ("stiffness", "coupling", "capacitance"):
            true = getattr(found.campaign.transducer, estimate.parameter.name)  # the nominal one stood on the bench
            assert abs(estimate.value - true) < 4.0 * estimate.std


def test_records_end_where_their_drive_is_cut_off(tmp_path):
    measured = campaign(tmp_path, CLIPPED, WITH_SMALL)
    cut = find_saturated_drive(measured)
    assert [record.name for record in measured.records if record.name in cut.records] == list(cut.records)
    for record in cut.campaign.records:
        assert record["force"].max() < LIMIT - 1.0
        assert len(record) == 2000 or record.name in cut.records
    assert all(record["force"].max() > LIMIT - 1.0 for record in measured.records if record.name in cut.records)


@pytest.mark.slow
def test_where_too_little_is_left_for_a_fit_whole_records_are_diagnosed(tmp_path, monkeypatch):
    measured, told, rest = campaign(tmp_path, CLIPPED, WITH_SMALL), [], diagnosis._diagnose_all

    def fails(some, progress, library):
        if some is not measured:
            raise PredictionError("no solution at sample 59")
        return rest(some, progress, library)

    monkeypatch.setattr(diagnosis, "_diagnose_all", fails)
    found = diagnose(measured, told.append, library=[Clipping, Leakage])
    assert "the remaining samples cannot be fitted: no solution at sample 59" in told
    assert (found.verdict, found.cut) == ("unexplained", ())


def test_what_looks_cut_off_but_is_predicted_is_none(tmp_path):
    healthy = campaign(tmp_path)
    assert find_saturated_drive(healthy) is None
    first = healthy.records[0]
    where = ((first.signals["force"].first_row + 300, first.signals["force"].first_row + 500),)
    finding = Finding("warning", "clipped", first.name, "force", where, "found a plateau")
    suspected = replace(healthy, findings=((finding,), *healthy.findings[1:]))
    cut = find_saturated_drive(suspected)
    assert cut is not None
    assert len(cut.campaign.records[0]) == 300
    found = diagnose(suspected, library=[Clipping, Leakage])
    assert found.verdict == "adequate"
    assert found.cut == ()
