"""A few of the wrong files and tables of `python -m reports.reliability --inputs`: read, done, or one sentence."""

from collections import Counter

import pytest

from reports.reliability.inputs import attempt_input

QUICK = range(1_000_000, 1_000_120)  # seeds that the command does not come to


@pytest.mark.parametrize("seeds", [QUICK, pytest.param(range(1_001_000, 1_003_000), marks=pytest.mark.slow)])
def test_what_is_wrong_is_said_in_a_sentence(seeds):
    rows = [attempt_input(seed) for seed in seeds]
    assert [row for row in rows if row["outcome"] in ("internal error", "impossible", "slow")] == []
    counts = Counter(row["outcome"] for row in rows)
    assert counts["refused"] > 0.5 * len(rows)  # else hardly anything would be wrong
    assert counts["read"] + counts["done"] > 0.05 * len(rows)  # else nothing would get as far as to its values
