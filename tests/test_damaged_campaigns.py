"""A few of the campaigns of `python -m reports.reliability --campaigns`: a result, or one sentence."""

import numpy as np
import pytest

from piezoharvest import identify, load_campaign
from reports.reliability.campaigns import attempt, attempt_campaign, drawing

QUICK = range(900_000, 900_005)  # seeds that the command does not come to


def ended(seeds):
    """What becomes of campaigns; none is in an error, impossible, or takes too long."""
    rows = [attempt_campaign(seed, commands=("identify",)) for seed in seeds]
    assert [row for row in rows if row["outcome"] in ("internal error", "impossible", "slow")] == []
    return rows


@pytest.mark.slow
def test_a_damaged_campaign_ends_in_a_result_or_a_sentence():
    outcomes = {row["outcome"] for row in ended(QUICK)}
    assert "refused" in outcomes  # else hardly anything would be damaged
    assert outcomes & {"done", "not to be trusted"}  # else nothing would get as far as to a fit


@pytest.mark.slow
def test_healthy_specimens_among_them_are_identified():
    rows = ended(range(900_100, 900_150))
    healthy = [z for row in rows if row["damage"] == ["healthy"] for z in row.get("deviations", {}).values()]
    assert np.median(np.abs(healthy)) < 2.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [6024, 6052])
def test_no_false_minimum(seed, tmp_path, monkeypatch):
    """Healthy specimens with hysteresis and two modes, of which fits once left 8 and 84 times the noise.

    The one, from values a few per cent off, needs the records with small drives first; the other began far from where
    the largest motion of a step, which is there as its record begins, says that it may.
    """
    monkeypatch.setattr(attempt, "HEALTHY", 1.0)
    monkeypatch.setattr(drawing, "MOST_SAMPLES", 400)
    _, _, truth = attempt.written(seed, tmp_path)
    found = identify(load_campaign(tmp_path / "campaign.toml"))
    values = {e.parameter.path[0]: e.value for e in found.estimates if len(e.parameter.path) == 1}
    for name, value in values.items():
        assert value == pytest.approx(truth[name], rel=1e-2)
