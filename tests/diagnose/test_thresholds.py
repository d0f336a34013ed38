"""The table of thresholds: every one is used, says where it comes from, and has a range that holds its value."""

import re
from pathlib import Path
from unittest.mock import patch

import pytest
from diagnose_runs import campaign

import piezoharvest.diagnose as diagnose
from piezoharvest.description.effects import BiasCurrent, CouplingDrift, Leakage, Stiffening
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.thresholds import Threshold
from piezoharvest.identify import identifiability
from reports.diagnosis import sensitivity
from reports.diagnosis.trials import Trial, right
from reports.kept import rows_of

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


def test_ranges_are_those_that_were_measured():
    rows = rows_of(Path(sensitivity.__file__).with_name("held_out.jsonl"))
    for line in sensitivity.lines(rows):
        assert TABLE[line.name].steady in (None, line.steady), line.name


def test_a_threshold_of_identification_is_the_one_of_identification():
    assert thresholds.MAX_RELATIVE_ERROR == identifiability.MAX_RELATIVE_ERROR


@pytest.mark.slow
def test_varied_thresholds_give_the_answers_of_plain_diagnoses(tmp_path, monkeypatch):
    """What is remembered of earlier diagnoses of a campaign does not change later ones."""
    measured = campaign(tmp_path, {"bias_current": {"current": 3e-7}})
    trial = Trial("single", ("bias_current",), 0.0, 1)
    monkeypatch.setattr(sensitivity, "bench_of", lambda trial: [None])
    monkeypatch.setattr(sensitivity, "read_back", lambda bench: measured)
    some = {"MIN_SHARE_OF_INITIAL": 0.9, "MIN_SHARE_OF_PRESENT": 2.0, "MIN_RELATIVE_SCORE": 0.15, "SLOW_LINES": 15.0}
    table = {name: Threshold(value, decides="", source="") for name, value in some.items()}
    monkeypatch.setattr(sensitivity, "TABLE", table)
    library = [BiasCurrent, CouplingDrift, Leakage, Stiffening]  # what is remembered is so for each effect alike
    monkeypatch.setattr(sensitivity, "library_of", lambda trial: library)
    row = sensitivity.attempt(trial)
    assert row["right"]
    assert row["varied"]["MIN_SHARE_OF_INITIAL 1.3"] is False  # more than there is
    assert "MIN_SHARE_OF_INITIAL 0.7" not in row["varied"]
    for key, answer in row["varied"].items():
        name, factor = key.split()
        with patch.multiple(thresholds, **{**some, name: some[name] * float(factor)}):
            found = diagnose.diagnose(measured, library=library)
        assert right(trial, found.verdict, found) == answer, key
