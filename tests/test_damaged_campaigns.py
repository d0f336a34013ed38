"""A few of the campaigns of `python -m reports.reliability --campaigns`: a result, or one sentence."""

import numpy as np
import pytest

from reports.reliability.campaigns import attempt_campaign

QUICK = range(900_000, 900_012)  # seeds that the command does not come to


@pytest.mark.parametrize("seeds", [QUICK, pytest.param(range(900_100, 900_150), marks=pytest.mark.slow)])
def test_a_damaged_campaign_ends_in_a_result_or_a_sentence(seeds):
    rows = [attempt_campaign(seed, commands=("identify",)) for seed in seeds]
    assert [row for row in rows if row["outcome"] in ("internal error", "impossible", "slow")] == []
    outcomes = [row["outcome"] for row in rows]
    assert outcomes.count("refused") < 0.8 * len(rows)  # else nothing would get as far as to a fit
    assert outcomes.count("done") < 0.9 * len(rows)  # else hardly anything would be damaged
    healthy = [z for row in rows if row["damage"] == ["healthy"] for z in row.get("deviations", {}).values()]
    assert np.median(np.abs(healthy)) < 2.0
