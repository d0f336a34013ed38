"""What damaged and huge files do to their readers: one sentence, never a crash, a hang or the memory of the machine."""

from __future__ import annotations

import os
import random
import zipfile

import h5py
import numpy as np
import pyarrow
import pytest
from messages import is_sentence
from pyarrow import parquet
from scipy.io import savemat
from test_readers import WRITERS, mat_73, numeric

from piezoharvest.readers import ReadError, apart, open_reader
from piezoharvest.readers.base import MAX_NUMBERS

HUGE = 2**40
FORCE = np.arange(200.0)


def failure(path, *columns):
    """What is said of a file."""
    with pytest.raises(ReadError) as caught:
        read(path, *columns)
    message = caught.value.message
    assert is_sentence(message)
    assert "\n" not in message
    return message


def read(path, *columns):
    with open_reader(path) as reader:
        names = [reader.resolve(column) for column in columns]
        return [reader.read(names)[name] for name in names]


def good(path):
    """The column force_N is read, whatever else is in the file."""
    np.testing.assert_array_equal(read(path, "force_N")[0], FORCE)


def crashing_mat(path):
    """A v5 file whose tag of the data has a type that there is none of, which scipy takes for an address."""
    savemat(path, {"force_N": FORCE})
    data = bytearray(path.read_bytes())
    tag = 128 + 8 + 16 + 16 + 16  # behind the header, the tag of the matrix, its flags, its shape and its name
    assert data[tag : tag + 4] == b"\x09\0\0\0"
    data[tag] = 15
    path.write_bytes(data)
    return path


class TestApart:
    def test_a_crash_is_one_sentence_and_the_next_file_is_read(self, tmp_path):
        message = failure(crashing_mat(tmp_path / "bad.mat"), "force_N")
        assert message == "the file is damaged (its reader crashed (-11))"
        savemat(tmp_path / "run.mat", {"force_N": FORCE})
        good(tmp_path / "run.mat")

    def test_reading_that_does_not_end_is_ended(self, tmp_path, monkeypatch):
        os.mkfifo(tmp_path / "pipe")
        with h5py.File(tmp_path / "run.h5", "w") as file:
            file.create_dataset("x", (200,), "f8", external=[(str(tmp_path / "pipe"), 0, h5py.h5f.UNLIMITED)])
            file["force_N"] = FORCE
        monkeypatch.setattr(apart, "_BASE_TIMEOUT", 0.5)
        assert "reading took more than 1 s" in failure(tmp_path / "run.h5", "x")
        good(tmp_path / "run.h5")

    def test_an_interrupted_answer_is_not_taken_for_the_next(self, tmp_path, monkeypatch):
        with h5py.File(tmp_path / "run.h5", "w") as file:
            file["force_N"], file["x"] = FORCE, -FORCE

        def interrupted(self, dtype, length):
            raise KeyboardInterrupt

        with monkeypatch.context() as patched:
            patched.setattr(apart._Process, "_array", interrupted)
            with pytest.raises(KeyboardInterrupt):
                read(tmp_path / "run.h5", "x")
        good(tmp_path / "run.h5")

    def test_several_files_are_open_at_the_same_time(self, tmp_path):
        for n in range(3):
            savemat(tmp_path / f"{n}.mat", {"x": n + FORCE})
        readers = [open_reader(tmp_path / f"{n}.mat") for n in range(3)]
        assert [reader.read(["x"])["x"][0] for reader in readers] == [0, 1, 2]


class TestHuge:
    """Of files that declare more than there is memory for, what is not used does no harm, and what is used is told."""

    def test_hdf5(self, tmp_path):
        with h5py.File(tmp_path / "run.h5", "w") as file:
            file["force_N"] = FORCE
            file.create_dataset("x", (HUGE,), "f8", chunks=(1024,))
        good(tmp_path / "run.h5")
        assert f"found {HUGE} numbers" in failure(tmp_path / "run.h5", "x")

    @pytest.mark.parametrize("kind", ["double", "cell", "char"])
    def test_matlab_73(self, tmp_path, kind):
        with mat_73(tmp_path / "run.mat") as file:
            numeric(file, "force_N", FORCE[None, :])
            dtype = h5py.ref_dtype if kind == "cell" else "u2" if kind == "char" else "f8"
            file.create_dataset("x", (HUGE,), dtype, chunks=(1024,)).attrs["MATLAB_class"] = np.bytes_(kind)
        if kind == "double":
            good(tmp_path / "run.mat")
        found = failure(tmp_path / "run.mat", "x")
        assert str(HUGE) in found

    def test_numpy_archive(self, tmp_path):
        np.savez(tmp_path / "run.npz", force_N=FORCE)
        head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({HUGE},)}}".ljust(117) + "\n"
        with zipfile.ZipFile(tmp_path / "run.npz", "a") as archive:
            archive.writestr("x.npy", b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode())
        good(tmp_path / "run.npz")
        assert f"found {HUGE} numbers" in failure(tmp_path / "run.npz", "x")

    def test_unused_arrays_of_an_archive_are_not_read(self, tmp_path):
        np.savez_compressed(tmp_path / "run.npz", force_N=FORCE, x=np.arange(1000.0))
        data = (tmp_path / "run.npz").read_bytes()
        at = data.index(b"x.npy") + 250  # within the compressed numbers, behind the header
        (tmp_path / "run.npz").write_bytes(data[:at] + bytes(64) + data[at + 64 :])
        good(tmp_path / "run.npz")
        failure(tmp_path / "run.npz", "x")

    def test_parquet(self, tmp_path):
        table = pyarrow.table({"force_N": pyarrow.nulls(MAX_NUMBERS + 1)})
        parquet.write_table(table, tmp_path / "run.parquet")
        assert f"found {MAX_NUMBERS + 1} numbers" in failure(tmp_path / "run.parquet", "force_N")

    def test_a_variable_of_matlab_that_is_longer_than_its_file(self, tmp_path):
        savemat(tmp_path / "run.mat", {"force_N": FORCE})
        data = bytearray((tmp_path / "run.mat").read_bytes())
        data[128 + 4 : 128 + 8] = data[188:192] = b"\xf0\xff\xff\x7f"  # lengths of the variable and of its data
        (tmp_path / "run.mat").write_bytes(data)
        failure(tmp_path / "run.mat", "force_N")

    def test_text(self, tmp_path):
        with (tmp_path / "run.csv").open("wb") as stream:
            stream.truncate(33 * MAX_NUMBERS)
        assert "found a file of 4.125 GiB" in failure(tmp_path / "run.csv", "force_N")


class TestUnused:
    def test_null_data_set_and_strange_types(self, tmp_path):
        with h5py.File(tmp_path / "run.h5", "w") as file:
            file["force_N"], file["nothing"] = FORCE, h5py.Empty("f8")
            h5py.h5d.create(file.id, b"time", h5py.h5t.UNIX_D32LE, h5py.h5s.create_simple((10,)))
            file["beyond"] = h5py.ExternalLink("nowhere.h5", "/x")
        good(tmp_path / "run.h5")
        assert "its columns are force_N" in failure(tmp_path / "run.h5", "nothing")

    def test_null_data_set_of_matlab(self, tmp_path):
        with mat_73(tmp_path / "run.mat") as file:
            numeric(file, "force_N", FORCE[None, :])
            file["nothing"] = h5py.Empty("f8")
            h5py.h5d.create(file.id, b"time", h5py.h5t.UNIX_D32LE, h5py.h5s.create_simple((10,)))
        good(tmp_path / "run.mat")


def damaged(data: bytes, rng: random.Random) -> bytes:
    """A file with a few of its bytes changed: bits, lengths and types, a piece cut out, cut off, or doubled."""
    found = bytearray(data)
    for _ in range(rng.choice([1, 1, 3, 6])):
        at = rng.randrange(min(len(found), rng.choice([400, 10**9])))
        what = rng.random()
        if what < 0.3:
            found[at] ^= 1 << rng.randrange(8)
        elif what < 0.7:
            number = rng.choice([0, 1, 2, 9, 14, 100, 0xFFFFFFFF, 0x7FFFFFFF, 0x80000000])
            found[at - at % 4 : at - at % 4 + 4] = number.to_bytes(4, "little")
        elif what < 0.8:
            del found[at : at + rng.choice([1, 4, 100])]
        elif what < 0.9:
            found[at:at] = found[:64]
        else:
            del found[max(at, 1) :]
    return bytes(found)


@pytest.mark.parametrize("ending", WRITERS)
def test_damage_of_any_kind(tmp_path, ending):
    """Forty damaged files of each format are read, or refused in one sentence."""
    path = tmp_path / f"run{'.mat' if ending == '7.3.mat' else ending}"
    WRITERS[ending](path, {"time_s": FORCE, "force_N": FORCE})
    whole = path.read_bytes()
    for seed in range(40):
        path.write_bytes(damaged(whole, random.Random(seed)))
        try:
            values = read(path, "force_N")[0]
        except ReadError as error:
            assert is_sentence(error.message)
        else:
            assert values.dtype in (float, complex)


@pytest.mark.parametrize("ending", [".h5", ".mat"])
def test_a_file_that_is_being_written_is_not_called_incomplete(tmp_path, ending):
    """A logger holds its file open and locked: it is whole once that has closed it."""
    path = tmp_path / f"run{ending}"
    with h5py.File(path, "w", locking=True) as writer:
        writer["force"] = np.arange(8.0)
        writer.flush()
        message = failure(path, "force")
        assert "while another program has the file open for writing" in message and "complete" not in message
    assert np.array_equal(read(path, "force")[0], np.arange(8.0))
