"""Files that are whole or not there: what a full disk leaves, for every kind of result."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import contextmanager

import h5py
import numpy as np
import pytest
from pyarrow import parquet

from piezoharvest.output import TABLE_SUFFIXES, OutputError, write_table, write_text

resource = pytest.importorskip("resource", reason="limits on the size of files are set by POSIX systems only")
COLUMNS = {"kind": np.array(["open"] * 5000), "time_s": np.random.default_rng(0).normal(size=5000)}


@contextmanager
def little_space(most=4096):
    """A disk on which no file can have more than so many bytes: writing on fails as on a full one."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("suffix", TABLE_SUFFIXES)
def test_table_on_a_full_disk(tmp_path, suffix):
    path = tmp_path / f"w{suffix}"
    path.write_bytes(b"old")
    with little_space(), pytest.raises(OutputError, match=rf"w{suffix}: cannot be written \(File too large\)"):
        write_table(COLUMNS, path)
    assert os.listdir(tmp_path) == [path.name]
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize("suffix", TABLE_SUFFIXES)
def test_process_ends_in_order_on_a_full_disk(tmp_path, suffix):
    """Nothing is left to libraries that would try again, complain or crash when the process ends."""
    script = (
        "import resource, numpy as np; from piezoharvest.output import *\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "try: write_table({'kind': np.array(['open'] * 5000), 'x': np.random.normal(size=5000)}, 'w%s')\n"
        "except OutputError as error: print(error)\n"
    )
    command = [sys.executable, "-c", script % suffix]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout == f"w{suffix}: cannot be written (File too large)\n"
    assert os.listdir(tmp_path) == []


def test_text_on_a_full_disk(tmp_path):
    with little_space(), pytest.raises(OutputError, match="cannot be written"):
        write_text("x" * 10_000, tmp_path / "page.html")
    assert os.listdir(tmp_path) == []


def test_hdf5_is_what_it_was_made_of(tmp_path):
    write_table(COLUMNS, tmp_path / "w.h5")
    with h5py.File(tmp_path / "w.h5") as file:
        np.testing.assert_array_equal(file["time_s"][:], COLUMNS["time_s"])
        assert file["kind"].asstr()[0] == "open"


def test_parquet_is_what_it_was_made_of(tmp_path):
    write_table(COLUMNS, tmp_path / "w.parquet")
    np.testing.assert_array_equal(parquet.read_table(tmp_path / "w.parquet")["time_s"], COLUMNS["time_s"])


def test_text_that_is_none(tmp_path):
    """A name of a file may hold bytes that are no text; the page says which."""
    write_text("run\udcff", tmp_path / "page.html")
    assert (tmp_path / "page.html").read_bytes() == b"run\\udcff"
