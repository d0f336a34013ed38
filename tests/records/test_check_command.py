"""`piezoharvest check`: what a campaign's records are taken for, without a fit."""

from __future__ import annotations

import json

import numpy as np
import pytest

from piezoharvest.cli import main

CAMPAIGN = """
title = "beam"
[transducer]
mass = 0.010
damping = 0.0628
stiffness = 986.96
coupling = 1.0e-3
capacitance = 40e-9
[channels]
force = { column = "F", unit = "mN" }
displacement = { column = "x", unit = "mm" }
[[records]]
file = "a.csv"
load_resistance = 1e5
"""


@pytest.fixture
def campaign(tmp_path):
    time = np.arange(2000) / 2e3
    turns = 2 * np.pi * (20.0 + 10.0 * time) * time
    rows = np.column_stack([time, 20.0 * np.sin(turns), 0.03 * np.sin(turns)])
    np.savetxt(tmp_path / "a.csv", rows, header="time_s,F,x", comments="", delimiter=",", fmt="%.6f")
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    return tmp_path / "campaign.toml"


def test_the_table_has_what_a_record_is_taken_for(campaign, capsys):
    assert main(["check", str(campaign)]) == 0
    out, err = capsys.readouterr()
    for words in (
        "a.csv",
        "force",
        "resistor",
        "2000",
        "1.00 s at 2.00 kHz",
        "−20.0 mN to 20.0 mN",
        "−30.0 µm to 30.0 µm",
    ):
        assert words in " ".join(out.split()), words
    assert err == ""


def test_a_warning_is_in_the_json_and_the_status(campaign, capsys):
    lines = (campaign.parent / "a.csv").read_text().splitlines()
    lines[900] = lines[900].rsplit(",", 1)[0] + ",0.09"
    (campaign.parent / "a.csv").write_text("\n".join(lines) + "\n")
    assert main(["check", str(campaign), "--json"]) == 1
    out, err = capsys.readouterr()
    found = json.loads(out)
    (record,) = found["specimens"][0]["records"]
    assert record["ranges"]["displacement"] == pytest.approx([-3e-5, 9e-5], rel=1e-3)
    assert (record["sample_rate"], record["samples"], record["shunt"]) == (pytest.approx(2e3), 2000, "resistor")
    assert [finding["check"] for finding in found["warnings"]] == ["spike"]
    assert err.startswith("warning: a.csv: displacement")


@pytest.mark.parametrize(("output", "unit"), [("displacement", "m/N"), ("voltage", "V/N")])
def test_a_frequency_response_is_told_with_its_unit(campaign, capsys, output, unit):
    lines = 40.0 + 0.25 * np.arange(81)
    s = 2j * np.pi * lines
    load = 1e5 / (1.0 + s * 1e5 * 40e-9)  # with the capacitance
    x = 1.0 / (986.96 + 0.0628 * s + 0.010 * s**2 + 1e-6 * s * load)
    response = {"displacement": x, "voltage": -1e-3 * s * x * load}[output]
    rows = np.column_stack([lines, response.real, response.imag])
    np.savetxt(campaign.parent / "a.csv", rows, header="frequency_Hz,real,imaginary", comments="", delimiter=",")
    record = f'kind = "frf"\noutput = "{output}"\nload_resistance = 1e5'
    table = CAMPAIGN.partition("[channels]")[0] + '[[records]]\nfile = "a.csv"\n' + record
    campaign.write_text(table)
    assert main(["check", str(campaign)]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "frf resistor 81 frequency 40.0 Hz to 60.0 Hz" in words
    assert unit in words


def test_what_cannot_be_read_is_one_sentence(campaign, capsys):
    (campaign.parent / "a.csv").unlink()
    assert main(["check", str(campaign)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_values_of_the_load_and_of_the_channels_are_told(campaign, capsys):
    text = CAMPAIGN.replace('unit = "mN"', 'unit = "mN", gain = 2.0, sigma = 0.05').replace(
        "load_resistance = 1e5", 'shunt = { kind = "series_rl", resistance = 1e3, inductance = 5.0 }'
    )
    campaign.write_text(text)
    assert main(["check", str(campaign)]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "series_rl" in words and "R 1 k\u03a9" in words and "L 5 H" in words
    assert "40.0 mN, sigma 50.0 \u00b5N, gain 2.00 mN per raw unit" in words
    assert main(["check", str(campaign), "--json"]) == 0
    (record,) = json.loads(capsys.readouterr().out)["specimens"][0]["records"]
    assert record["load"] == {"kind": "series_rl", "resistance": 1e3, "inductance": 5.0}
    assert record["channels"]["force"] == {"sigma": pytest.approx(5e-5), "gain": pytest.approx(2e-3)}


@pytest.mark.parametrize(
    ("starts", "said"),
    [((None, None, None), []), ((0.0, 1.0, 2.0), []), ((0.0, 2.0, 1.0), []),
     ((0.0, 0.5, 2.0), ["a.csv: start_time: begins at 0.5 s by its start_time, but a.csv lasts to 0.9995 s"]),
     ((5.0, None, None), ["a.csv: start_time: begins at 0 s by its start_time, but a.csv lasts to 0.9995 s"])],
)  # fmt: skip
def test_records_that_overlap_are_told(campaign, capsys, starts, said):
    """Not where the campaign states no times: all records then begin at 0."""
    head, record = CAMPAIGN.split("[[records]]")
    tables = [record + ("" if start is None else f"start_time = {start}\n") for start in starts]
    campaign.write_text(head + "".join(f"[[records]]{table}" for table in tables))
    assert main(["check", str(campaign)]) == (1 if said else 0)
    assert capsys.readouterr().err.splitlines() == [f"warning: {line}" for line in said]
