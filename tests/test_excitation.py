"""A recorded force is read as a campaign's records are, from any file that these may have."""

from __future__ import annotations

import numpy as np
import pytest
from messages import is_sentence
from records.instrument_files import FORCE, NAMES, lines, random_layout, rows
from scipy.io import savemat

from piezoharvest import Record, System, Transducer, simulate
from piezoharvest.description.excitation import ramps_through
from piezoharvest.description.parameters import ParameterError
from piezoharvest.output import write_table


def record(path, column="force", sample_rate=100.0, **keys):
    return Record(file=str(path), column=column, sample_rate=sample_rate, **keys)


def written(folder, text, encoding="utf-8"):
    (folder / "force.csv").write_bytes(text.encode(encoding))
    return folder / "force.csv"


def failure(path, *arguments, **keys) -> ParameterError:
    with pytest.raises(ParameterError) as caught:
        record(path, *arguments, **keys)
    assert is_sentence(caught.value.message)
    assert len(caught.value.message) < 700
    return caught.value


@pytest.mark.parametrize("seed", range(300, 340))
def test_text_of_instruments(tmp_path, seed):
    layout = random_layout(seed)
    # The second column is in newtons wherever the file states a unit.
    found = record(written(tmp_path, layout.text(), layout.encoding), NAMES[1], sample_rate=1000.0)
    np.testing.assert_array_equal(found.values, FORCE)


@pytest.mark.parametrize("ending", ["npz", "h5", "parquet", "csv"])
def test_other_formats(tmp_path, ending):
    write_table({"force": FORCE}, tmp_path / f"force.{ending}")
    np.testing.assert_array_equal(record(tmp_path / f"force.{ending}").values, FORCE)


def test_a_column_of_a_complex_array(tmp_path):
    savemat(tmp_path / "force.mat", {"data": np.column_stack([FORCE, 1j * FORCE])})
    np.testing.assert_array_equal(record(tmp_path / "force.mat", "data[:, 0]").values, FORCE)
    assert "found complex numbers" in failure(tmp_path / "force.mat", "data[:, 1]").message


def test_pieces_between_samples_are_those_through_them(tmp_path):
    found = record(written(tmp_path, lines(rows())), 2)
    wanted = ramps_through(np.arange(len(FORCE)) / 100.0, FORCE)
    for one, other in zip(found.signal(), wanted, strict=True):
        np.testing.assert_array_equal(one, other)


def test_by_number(tmp_path):
    np.testing.assert_array_equal(record(written(tmp_path, lines(rows())), 2).values, FORCE)


@pytest.mark.parametrize("column", [0, -1, 1.5, True, ["force"]])
def test_no_column(tmp_path, column):
    assert failure(written(tmp_path, lines(rows())), column).key == "column"


@pytest.mark.parametrize(
    ("name", "factor"), [("force (mN)", 1e-3), ("force [kN]", 1e3), ("force_mN", 1e-3), ("force_V", 1)]
)
def test_units(tmp_path, name, factor):
    path = written(tmp_path, lines(f"t,{name},x", rows()))
    np.testing.assert_allclose(record(path, name).values, factor * FORCE, rtol=1e-15)


def test_what_is_no_force(tmp_path):
    error = failure(written(tmp_path, lines("t,CH1,x", "s,V,m", rows())), "CH1")
    assert (error.key, "found the unit 'V' in column 'CH1'" in error.message) == ("column", True)


def test_rows_that_begin_with_a_comment_are_no_samples(tmp_path):
    table = rows()
    text = lines("t,force,x", table[:10], "# the next one is wrong", "#" + table[0], table[10:])
    np.testing.assert_array_equal(record(written(tmp_path, text)).values, FORCE)


def test_two_columns_of_one_name(tmp_path):
    assert "found 2 columns 'force'" in failure(written(tmp_path, lines("t,force,force", rows()))).message


def test_where_the_table_begins(tmp_path):
    path = written(tmp_path, lines("1,2,3", "4,5,6", "7,8,9", "", "t,force,x", rows()))
    assert "header_row" in failure(path).message
    for key in ({"skip_rows": 3}, {"header_row": 5}):
        np.testing.assert_array_equal(record(path, **key).values, FORCE)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (lines("t,force,x", rows()[:5], "0.005,OVERLOAD,1", rows()[6:]), "found 'OVERLOAD', must be a number (in "),
        (lines("t,force,x", rows()[:5], "0.005,,1", rows()[6:]), "row 7, must be a finite number"),
        (lines("t,force,x", rows()[:5]) + "0.005,-1.", "found 2 columns, but 3 in the rows above"),
        ("x" * 3_000_000 + "\n", "found no rows of numbers (line 1 is 'xxx"),
    ],
    ids=["text", "missing", "cut off", "no numbers"],
)
def test_what_is_wrong(tmp_path, text, found):
    assert found in failure(written(tmp_path, text)).message


ACCELERATION = {"quantity": "base_acceleration"}


@pytest.mark.parametrize(
    "name, keys, factor",
    [
        ("a", ACCELERATION, 1.0),
        ("a", {**ACCELERATION, "unit": "g"}, 9.80665),
        ("a [g]", ACCELERATION, 9.80665),
        ("a [g]", {**ACCELERATION, "unit": "g"}, 9.80665),
        ("a [mV]", {**ACCELERATION, "unit": "g", "gain": 0.01}, 0.0980665),
        ("a", {**ACCELERATION, "gain": -2.0}, -2.0),
        ("f", {"unit": "kN"}, 1e3),
        ("f [V]", {"gain": 50.0}, 50.0),
    ],
)
def test_units_and_gains(tmp_path, name, keys, factor):
    path = written(tmp_path, f"{name}\n1.0\n-2.0\n4.0\n")
    found = record(path, name[0], **keys)
    np.testing.assert_allclose(found.values, factor * np.array([1.0, -2.0, 4.0]), rtol=1e-12)
    assert found.base == (name[0] == "a")


@pytest.mark.parametrize(
    "name, keys, key",
    [
        ("a [g]", {}, "column"),
        ("a", {"unit": "g"}, "unit"),
        ("a", {"unit": "bananas"}, "unit"),
        ("a [g]", {**ACCELERATION, "unit": "m/s^2"}, "unit"),
        ("a", {**ACCELERATION, "gain": 0.0}, "gain"),
        ("a", {"quantity": "noise"}, "quantity"),
    ],
)
def test_wrong_units_and_gains(tmp_path, name, keys, key):
    assert failure(written(tmp_path, f"{name}\n1.0\n-2.0\n"), "a", **keys).key == key


def test_base_acceleration_is_the_force_of_the_mass(tmp_path):
    path = written(tmp_path, "a\n" + "\n".join(f"{np.sin(0.3 * n):.17g}" for n in range(200)) + "\n")
    system = System(Transducer(mass=0.01, damping=0.06, stiffness=986.0, coupling=1e-3, capacitance=4e-8))
    base = simulate(system, record(path, "a", quantity="base_acceleration"))
    force = simulate(system, record(path, "a", gain=-0.01))
    np.testing.assert_allclose(base.waveforms.displacement, force.waveforms.displacement, rtol=1e-12)


CLOCKS = {"even": 0.01 * np.arange(40), "rounded": np.round(0.01 * np.arange(40), 1), "falling": np.arange(40.0)[::-1]}


@pytest.mark.parametrize("clock", CLOCKS)
def test_times_in_the_file_that_are_those_of_the_sample_rate(tmp_path, clock):
    """Rounded ones may be; what falls is no time."""
    rows = "".join(f"{time!r},{n}\n" for n, time in enumerate(CLOCKS[clock].tolist()))
    assert record(written(tmp_path, "time_s,force\n" + rows)).samples == 40


@pytest.mark.parametrize(
    ("header", "step", "key", "said"),
    [
        ("time_s", 0.02, "sample_rate", "found 100 Hz, but the times in "),
        ("time [ms]", 5.0, "sample_rate", "have 200 Hz: give the same one"),
        ("time_s", None, "file", "0.11 s after 0.19 s, must be even"),
    ],
)
def test_times_in_the_file_that_contradict_the_sample_rate(tmp_path, header, step, key, said):
    times = np.arange(40) * (0.01 if step is None else step)
    if step is None:
        times[20:] += 0.1
    rows = "".join(f"{time:.6g},{n}\n" for n, time in enumerate(times))
    found = failure(written(tmp_path, f"{header},force\n{rows}"))
    assert found.key == key
    assert said in found.message
