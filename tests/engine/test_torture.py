"""A few of the random studies of `make torture`, of every shunt and effect: a possible result, or a sentence."""

from collections import Counter

import pytest

from reports.reliability.trial import attempt

QUICK = range(100_000, 100_025)  # seeds that `make torture` does not come to


@pytest.mark.parametrize("seeds", [QUICK, pytest.param(range(101_000, 101_600), marks=pytest.mark.slow)])
def test_whatever_is_asked_for_is_answered_or_refused(seeds):
    rows = [attempt(seed) for seed in seeds]
    wrong = [row for row in rows if row["outcome"] not in ("converged", "said", "refused")]
    assert wrong == []
    counts = Counter(row["outcome"] for row in rows)
    # Two thirds are simulated, nearly half converge. Of 25, fewer than these are less likely than 1e-3, whatever is
    # drawn when keys are added; then most would be refused, and tell nothing.
    assert counts["converged"] + counts["said"] > 0.36 * len(rows)
    assert counts["converged"] > 0.16 * len(rows)
