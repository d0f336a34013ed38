"""Commands where something is not as it should be: part of what `python -m reports.reliability --faults` tries."""

import sys

import pytest
from selection import with_slow

from reports.reliability.faults import FAULTS, PAIRS, attempt_fault

ROOTS = ("full disk",)  # which only root can make; with root's rights
SOON = {("new", fault) for fault in FAULTS}
TRIED = [pair for pair in PAIRS if pair[0] in ("new", "simulate", "sweep") and pair[1] not in ROOTS]


@pytest.mark.skipif(sys.platform != "linux", reason="rights are given up in the way of Linux only")
@pytest.mark.parametrize(("command", "fault"), with_slow(TRIED, slow=lambda *pair: pair not in SOON))
def test_a_command_does_its_work_or_says_why_not(command, fault):
    row = attempt_fault(PAIRS.index((command, fault)))
    assert (row["outcome"] in ("done", "said"), row["what"]) == (True, f"{command}: ")
