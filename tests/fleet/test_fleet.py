"""Diagnoses of many campaigns in one table."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from messages import is_sentence
from scipy.signal import lsim

from piezoharvest import diagnose_fleet
from piezoharvest.cli import main
from piezoharvest.fleet import run
from piezoharvest.fleet.row import diagnosed
from piezoharvest.output import OutputError
from piezoharvest.study import StudyError

RECORD = '[[records]]\nfile = "run.csv"\nload_resistance = 1e5\n'
NOMINAL = "mass = 0.010\ndamping = 0.0628\nstiffness = 986.96\ncoupling = 1.0e-3\ncapacitance = 40e-9\n"
NAMES = ["a/campaign.toml", "b/campaign.toml", "c.toml"]


@pytest.fixture
def fleet(tmp_path):
    """Three campaigns, a study and a saved specimen."""
    folder = tmp_path / "fleet"
    for name in NAMES:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"[transducer]\n{NOMINAL}{RECORD}")
        (path.parent / "run.csv").write_text(f"time_s,force_N,displacement_m\n0,0,0\n{name}\n")
    (folder / "study.toml").write_text('[excitation]\nkind = "sine_force"\n')
    return folder


@pytest.fixture
def calls(monkeypatch):
    """Campaigns that are diagnosed, by a stand-in that takes no time."""
    made = []

    def diagnosed(effects, path):
        made.append(path.name if path.parent.name == "fleet" else f"{path.parent.name}/{path.name}")
        row = dict.fromkeys(run.COLUMNS[1:])
        return row | {"title": "true", "verdict": "effect", "effects": "leakage", "gain": 0.1 + 0.2, "converged": True,
                      "warnings": 0, "seconds": 1.0, "unexplained": 0.0, "mass": 0.01, "mass_std": None}  # fmt: skip

    monkeypatch.setattr(run, "diagnosed", diagnosed)
    return made


@pytest.mark.parametrize("suffix", ["csv", "jsonl"])
def test_a_row_for_each_campaign_and_only_what_changed_again(fleet, calls, suffix, tmp_path):
    out = tmp_path / f"verdicts.{suffix}"
    found = diagnose_fleet(fleet, out)
    assert calls == [row["campaign"] for row in found.rows] == NAMES
    assert found.resumed == 0
    assert found.verdicts == {"effect": 3}
    assert sorted(os.listdir(tmp_path)) == ["fleet", out.name]
    first, rows = out.read_bytes(), found.rows
    again = diagnose_fleet(fleet, out)
    assert (len(calls), again.resumed, again.rows, out.read_bytes()) == (3, 3, rows, first)
    (fleet / "b" / "run.csv").write_text("time_s,force_N\n0,1\n")  # data alone
    (fleet / "d.toml").write_text(f"[transducer]\n{NOMINAL}{RECORD}")
    (fleet / "c.toml").unlink()
    third = diagnose_fleet(fleet, out)
    assert calls[3:] == ["b/campaign.toml", "d.toml"]
    assert [row["campaign"] for row in third.rows] == ["a/campaign.toml", "b/campaign.toml", "d.toml"]


def test_it_goes_on_where_it_was_stopped(fleet, calls, tmp_path, monkeypatch):
    whole, out = tmp_path / "whole.csv", tmp_path / "verdicts.csv"
    diagnose_fleet(fleet, whole)
    work = run.diagnosed

    def stopped(effects, path):
        if path.name == "c.toml":
            raise KeyboardInterrupt
        return work(effects, path)

    monkeypatch.setattr(run, "diagnosed", stopped)
    with pytest.raises(KeyboardInterrupt):
        diagnose_fleet(fleet, out)
    kept = tmp_path / "verdicts.csv.partial"
    assert not out.exists()
    assert [json.loads(line)["campaign"] for line in kept.read_text().splitlines()] == NAMES[:2]
    kept.write_text(kept.read_text() + '{"campaign": "c.toml", "verd')  # cut off by a kill
    with pytest.raises(KeyboardInterrupt):
        diagnose_fleet(fleet, out)  # which loses nothing of what there is
    del calls[:]
    monkeypatch.setattr(run, "diagnosed", work)
    assert diagnose_fleet(fleet, out).resumed == 2
    assert calls == ["c.toml"]
    assert out.read_bytes() == whole.read_bytes()
    assert not kept.exists()


@pytest.mark.parametrize("suffix", ["csv", "jsonl"])
@pytest.mark.parametrize("text", ["a,b\n1,x\n", '[1]\n{"campaign": ["x"]}\n', "\x00\xff", ""])
def test_a_file_of_something_else_is_replaced_and_that_is_said(fleet, calls, tmp_path, text, suffix):
    out, said = tmp_path / f"verdicts.{suffix}", []
    out.write_text(text, encoding="latin-1")
    assert diagnose_fleet(fleet, out, notify=said.append).resumed == 0
    assert said == [f"{out} holds no table of verdicts, and will be replaced by one"]


def test_rows_of_another_state_of_a_campaign_are_not_kept(fleet, calls, tmp_path):
    out = tmp_path / "verdicts.csv"
    out.write_text("campaign,fingerprint\na/campaign.toml,0\n")
    assert diagnose_fleet(fleet, out).resumed == 0


def test_an_internal_error_in_one_campaign_is_told_in_its_row(tmp_path, monkeypatch):
    """It would keep a batch from all campaigns after it."""
    healthy(tmp_path, "one")
    monkeypatch.setattr("piezoharvest.fleet.row._said", lambda found: {}["nothing"])
    row = diagnosed([], tmp_path / "one" / "campaign.toml")
    assert row["error"].endswith("internal error: KeyError: 'nothing'")
    assert row["verdict"] is None


def test_two_processes_do_not_write_the_same_table(fleet, calls, tmp_path):
    out = tmp_path / "verdicts.csv"
    with (
        run.locked(tmp_path / "verdicts.csv.partial", ""),
        pytest.raises(OutputError, match="another process is writing the same table"),
    ):
        diagnose_fleet(fleet, out)
    assert calls == []


@pytest.mark.parametrize(("folder", "message"), [("none", "there is no such folder"), ("empty", "found no campaign")])
def test_a_folder_without_campaigns(tmp_path, folder, message):
    (tmp_path / "empty").mkdir()
    with pytest.raises(StudyError, match=message) as error:
        diagnose_fleet(tmp_path / folder, tmp_path / "verdicts.csv")
    assert is_sentence(str(error.value))
    assert os.listdir(tmp_path) == ["empty"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["diagnose"], "missing: give a campaign file, or --batch with a folder"),
        (["diagnose", "--batch", "fleet"], "--out FILE is needed too"),
        (["diagnose", "c.toml", "--batch", "fleet", "--out", "v.csv"], "are for one campaign"),
        (["diagnose", "--batch", "fleet", "--out", "v.csv", "--report", "r"], "are for one campaign"),
        (["diagnose", "c.toml", "--workers", "2"], "go with --batch only"),
        (["diagnose", "c.toml", "--out", "v.csv"], "go with --batch only"),
        (["diagnose", "--batch", "fleet", "--out", "v.txt"], "allowed are names ending in .csv, .jsonl"),
        (["diagnose", "--batch", "f", "--out", "v.csv", "--workers", "2", "--scheduler", "x"], "only one of the two"),
    ],
)  # fmt: skip
def test_what_does_not_go_together_is_said(arguments, message, capsys):
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


def healthy(folder, name):
    """A short campaign without faults: m x'' + b x' + k x = F + T v, C v' + T x' = -v/R under three sines."""
    m, b, k, T, C, R, rate, fine = 0.01, 0.0628, 986.96, 1e-3, 4e-8, 1e5, 1000.0, 50
    A = np.array([[0.0, 1.0, 0.0], [-k / m, -b / m, T / m], [0.0, -T / C, -1.0 / (R * C)]])
    time = np.arange(800 * fine) / (rate * fine)
    force = sum(0.01 * np.sin(2 * np.pi * f * time + f) for f in (21.0, 47.0, 52.0))
    _, states, _ = lsim((A, [[0.0], [1.0 / m], [0.0]], np.eye(3), np.zeros((3, 1))), force, time)
    noise = np.random.default_rng(0).standard_normal((3, 800))
    x, v = states[::fine, 0] + 1e-8 * noise[0], states[::fine, 2] + 1e-3 * noise[1]
    (folder / name).mkdir(parents=True)
    table = np.column_stack([time[::fine], force[::fine] + 1e-6 * noise[2], x, v])
    header = "time_s,force_N,displacement_m,voltage_V"
    np.savetxt(folder / name / "run.csv", table, delimiter=",", header=header, comments="")
    (folder / name / "campaign.toml").write_text(f"[transducer]\n{NOMINAL}{RECORD}")


def test_processes_of_their_own_find_the_same(tmp_path, capsys):
    folder = tmp_path / "fleet"
    for name in ("one", "two"):
        healthy(folder, name)
    (folder / "wrong.toml").write_text("[[records]]\nfile = \n")
    tables = []
    for workers in ("1", "2"):
        out = tmp_path / f"{workers}.csv"
        assert main(["diagnose", "--batch", str(folder), "--out", str(out), "--workers", workers]) == 1
        with out.open(newline="") as file:
            tables.append([{**row, "seconds": ""} for row in csv.DictReader(file)])
    assert tables[0] == tables[1]
    one, two, wrong = tables[0]
    assert one["verdict"] == two["verdict"] != ""
    assert float(one["mass"]) == float(two["mass"]) > 0.0 < float(one["mass_std"])
    assert (wrong["verdict"], wrong["converged"]) == ("", "")
    assert "wrong.toml: not a valid TOML file" in wrong["error"]
    said = capsys.readouterr()
    assert "warning: wrong.toml: " in said.err
    assert "campaigns" in said.out


def test_a_killed_process_leaves_what_it_has_done(tmp_path):
    folder, out = tmp_path / "fleet", tmp_path / "verdicts.jsonl"
    healthy(folder, "one")
    for number in range(3):
        shutil.copytree(folder / "one", folder / f"other{number}")
    command = [sys.executable, "-m", "piezoharvest", "diagnose", "--batch", str(folder), "--out", str(out)]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    kept = tmp_path / "verdicts.jsonl.partial"
    while not (kept.exists() and kept.stat().st_size):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not out.exists()
    found = diagnose_fleet(folder, out)
    assert found.resumed >= 1
    assert [row["campaign"].split("/")[0] for row in found.rows] == ["one", "other0", "other1", "other2"]
