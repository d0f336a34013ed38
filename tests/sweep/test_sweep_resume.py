"""A sweep that is killed at any moment goes on where it was, and ends with the same bytes."""

import os
import shutil
import signal

import pytest
from sweep_studies import (
    BENCH,
    NOISE,
    RESISTOR,
    SINE,
    SSHI,
    children,
    finish,
    parameter,
    parts,
    running,
    start,
    study_of,
    sweep_table,
    wait_for,
    write,
)

from piezoharvest.output import OutputError
from piezoharvest.sweep import run as sweep_run
from piezoharvest.sweep import sweep

# Some seconds of work in chunks of 64, in the mind of a user some hours.
LONG = BENCH + NOISE + RESISTOR + sweep_table(parameter("shunts.0.resistance", 1e3, 1e7, "log", 320))
LOADS = parameter("shunts.0.load_resistance", 1e5, 1e6, "log", 150)
SHORT = BENCH + SINE + SSHI + sweep_table(LOADS, outputs=["harvested_power"])


@pytest.fixture(scope="module")
def through(tmp_path_factory):
    """The file of a long sweep that ran through."""
    folder = tmp_path_factory.mktemp("through")
    sweep(study_of(folder, LONG), folder / "out.parquet")
    return (folder / "out.parquet").read_bytes()


@pytest.fixture
def quick(tmp_path, monkeypatch):
    """A short sweep that counts its chunks, can be stopped after some, and takes no time."""
    counted = []

    def evaluate(study, values):
        if len(counted) == evaluate.most:
            raise KeyboardInterrupt
        counted.append(len(values))
        return {"converged": values > 0, "harvested_power": values**0.5, "closure": 0 * values}

    def call(text=SHORT, most=None, name="out.parquet", **options):
        evaluate.most = most
        counted.clear()
        told = []
        try:
            sweep(study_of(tmp_path, text), tmp_path / name, notify=told.append, **options)
        except KeyboardInterrupt:
            told.append("interrupted")
        return sum(counted), told

    monkeypatch.setattr(sweep_run, "evaluate", evaluate)
    return call


class TestProcess:
    @pytest.mark.parametrize("workers", [pytest.param(1, marks=pytest.mark.slow), 2])
    def test_killed(self, tmp_path, through, workers):
        write(tmp_path, LONG)
        arguments = ("study.toml", "--out", "out.parquet", "--workers", workers)
        out = tmp_path / "out.parquet"
        process = start(tmp_path, *arguments)
        wait_for(lambda: len(parts(out)) >= 2, process)
        started = children(process.pid)
        process.kill()
        assert process.wait() == -signal.SIGKILL
        assert len(started) >= 2 * (workers - 1)
        wait_for(lambda: not any(map(running, started)))
        assert not out.exists()
        kept = len(parts(out))
        assert 2 <= kept < 5
        status, _, err = finish(start(tmp_path, *arguments))
        assert status == 0
        assert f"{64 * kept} of 320 designs are done" in err
        assert out.read_bytes() == through
        assert sorted(os.listdir(tmp_path)) == ["out.parquet", "study.toml"]

    @pytest.mark.slow
    def test_interrupted(self, tmp_path, through):
        write(tmp_path, LONG)
        arguments = ("study.toml", "--out", "out.parquet", "--workers", "2")
        process = start(tmp_path, *arguments)
        wait_for(lambda: len(parts(tmp_path / "out.parquet")) >= 1, process)
        started = children(process.pid)
        process.send_signal(signal.SIGINT)
        status, out, err = finish(process)
        assert (status, out) == (130, "")
        assert err == "finished designs are kept: the same command resumes the sweep\npiezoharvest: interrupted\n"
        wait_for(lambda: not any(map(running, started)))
        assert finish(start(tmp_path, *arguments))[0] == 0
        assert (tmp_path / "out.parquet").read_bytes() == through

    @pytest.mark.slow
    def test_a_worker_that_dies_is_told(self, tmp_path, through):
        write(tmp_path, LONG)
        process = start(tmp_path, "study.toml", "--out", "out.parquet", "--workers", "2")
        wait_for(lambda: len(parts(tmp_path / "out.parquet")) >= 1, process)
        os.kill(children(process.pid)[-1], signal.SIGKILL)
        status, out, err = finish(process)
        assert (status, out) == (1, "")
        assert (
            err
            == "piezoharvest: error: a worker process died (too little memory?); the same command goes on from here\n"
        )
        sweep(study_of(tmp_path, LONG), tmp_path / "out.parquet")
        assert (tmp_path / "out.parquet").read_bytes() == through

    def test_two_on_the_same_file(self, tmp_path):
        write(tmp_path, LONG)
        process = start(tmp_path, "study.toml", "--out", "out.parquet")
        wait_for(lambda: len(parts(tmp_path / "out.parquet")) >= 1, process)
        with pytest.raises(OutputError, match="another sweep is writing the same file"):
            sweep(study_of(tmp_path, LONG), tmp_path / "out.parquet")
        process.kill()
        process.communicate()


@pytest.mark.parametrize("suffix", ["parquet", "csv"])
@pytest.mark.parametrize("method", ["grid", "random", "sobol"])
def test_goes_on_with_what_is_there(quick, tmp_path, suffix, method):
    text = SHORT.replace("[sweep]", f'[sweep]\nmethod = "{method}"\nsamples = 150')
    quick(text, name=f"whole.{suffix}")
    assert quick(text, 1, f"out.{suffix}")[0] == 64
    assert quick(text, 1, f"out.{suffix}")[0] == 64
    evaluated, told = quick(text, name=f"out.{suffix}")
    assert evaluated == 150 - 128
    assert told == [f"resuming from {tmp_path}/out.{suffix}.partial: 128 of 150 designs are done"]
    assert (tmp_path / f"out.{suffix}").read_bytes() == (tmp_path / f"whole.{suffix}").read_bytes()
    assert sorted(os.listdir(tmp_path)) == [f"out.{suffix}", "study.toml", f"whole.{suffix}"]


@pytest.mark.parametrize(
    "change",
    [
        ("frequency = 50.6", "frequency = 50.7"),
        ("count = 150", "count = 151"),
        ('["harvested_power"]', '["harvested_power", "closure"]'),
        ("quality = 5.0", "quality = 5.5"),
        ("mass = 0.010", "mass = 0.011"),
    ],
)
def test_a_changed_study_starts_afresh(quick, tmp_path, change):
    assert SHORT.count(change[0]) == 1
    quick(SHORT, 1)
    evaluated, told = quick(SHORT.replace(*change))
    assert evaluated >= 150
    assert told == [f"{tmp_path}/out.parquet.partial held partial results of another study or version: starting afresh"]


def test_another_version_starts_afresh(quick, monkeypatch):
    quick(SHORT, 1)
    monkeypatch.setattr("piezoharvest.sweep.fingerprint.__version__", "0.0.1")
    assert quick(SHORT)[0] == 150


def test_a_new_title_or_comment_does_not(quick):
    quick(SHORT, 1)
    assert quick("# checked\n" + SHORT.replace("bench harvester", "the same"))[0] == 150 - 64


def test_a_record_that_changed_starts_afresh(quick, tmp_path):
    noise = '[excitation]\nkind = "record"\nfile = "force.csv"\ncolumn = "force_N"\nsample_rate = 1000\n'
    text = BENCH + noise + SSHI + sweep_table(LOADS, outputs=["harvested_power"])
    (tmp_path / "force.csv").write_text("force_N\n0\n1\n0\n")
    quick(text, 1)
    assert quick(text, 1)[0] == 64
    (tmp_path / "force.csv").write_text("force_N\n0\n2\n0\n")
    assert quick(text)[0] == 150


def test_a_damaged_part_is_made_again(quick, tmp_path):
    quick(SHORT, name="whole.parquet")
    quick(SHORT, 2)
    first, second = parts(tmp_path / "out.parquet")
    first.write_bytes(first.read_bytes()[:-20])
    second.write_bytes(b"")
    assert quick(SHORT) == (150, [])
    assert (tmp_path / "out.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()


def test_killed_while_the_file_is_put_together(quick, tmp_path, monkeypatch):
    quick(SHORT, name="whole.parquet")
    (tmp_path / "out.parquet").write_text("old")

    def replace(source, target):
        if str(target).endswith("out.parquet"):
            raise KeyboardInterrupt
        shutil.move(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", replace)
        assert quick(SHORT) == (150, ["interrupted"])
    assert (tmp_path / "out.parquet").read_text() == "old"
    assert quick(SHORT)[0] == 0
    assert (tmp_path / "out.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()
    assert sorted(os.listdir(tmp_path)) == ["out.parquet", "study.toml", "whole.parquet"]


def test_done_again_replaces_the_file(quick, tmp_path):
    quick(SHORT)
    before = (tmp_path / "out.parquet").read_bytes()
    assert quick(SHORT) == (150, [])
    assert (tmp_path / "out.parquet").read_bytes() == before


@pytest.mark.parametrize(
    ("suffix", "change"),
    [
        ("parquet", ("frequency = 50.6", "frequency = 50.7")),
        ("parquet", ("count = 150", "count = 151")),
        ("parquet", ("load_resistance", "quality")),
        ("csv", ('["harvested_power"]', '["harvested_power", "closure"]')),
    ],
)
def test_the_table_of_another_sweep_is_replaced_and_that_is_said(quick, tmp_path, suffix, change):
    assert change[0] in SHORT
    quick(SHORT.replace(LOADS, LOADS.replace(*change)) if change[0] in LOADS else SHORT.replace(*change),
          name=f"out.{suffix}")  # fmt: skip
    old = (tmp_path / f"out.{suffix}").read_bytes()
    sentence = (
        f"{tmp_path}/out.{suffix} holds the table of another study, sweep or version, which the new one will replace"
    )
    assert quick(SHORT, 1, name=f"out.{suffix}") == (64, [sentence, "interrupted"])
    assert (tmp_path / f"out.{suffix}").read_bytes() == old  # until the new one is complete
    assert quick(SHORT, name=f"out.{suffix}")[1][0] == sentence
    assert quick(SHORT, name=f"out.{suffix}") == (150, [])


def test_a_table_of_another_version_is_replaced_and_that_is_said(quick, monkeypatch):
    quick(SHORT)
    monkeypatch.setattr("piezoharvest.sweep.fingerprint.__version__", "0.0.1")
    assert [text.partition(" holds ")[2][:35] for text in quick(SHORT)[1]] == ["the table of another study, sweep o"]


@pytest.mark.parametrize("name", ["out.parquet", "out.csv"])
@pytest.mark.parametrize("content", [b"", b"old", b"a,b\n1,2\n", b"\xff\xfe"])
def test_a_file_that_is_no_table_of_a_sweep_is_replaced(quick, tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    assert quick(SHORT, name=name) == (150, [])


def test_what_else_is_in_the_folder_stays(quick, tmp_path):
    folder = tmp_path / "out.parquet.partial"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    quick(SHORT)
    assert os.listdir(folder) == ["notes.txt"]


def test_progress_counts_what_was_there(quick):
    quick(SHORT, 1)
    seen = []
    quick(SHORT, progress=lambda *numbers: seen.append(numbers))
    assert seen == [(64, 150), (128, 150), (150, 150)]
