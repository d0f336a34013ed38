"""The table of thresholds: every one is used, says where it comes from, and has a range that holds its value."""

import re
from pathlib import Path

import pytest

import piezoharvest.diagnose as diagnose
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.thresholds import Threshold
from piezoharvest.identify import identifiability

TABLE = {name: value for name, value in vars(thresholds).items() if isinstance(value, Threshold)}
SOURCES = re.compile(r"(theory|source|choice|measured): ")


@pytest.mark.parametrize("name", TABLE)
def test_a_threshold_decides_something_and_says_where_it_comes_from(name):
    folder = Path(diagnose.__path__[0])
    used = [path for path in folder.rglob("*.py") if re.search(rf"thresholds\.{name}\b", path.read_text())]
    assert used, f"{name} decides nothing"
    one = TABLE[name]
    assert one.decides
    assert SOURCES.match(one.source), one.source
    assert one.steady is None or one.steady[0] <= 1.0 <= one.steady[1]


def test_a_threshold_of_identification_is_the_one_of_identification():
    assert thresholds.MAX_RELATIVE_ERROR == identifiability.MAX_RELATIVE_ERROR
