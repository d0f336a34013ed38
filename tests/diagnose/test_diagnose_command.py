"""The command, its JSON as the interface has it, its report, and what it says of bad input."""

import dataclasses
import hashlib
import json
import re
import shutil

import pytest
from diagnose_runs import campaign

from piezoharvest import progress
from piezoharvest.cli import main
from piezoharvest.cli.on_campaigns.diagnose_command import diagnosis_json
from piezoharvest.description.effects import BiasCurrent, registered
from piezoharvest.diagnose import diagnose
from piezoharvest.report import write_diagnosis
from piezoharvest.specimen import load_specimen

KEYS = {
    "verdict", "effects", "alternatives", "parameters", "validation", "unexplained", "experiment",
}  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("command")
    return campaign(folder, effects={"bias_current": {"current": 3e-7}}).path, folder


def refuse(text):
    raise AssertionError(f"{text} in the JSON")


def run(capsys, *arguments):
    status = main(["diagnose", *map(str, arguments)])
    out, err = capsys.readouterr()
    return status, out, err


def test_json_and_report(files, capsys, monkeypatch):
    monkeypatch.setattr(progress, "EVERY", 0.0)
    path, folder = files
    status, out, err = run(capsys, path, "--json", "--report", folder / "report", "--save", folder / "specimen.toml")
    assert status == 0, err
    result = json.loads(out, parse_constant=refuse)
    assert set(result) >= KEYS
    assert result["verdict"] == "effect"
    (effect,) = result["effects"]
    assert effect["name"] == "bias_current"
    assert 0 <= effect["p_value"] < 1e-4
    assert 0.5 < effect["gain"] <= 1.0
    current = effect["parameters"]["current"]
    assert current["unit"] == "A"
    assert abs(current["value"] - 3e-7) < 4 * current["std"]
    for parameter in result["parameters"].values():
        assert {"value", "std", "unit", "identifiable"} <= set(parameter)
    for key in ("noise", "rms_before", "rms_after"):
        assert set(result["validation"][key]) == {"displacement", "voltage", "current"}
    assert result["validation"]["rms_after"]["voltage"] < result["validation"]["rms_before"]["voltage"]
    assert 0 <= result["unexplained"] < 0.1
    assert result["experiment"] is None and result["plan"] is None and result["hints"] == []
    assert {row["name"] for row in result["scores"]} == set(registered())
    lines = err.splitlines()
    assert "scoring the effects" in lines
    tested = next(n for n, line in enumerate(lines) if line.startswith("testing bias_current (1 of "))
    assert any(line.startswith("tried bias_current: ") for line in lines[tested:])
    for stage in ("comparing with the model: 1 of ", "scoring one by one: 1 of ", "drawing: 1 of "):
        assert any(line.startswith(stage) and line.endswith(" left") for line in lines), stage
    check_report(folder / "report")
    check_specimen(folder / "specimen.toml", path, result)


def check_specimen(file, path, result):
    """The saved specimen is what was printed, with errors and source."""
    found = load_specimen(file)
    named = result["effects"][0]["parameters"]["current"]
    assert found.transducer.effects == (BiasCurrent(current=named["value"]),)
    assert found.errors["effects.bias_current.current"] == pytest.approx(named["std"], rel=1e-9)
    for name, row in result["parameters"].items():
        assert found.errors.get(name, 0.0) == pytest.approx(row["std"] or 0.0, rel=1e-9)
        assert (name in found.lacking) == (not row["identifiable"])
    assert found.source["verdict"] == "effect" and found.source["trusted"]
    data = path.parent / found.source["files"][0]["file"]
    assert found.source["files"][0]["sha256"] == hashlib.sha256(data.read_bytes()).hexdigest()


def check_report(folder):
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "The model lacked bias current" in page
    assert not re.search(r"\b(nan|inf|None)\b", re.sub(r"<svg.*?</svg>|<style.*?</style>", "", page, flags=re.S))
    assert "http" not in re.sub(r"<svg[^>]*>", "", page).replace("http://www.w3.org", "")
    for name in registered():
        assert f'data-effect="{name}"' in page
    for figure in ("cause", "structure", "cosines", "where_voltage", "record_1"):
        assert (folder / f"{figure}.png").stat().st_size > 10_000
        assert f'id="figure-{figure}"' in page


@pytest.mark.parametrize("broken", ["absent", "no records to fit", "not TOML"])
def test_bad_input_is_one_sentence(files, tmp_path, capsys, broken):
    source, _ = files
    folder = shutil.copytree(source.parent, tmp_path / "campaign")
    path = folder / "campaign.toml"
    if broken == "absent":
        path.unlink()
    elif broken == "not TOML":
        path.write_text("[transducer\n")
    else:
        path.write_text(path.read_text().replace('"fit"', '"validate"'))
    status, out, err = run(capsys, path, "--json")
    assert status == 2
    assert out == ""
    (error,) = [line for line in err.splitlines() if line.startswith("piezoharvest:")]
    assert "campaign.toml" in error
    assert "Traceback" not in err


CASES = [({}, [BiasCurrent], "adequate"), ({"stiffening": {"cubic_stiffness": 1e18}}, [], "unexplained")]


@pytest.mark.slow
@pytest.mark.parametrize(("present", "library", "wanted"), CASES, ids=[case[2] for case in CASES])
def test_report_of_what_has_no_name(tmp_path, present, library, wanted):
    found = diagnose(campaign(tmp_path, effects=present), library=library)
    assert found.verdict == wanted
    assert found.effects == ()
    page = write_diagnosis(found, tmp_path / "report").read_text(encoding="utf-8")
    assert f"diagnosis: {wanted}" in page
    assert ("Nothing is missing" in page) == (wanted == "adequate")
    assert ("Hint, not a cause" in page) == (wanted == "unexplained")
    if wanted == "unexplained":
        first = found.hints[0]
        assert diagnosis_json(found)["hints"][0] == dataclasses.asdict(first)
        assert any(sign in first.term for sign in "²³|√")  # a stiffening is no linear function
