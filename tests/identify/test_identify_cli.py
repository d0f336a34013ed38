"""`piezoharvest identify` as a user meets it: JSON, tables, report, and one sentence for whatever is wrong."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace
from typing import Any

import pytest
from identify.identify_runs import STACK, campaign_file

from piezoharvest import progress
from piezoharvest.cli import main
from piezoharvest.description.shunts import Rectifier, Resistor
from piezoharvest.report import identification
from piezoharvest.specimen import load_specimen
from piezoharvest.specimen.draws import drawn


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return campaign_file(tmp_path_factory.mktemp("cli"), 1)[0]


@pytest.fixture(scope="module")
def answer(campaign, tmp_path_factory):
    """Exit status, JSON and report of one run."""
    import contextlib
    import io

    out, err = io.StringIO(), io.StringIO()
    report = tmp_path_factory.mktemp("report") / "page"
    with (
        contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), pytest.MonkeyPatch.context() as patch,
    ):  # fmt: skip
        patch.setattr(progress, "EVERY", 0.0)
        saved = str(report.parent / "specimen.toml")
        status = main(["identify", str(campaign), "--json", "--report", str(report), "--save", saved])
    return status, json.loads(out.getvalue()), err.getvalue(), report


def test_records_are_counted_as_they_are_fitted_and_drawn(answer):
    lines = answer[2].splitlines()
    for stage in ("comparing with the model: 1 of ", "drawing: 1 of "):
        assert any(line.startswith(stage) and line.endswith(" left") for line in lines), stage


@pytest.mark.parametrize(
    ("shunt", "words"),
    [
        (Resistor(resistance=1e5), "resistor of 100.0\u202fkΩ"),
        (Rectifier(load_resistance=1e5, smoothing_capacitance=1e-6, diode_drop=0.3), "rectifier"),
    ],
)
def test_a_figure_says_which_circuit_a_record_had(shunt, words):
    """The report of records behind a bridge ended in an internal error."""
    each: Any = SimpleNamespace(record=SimpleNamespace(shunt=shunt))
    assert identification._load(each) == words


def test_json_is_as_the_interface_says(answer):
    status, found, err, _ = answer
    assert status == 0
    assert {"parameters", "fit", "validation", "records"} <= found.keys()
    for name, unit in {
        "stiffness": "N/m",
        "coupling": "N/V",
        "capacitance": "F",
        "hysteresis.weights.0": "V/C",
    }.items():
        parameter = found["parameters"][name]
        assert {"value", "std", "unit", "identifiable"} <= parameter.keys()
        assert parameter["identifiable"] is True
        assert parameter["std"] > 0
        assert unit in parameter["unit"]
    mass = found["parameters"]["mass"]
    assert mass["identifiable"] is False
    assert mass["std"] is None
    assert mass["value"] == mass["nominal"] == STACK["mass"]
    assert "resonance" in mass["experiment"]
    for quality in (found["fit"], found["validation"], *found["records"]):
        assert quality["rms"].keys() == quality["noise"].keys() == {"displacement", "voltage", "current"}
    assert [record["role"] for record in found["records"]] == ["fit", "fit", "fit", "validate"]
    numbers = [int(n) for n in re.findall(r"^iteration (\d+): misfit", err, flags=re.MULTILINE)]
    assert len(numbers) > 2 and numbers == list(range(1, len(numbers) + 1))  # of all fits, of which there are several


def test_a_saved_specimen_is_what_was_printed(answer):
    """With hysteresis; the JSON is read by the same reader, without correlations."""
    _, found, _, report = answer
    specimen = load_specimen(report.parent / "specimen.toml")
    rows = {name: row for name, row in found["parameters"].items() if row["std"] is not None}
    assert specimen.errors == pytest.approx({name: row["std"] for name, row in rows.items()}, rel=1e-9)
    assert specimen.values == pytest.approx({name: row["value"] for name, row in rows.items()}, rel=1e-12)
    assert set(specimen.lacking) == {name for name, row in found["parameters"].items() if not row["identifiable"]}
    (report.parent / "printed.json").write_text(json.dumps(found))
    printed = load_specimen(report.parent / "printed.json")
    assert printed.errors == pytest.approx(specimen.errors, rel=1e-9)
    batch = drawn(specimen, 200, seed=1)
    assert batch.hysteresis is not None and len(batch.hysteresis.weights) == len(STACK["hysteresis"]["weights"])


def test_a_specimen_that_cannot_be_written_is_told_before_the_work(campaign, tmp_path, capsys):
    assert main(["identify", str(campaign), "--save", str(tmp_path / "specimen.json")]) == 2
    assert "allowed are names ending in .toml" in capsys.readouterr().err


def test_report_stands_alone(answer):
    page = (answer[3] / "report.html").read_text(encoding="utf-8")
    assert "What the records do not determine" in page
    assert page.count('<tr data-parameter="') == len(answer[1]["parameters"])
    assert not re.search(r'(src|href)="(?!#|data:)', page)
    pictures = {path.name for path in answer[3].glob("*.png")}
    assert {"loops.png", "record_1.png", "record_4.png"} <= pictures
    for name in pictures:
        assert name in page


def test_tables_for_people(campaign, capsys):
    assert main(["identify", str(campaign)]) == 0
    out = capsys.readouterr().out
    assert re.search(r"stiffness\s+\d+\.\d+ ± \d", out)
    assert "not identifiable" in out
    assert "noise alone" in out


def _edited(campaign, tmp_path, old, new):
    for file in campaign.parent.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    path = tmp_path / campaign.name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('drive = "force"', 'drive = "temperature"', r"campaign\.toml: records\.0\.drive: "),
        ("stiffness = ", "stiffness = -", r"campaign\.toml: transducer\.stiffness: found -"),
        (
            "load_resistance = 51430.0",
            'shunt = { kind = "sece", fit = ["quality"] }',
            r"records\.1\.shunt\.fit: found 'quality'",
        ),
        ('unit = "V"', 'unit = "kg"', r"campaign\.toml: channels\.voltage\.unit: found the unit 'kg'"),
        ('role = "fit"', 'role = "validate"', r"campaign\.toml: records: no record has role ="),
        ("02_", "92_", r"92_.*: "),
    ],
)
def test_bad_campaigns_end_in_one_sentence(campaign, tmp_path, capsys, old, new, said):
    path = _edited(campaign, tmp_path, old, new)
    assert main(["identify", str(path), "--json"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    last = err.strip().splitlines()[-1]
    assert last.startswith("piezoharvest: error: ")
    assert re.search(said, last), last
    assert "Traceback" not in err


def test_a_bad_value_is_told_with_file_channel_and_row(campaign, tmp_path, capsys):
    path = _edited(campaign, tmp_path, "title", "title")
    file = sorted(tmp_path.glob("*.csv"))[0]
    lines = file.read_text().splitlines()
    cells = lines[100].split(",")
    cells[lines[0].split(",").index("voltage_V")] = "nan"
    lines[100] = ",".join(cells)
    file.write_text("\n".join(lines) + "\n")
    assert main(["identify", str(path)]) == 2
    err = capsys.readouterr().err
    assert re.search(rf"{file.name}: voltage, row 101: ", err)


def test_a_report_that_cannot_be_written_is_told_before_the_work(campaign, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["identify", str(campaign), "--report", str(tmp_path / "file")]) == 2
    err = capsys.readouterr().err
    assert "iteration" not in err
    assert "files cannot be written to this directory" in err


def test_a_missing_file(tmp_path, capsys):
    assert main(["identify", str(tmp_path / "none.toml")]) == 2
    assert "none.toml" in capsys.readouterr().err
