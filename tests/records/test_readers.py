"""Readers: what the real libraries write is read back, and what is wrong with a file is said with column and row."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pyarrow
import pytest
from messages import is_sentence
from nptdms import ChannelObject, TdmsWriter
from pyarrow import parquet
from scipy.io import savemat

from piezoharvest.readers import MissingColumnError, Reader, ReadError, open_reader, registered

TIME = np.arange(7) * 1e-3
FORCE = np.array([0.5, -1.0, 2.25, 1e3, -1e-9, 7.0, 8.0])
CURRENT = np.linspace(-1e-6, 1e-6, 7)
COLUMNS = {"time_s": TIME, "force_N": FORCE, "current_A": CURRENT}


def text(path: Path, content: str, encoding="utf-8") -> Path:
    path.write_bytes(content.encode(encoding))
    return path


def table(delimiter=",", decimal=".", header=True) -> str:
    lines = [delimiter.join(COLUMNS)] if header else []
    lines += [
        delimiter.join(f"{x:.17g}".replace(".", decimal) for x in row) for row in zip(*COLUMNS.values(), strict=True)
    ]
    return "\n".join(lines) + "\n"


def read(path: Path, *columns) -> list[np.ndarray]:
    with open_reader(path) as reader:
        names = [reader.resolve(column) for column in columns]
        values = reader.read(names)
        return [values[name] for name in names]


def same(path: Path, *columns) -> None:
    """The three channels are read as they were written, in any order."""
    found = read(path, *reversed(columns))
    for values, wanted in zip(reversed(found), COLUMNS.values(), strict=True):
        assert values.dtype == float
        np.testing.assert_array_equal(values, wanted)


def failure(path: Path, *columns) -> ReadError:
    with pytest.raises(ReadError) as caught:
        read(path, *columns)
    assert is_sentence(caught.value.message)
    assert "\n" not in caught.value.message
    return caught.value


class TestText:
    @pytest.mark.parametrize(
        ("delimiter", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("  ", ".")]
    )
    def test_delimiters(self, tmp_path, delimiter, decimal):
        same(text(tmp_path / "run.csv", table(delimiter, decimal)), *COLUMNS)

    def test_decimal_comma_after_whole_numbers(self, tmp_path):
        path = text(tmp_path / "run.csv", "t;F\n0;0\n0,5;1,25\n")
        np.testing.assert_array_equal(read(path, "F")[0], [0, 1.25])

    @pytest.mark.parametrize("ending", ["\n", "\r\n"])
    @pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-8", "latin-1", "utf-16", "utf-16-le", "utf-16-be"])
    def test_encodings_and_line_ends(self, tmp_path, encoding, ending):
        content = table().replace("force_N", "Kraft_µN").replace("\n", ending)
        same(text(tmp_path / "run.csv", content, encoding), "time_s", "Kraft_µN", "current_A")

    def test_without_header_columns_are_numbers(self, tmp_path):
        path = text(tmp_path / "run.dat", table("\t", header=False))
        same(path, 1, 2, 3)
        same(path, "1", "2", "3")
        assert open_reader(path).first_row == 1

    def test_numbers_count_the_columns_of_a_header_too(self, tmp_path):
        same(text(tmp_path / "run.csv", table()), 1, 2, 3)

    def test_a_comment_may_be_the_header(self, tmp_path):
        path = tmp_path / "run.txt"
        np.savetxt(path, np.column_stack(list(COLUMNS.values())), header=" ".join(COLUMNS), fmt="%.17g")
        same(path, *COLUMNS)
        assert open_reader(path).first_row == 2

    def test_comments_above_the_header(self, tmp_path):
        path = text(tmp_path / "run.csv", "# bench 7\n\n% 2024\n" + table())
        same(path, *COLUMNS)
        assert open_reader(path).first_row == 5

    def test_a_comment_that_is_no_header(self, tmp_path):
        path = text(tmp_path / "run.dat", "# written by hand, on a Sunday\n" + table(" ", header=False))
        same(path, 1, 2, 3)

    def test_quoted_and_padded_names_and_a_delimiter_at_the_end(self, tmp_path):
        content = '"t", "F N"\n' + "".join(f"{t:.17g}, {f:.17g},\n" for t, f in zip(TIME, FORCE, strict=True))
        np.testing.assert_array_equal(read(text(tmp_path / "run.csv", content), "F N")[0], FORCE)

    @pytest.mark.parametrize("word", ["nan", "NaN", "", "#N/A", "-1.#IND"])
    def test_missing_values_are_no_numbers(self, tmp_path, word):
        values = read(text(tmp_path / "run.csv", f"t,F\n0,1\n1,{word}\n2,3\n"), "F")[0]
        np.testing.assert_array_equal(values, [1, np.nan, 3])

    def test_many_blocks(self, tmp_path):
        """Longer than a block of the reader, with a column that nobody wants and that is not numeric."""
        values = np.random.default_rng(0).normal(size=200_000)
        lines = "".join(f"{n},{v!r},ok so far\n" for n, v in enumerate(values.tolist()))
        path = text(tmp_path / "run.csv", "n,v,remark\n0,0.5,first\n" + lines)
        np.testing.assert_array_equal(read(path, "v")[0], np.concatenate(([0.5], values)))

    @pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), (";", ","), ("  ", ".")])
    @pytest.mark.parametrize(("bad", "shown"), [("12x", "12x"), ("#REF!", "#REF!"), ("1_000", "1_000")])
    def test_text_among_numbers(self, tmp_path, delimiter, decimal, bad, shown):
        lines = table(delimiter, decimal).splitlines()
        cells = lines[5].split(delimiter)
        lines[5] = delimiter.join([cells[0], bad, cells[2]])
        error = failure(text(tmp_path / "run.csv", "\n".join(lines)), "time_s", "force_N")
        assert (error.column, error.row) == ("force_N", 6)
        assert repr(shown) in error.message or "#" in bad

    @pytest.mark.parametrize("cut", [3, -1])
    def test_truncated(self, tmp_path, cut):
        """Within the first or the second cell of the last line."""
        content = table()
        last = content.rindex("\n", 0, -1) + 1
        end = last + cut if cut > 0 else content.rindex(",") + cut
        error = failure(text(tmp_path / "run.csv", content[:end]), "time_s", "force_N")
        assert error.row == 8
        assert "column, but" in error.message or "columns, but" in error.message

    def test_a_column_too_many(self, tmp_path):
        error = failure(text(tmp_path / "run.csv", "t,F\n0,1\n1,2\n2,3,4\n"), "F")
        assert error.row == 4
        assert error.message == "found 3 columns, but 2 in the rows above"

    def test_header_that_does_not_fit(self, tmp_path):
        error = failure(text(tmp_path / "run.csv", "t,F,x\n0,1\n1,2\n"), "F")
        assert error.row == 2

    @pytest.mark.parametrize("content", ["t,F\n", "t,F\n\n\n", "# nothing\n", "t,F\nseconds,newtons\nmore,words\n"])
    def test_no_numbers(self, tmp_path, content):
        failure(text(tmp_path / "run.csv", content), "F")

    def test_binary(self, tmp_path):
        (tmp_path / "run.csv").write_bytes(bytes(range(256)))
        assert "binary" in failure(tmp_path / "run.csv", "F").message

    def test_two_columns_of_one_name(self, tmp_path):
        path = text(tmp_path / "run.csv", "t,F,F\n0,1,2\n1,3,4\n")
        assert "found 2 columns 'F'" in failure(path, "F").message
        np.testing.assert_array_equal(read(text(tmp_path / "b.csv", "t,F,G\n0,1,2\n"), 3)[0], [2])


class TestColumns:
    def test_a_missing_one_names_those_that_are_there(self, tmp_path):
        path = text(tmp_path / "run.csv", table())
        error = failure(path, "force")
        assert isinstance(error, MissingColumnError)
        assert error.message == (
            "the file has no column 'force' (did you mean 'force_N'?), its columns are time_s, force_N, current_A"
        )

    def test_a_number_beyond(self, tmp_path):
        assert "the file has 3 columns" in failure(text(tmp_path / "run.csv", table()), 4).message

    def test_last_part_of_a_path(self, tmp_path):
        with h5py.File(tmp_path / "run.h5", "w") as file:
            file["run 1/force"], file["run 1/x"], file["run 2/x"] = FORCE, FORCE, CURRENT
        np.testing.assert_array_equal(read(tmp_path / "run.h5", "force")[0], FORCE)
        np.testing.assert_array_equal(read(tmp_path / "run.h5", "run 2/x")[0], CURRENT)
        assert "found 2 columns 'x' (run 1/x, run 2/x)" in failure(tmp_path / "run.h5", "x").message


class TestFiles:
    @pytest.mark.parametrize("suffix", sorted(registered()))
    def test_empty(self, tmp_path, suffix):
        (tmp_path / f"run{suffix}").touch()
        assert failure(tmp_path / f"run{suffix}", "x").message.startswith("the file is empty")

    @pytest.mark.parametrize("suffix", sorted(set(registered()) - {".csv", ".txt", ".dat", ".tsv"}))
    @pytest.mark.parametrize("content", [b"time_s,force_N\n0,1\n", bytes(range(256)) * 20])
    def test_of_another_kind(self, tmp_path, suffix, content):
        (tmp_path / f"run{suffix}").write_bytes(content)
        failure(tmp_path / f"run{suffix}", "force_N")

    def test_not_there(self, tmp_path):
        assert "No such file" in failure(tmp_path / "run.csv", "x").message

    def test_a_directory(self, tmp_path):
        (tmp_path / "run.csv").mkdir()
        assert "directory" in failure(tmp_path / "run.csv", "x").message

    @pytest.mark.parametrize("name", ["run.docx", "run"])
    def test_unknown_ending(self, tmp_path, name):
        (tmp_path / name).write_text("x")
        assert ".csv, .dat" in failure(tmp_path / name, "x").message

    def test_ending_in_capitals(self, tmp_path):
        same(text(tmp_path / "RUN.CSV", table()), *COLUMNS)

    def test_a_format_of_the_users_script(self, tmp_path):
        class Bytes(Reader):
            suffixes = (".bytes_of_test_readers",)
            names = ("value",)

            def read(self, names):
                return {name: np.frombuffer(self.path.read_bytes(), np.uint8).astype(float) for name in names}

        try:
            path = tmp_path / "run.bytes_of_test_readers"
            path.write_bytes(b"\x01\x02")
            np.testing.assert_array_equal(read(path, "value")[0], [1, 2])
        finally:
            del Bytes.suffixes  # leave no new ending in the registry, which goes by subclasses


def write_npz(path, arrays):
    np.savez(path, **arrays)


def write_h5(path, arrays):
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=values, compression="gzip")


def write_parquet(path, arrays):
    parquet.write_table(pyarrow.table(arrays), path, row_group_size=3)


def write_tdms(path, arrays):
    with TdmsWriter(path) as writer:
        for part in (slice(0, 4), slice(4, None)):
            parts = {name: values[part] for name, values in arrays.items() if len(values[part])}
            writer.write_segment([ChannelObject("bench", name, values) for name, values in parts.items()])


def write_mat(path, arrays):
    savemat(path, arrays, do_compression=True)


def write_mat_73(path, arrays):
    with mat_73(path) as file:
        for name, values in arrays.items():
            numeric(file, name, np.reshape(values, (1, -1)))


WRITERS = {
    ".npz": write_npz, ".h5": write_h5, ".parquet": write_parquet, ".tdms": write_tdms, ".mat": write_mat,
    "7.3.mat": write_mat_73,
}  # fmt: skip


class TestBinary:
    @pytest.mark.parametrize("ending", WRITERS)
    def test_round_trip(self, tmp_path, ending):
        path = tmp_path / f"run{ending}"
        WRITERS[ending](path, COLUMNS)
        same(path, *COLUMNS)

    @pytest.mark.parametrize("ending", [".npz", ".h5", ".parquet", ".tdms", ".mat"])
    @pytest.mark.parametrize("kind", ["float32", "int16", "uint8"])
    def test_other_numbers(self, tmp_path, ending, kind):
        values = np.array([1, 2, 250 if kind == "uint8" else -3]).astype(kind)
        WRITERS[ending](tmp_path / f"run{ending}", {"x": values, "y": values})
        found = read(tmp_path / f"run{ending}", "x")[0]
        assert found.dtype == float
        np.testing.assert_array_equal(found, values.astype(float))

    @pytest.mark.parametrize("ending", WRITERS)
    @pytest.mark.parametrize("share", [0.3, 0.9])
    def test_truncated(self, tmp_path, ending, share):
        path = tmp_path / f"run{ending}"
        values = np.random.default_rng(0).normal(size=4000)
        WRITERS[ending](path, {"time_s": values, "force_N": values, "current_A": values})
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
        failure(path, *COLUMNS)

    @pytest.mark.parametrize("ending", [".npz", ".h5", ".parquet", ".tdms", ".mat"])
    def test_text_instead_of_numbers(self, tmp_path, ending):
        words = np.array(["a", "b", "c"], dtype=object if ending in (".h5", ".parquet", ".tdms", ".mat") else str)
        WRITERS[ending](tmp_path / f"run{ending}", {"x": words, "y": np.array([1.0, 2.0, 3.0])})
        error = failure(tmp_path / f"run{ending}", "x")
        assert "x" in error.column or "'x'" in error.message
        np.testing.assert_array_equal(read(tmp_path / f"run{ending}", "y")[0], [1, 2, 3])

    def test_nulls_of_parquet_are_no_numbers(self, tmp_path):
        parquet.write_table(
            pyarrow.table({"x": pyarrow.array([1.0, None, 3.0]), "n": [1, 2, None]}), tmp_path / "r.parquet"
        )
        x, n = read(tmp_path / "r.parquet", "x", "n")
        np.testing.assert_array_equal(x, [1, np.nan, 3])
        np.testing.assert_array_equal(n, [1, 2, np.nan])

    def test_pickled_objects_are_refused(self, tmp_path):
        np.savez(tmp_path / "run.npz", x=np.array([{}, 1], dtype=object))
        failure(tmp_path / "run.npz", "x")

    def test_complex_values_stay_complex(self, tmp_path):
        values = np.array([1 + 2j, 3 - 4j])
        write_npz(tmp_path / "run.npz", {"z": values})
        write_h5(tmp_path / "run.h5", {"z": values})
        write_mat(tmp_path / "run.mat", {"z": values})
        for name in ("run.npz", "run.h5", "run.mat"):
            np.testing.assert_array_equal(read(tmp_path / name, "z")[0], values)


class TestMatrices:
    def test_columns_as_numpy_indexes_them(self, tmp_path):
        matrix = np.column_stack([TIME, FORCE, CURRENT])
        np.save(tmp_path / "run.npy", matrix)
        write_npz(tmp_path / "run.npz", {"data": matrix})
        write_h5(tmp_path / "run.h5", {"data": matrix})
        write_mat(tmp_path / "run.mat", {"data": matrix})
        same(tmp_path / "run.npy", "[:, 0]", "[:,1]", "[ : , 2 ]")
        same(tmp_path / "run.npy", 1, 2, 3)
        for name in ("run.npz", "run.h5", "run.mat"):
            same(tmp_path / name, "data[:, 0]", "data[:,1]", "data[:, 2]")

    def test_an_index_that_is_too_large(self, tmp_path):
        write_mat(tmp_path / "run.mat", {"data": np.column_stack([TIME, FORCE, CURRENT])})
        assert failure(tmp_path / "run.mat", "data[:, 3]").message.endswith(", 3), the index 3 must be from 0 to 2")

    @pytest.mark.parametrize(("shape", "column"), [((-1,), "[:]"), ((-1, 1), "[:, 0]"), ((1, -1, 1), "[0, :, 0]")])
    def test_a_vector_without_a_name(self, tmp_path, shape, column):
        """One column or one row of a matrix is a vector, too."""
        np.save(tmp_path / "run.npy", FORCE.reshape(shape))
        assert open_reader(tmp_path / "run.npy").names == (column,)
        for name in (1, column):
            np.testing.assert_array_equal(read(tmp_path / "run.npy", name)[0], FORCE)

    def test_rows_are_samples_if_there_are_more_of_them(self, tmp_path):
        """Simulink's "To File" writes one channel in a row."""
        write_mat(tmp_path / "run.mat", {"ans": np.vstack([TIME, FORCE, CURRENT])})
        same(tmp_path / "run.mat", "ans[0, :]", "ans[1, :]", "ans[2, :]")
        same(tmp_path / "run.mat", 1, 2, 3)

    def test_further_axes_follow_each_other(self, tmp_path):
        """Samples, channels, realisations, periods: the periods of a channel in their order."""
        cube = np.random.default_rng(0).normal(size=(50, 3, 2, 4))
        np.save(tmp_path / "run.npy", cube)
        found = read(tmp_path / "run.npy", "[:, 1, 0, :]")[0]
        np.testing.assert_array_equal(found, np.concatenate([cube[:, 1, 0, period] for period in range(4)]))
        assert len(open_reader(tmp_path / "run.npy").names) == 24

    @pytest.mark.parametrize("column", ["[:, 3]", "[:]", "[:, 0, 0]", "[0, 0]", "[:, -1]"])
    def test_what_does_not_fit(self, tmp_path, column):
        np.save(tmp_path / "run.npy", np.ones((7, 3)))
        error = failure(tmp_path / "run.npy", column)
        assert "(7, 3)" in error.message

    def test_a_vector_in_npy(self, tmp_path):
        np.save(tmp_path / "run.npy", FORCE)
        np.testing.assert_array_equal(read(tmp_path / "run.npy", "[:]")[0], FORCE)
        np.testing.assert_array_equal(read(tmp_path / "run.npy", 1)[0], FORCE)


def mat_73(path):
    """HDF5 file with the header that MATLAB puts in front."""
    file = h5py.File(path, "w", userblock_size=512)
    file.close()
    header = b"MATLAB 7.3 MAT-file, Platform: PCWIN64, Created on: Tue Nov 21 2023 HDF5 schema 1.00 .".ljust(116)
    with path.open("r+b") as stream:
        stream.write(header + b"\0" * 8 + b"\x00\x02IM")
    return h5py.File(path, "r+")


def numeric(group, name, values):
    """Array as MATLAB writes it: axes reversed."""
    data = group.create_dataset(name, data=np.transpose(values))
    data.attrs["MATLAB_class"] = np.bytes_("double")
    return data


def chars(group, name, word):
    data = group.create_dataset(name, data=np.array([[ord(c)] for c in word], dtype=np.uint16))
    data.attrs["MATLAB_class"] = np.bytes_("char")
    return data


def recording(fast, slow):
    """What ControlDesk records: two rasters, signals with their index."""
    names = ['"Model Root"/"ADC"/"Force"', "Model Root/ADC\\Displacement", '"Model Root"/"Temperature"']
    x = np.array([("t", fast[0]), ("t", slow[0])], dtype=[("Name", "O"), ("Data", "O")])
    y = np.array([(names[0], fast[1], 1), (names[1], fast[2], 1), (names[2], slow[1], 2)],
                 dtype=[("Name", "O"), ("Data", "O"), ("XIndex", "O")])  # fmt: skip
    return {"X": x, "Y": y, "Description": {"General": "", "Rec": 7}}


class TestMatlab:
    fast = (TIME, FORCE, CURRENT)
    slow = (TIME[::3], np.array([20.0, 21.0, 22.0]))

    def recording_73(self, path):
        with mat_73(path) as file:
            group = file.create_group("run1")
            group.attrs["MATLAB_class"] = np.bytes_("struct")
            store = file.create_group("#refs#")
            found = recording(self.fast, self.slow)
            for part in ("X", "Y"):
                fields = group.create_group(part)
                fields.attrs["MATLAB_class"] = np.bytes_("struct")
                for name in found[part].dtype.names:
                    items = []
                    for n, value in enumerate(found[part][name]):
                        key = f"{part}{name}{n}"
                        write = chars if isinstance(value, str) else numeric
                        items.append(write(store, key, value if isinstance(value, str) else np.atleast_2d(value)).ref)
                    fields.create_dataset(
                        name, data=np.array(items, dtype=h5py.ref_dtype)[:, None], dtype=h5py.ref_dtype
                    )
            numeric(group, "Captured", np.array([[3.0]]))

    def recorded(self, tmp_path, version):
        path = tmp_path / "run1.mat"
        if version == "7.3":
            self.recording_73(path)
        else:
            savemat(path, {"run1": recording(self.fast, self.slow)})
        return path

    @pytest.mark.parametrize("version", ["5", "7.3"])
    def test_signals_of_dspace(self, tmp_path, version):
        path = self.recorded(tmp_path, version)
        with open_reader(path) as reader:
            assert len(reader.names) == 3
            force = reader.resolve("Force")
            assert force == '"Model Root"/"ADC"/"Force"'
            np.testing.assert_array_equal(reader.read([force])[force], FORCE)
            np.testing.assert_array_equal(reader.time_of(force), TIME)
            np.testing.assert_array_equal(reader.time_of(reader.resolve("Displacement")), TIME)
            np.testing.assert_array_equal(reader.time_of(reader.resolve("Temperature")), TIME[::3])

    def test_a_single_signal(self, tmp_path):
        savemat(tmp_path / "a.mat", {"a": {"X": {"Name": "t", "Data": TIME}, "Y": {"Name": "F", "Data": FORCE}}})
        np.testing.assert_array_equal(read(tmp_path / "a.mat", "F")[0], FORCE)

    def test_equal_names_are_told_by_their_paths(self, tmp_path):
        y = np.array([("Out1", "Root/ADC 1", FORCE), ("Out1", "Root/ADC 2", CURRENT)],
                     dtype=[("Name", "O"), ("Path", "O"), ("Data", "O")])  # fmt: skip
        savemat(tmp_path / "a.mat", {"a": {"X": {"Data": TIME}, "Y": y}})
        np.testing.assert_array_equal(read(tmp_path / "a.mat", "Root/ADC 2/Out1")[0], CURRENT)
        assert "found 2 columns 'Out1'" in failure(tmp_path / "a.mat", "Out1").message

    def test_structures(self, tmp_path):
        signals = np.array([("F", FORCE), ("i", CURRENT)], dtype=[("label", "O"), ("values", "O")])
        savemat(tmp_path / "a.mat", {"scope": {"time": TIME, "signals": signals}, "note": "by hand", "fs": 1000.0})
        same(tmp_path / "a.mat", "scope.time", "scope.signals(1).values", "scope.signals(2).values")

    def test_version_4(self, tmp_path):
        savemat(tmp_path / "a.mat", COLUMNS, format="4")
        same(tmp_path / "a.mat", *COLUMNS)

    def test_version_73_by_hand(self, tmp_path):
        with mat_73(tmp_path / "a.mat") as file:
            numeric(file, "data", np.column_stack([TIME, FORCE, CURRENT]))
            chars(file, "remark", "fine")
            numeric(file, "scalar", np.array([[1.0]]))
        same(tmp_path / "a.mat", "data[:, 0]", "data[:, 1]", "data[:, 2]")


class TestTdms:
    def test_time_by_the_waveform_properties(self, tmp_path):
        properties = {"wf_increment": 1e-3, "wf_start_offset": 0.5}
        with TdmsWriter(tmp_path / "a.tdms") as writer:
            writer.write_segment(
                [ChannelObject("bench", "force", FORCE, properties), ChannelObject("bench", "x", CURRENT)]
            )
        with open_reader(tmp_path / "a.tdms") as reader:
            np.testing.assert_allclose(reader.time_of("bench/force"), 0.5 + TIME, rtol=0, atol=1e-15)
            assert reader.time_of("bench/x") is None

    def test_scaling_is_applied(self, tmp_path):
        scale = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 2.0,
                 "NI_Scale[0]_Linear_Y_Intercept": 1.0, "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF}  # fmt: skip
        with TdmsWriter(tmp_path / "a.tdms") as writer:
            writer.write_segment([ChannelObject("bench", "force", FORCE, scale)])
        np.testing.assert_allclose(read(tmp_path / "a.tdms", "force")[0], 2 * FORCE + 1)


def test_without_nptdms(tmp_path, monkeypatch):
    write_tdms(tmp_path / "a.tdms", {"force": FORCE})
    monkeypatch.setattr("piezoharvest.readers.find_spec", lambda name: None)
    with pytest.raises(ReadError, match=r"the package nptdms is missing, .*pip install 'piezoharvest\[tdms\]'"):
        open_reader(tmp_path / "a.tdms")
