"""A few of the campaigns of `python -m reports.reliability --campaigns`: a result, or one sentence."""

import numpy as np
import pytest

from reports.reliability.campaigns import attempt_campaign

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
