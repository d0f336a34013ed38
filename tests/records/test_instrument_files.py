"""Text as instruments write it: numbers are read back to the last bit, and what is unclear is said, not guessed."""

from __future__ import annotations

import numpy as np
import pytest
from instrument_files import COLUMNS, FORCE, NAMES, SAMPLES, TIME, UNITS, VOLTAGE, lines, random_layout, rows
from messages import is_sentence

from piezoharvest.readers import ReadError, open_reader

PREAMBLES = {
    "Tektronix MSO": (lines("Model,MSO58", "", "Point Format,Y,Y", "Horizontal Scale,0.2,", "Sample Interval,0.001,",
        "Record Length,60,", "Vertical Units,V,V", ",,", "TIME,CH1,CH2", rows()), ["TIME", "CH1", "CH2"]),
    "Siglent": (lines("Record Length,Analog:60", "Vertical Scale,2.00,2.00", "Vertical Offset,0.0,0.0",
        "Horizontal Units,s", "Source,CH1,CH2", "Second,Newton,Volt", rows()), ["Source", "CH1", "CH2"]),
    "Keysight scope": (lines("x-axis,1,2", "second,Volt,Volt", rows(form="{:+.9E}")), ["x-axis", "1", "2"]),
    "Keysight E4990A": (lines("!CSV A.01.01", "!Date: Fri Mar 01 10:00:00 2024", "", "BEGIN CH1_DATA",
        "Frequency(Hz), |Z|(ohm)-data, thetaz(deg)-data", rows(", ", form="{:+.9E}"), "END"),
        ["Frequency", "|Z|", "thetaz"]),
    "PicoScope": (lines("Time,Channel A,Channel B", "(ms),(mV),(V)", "", rows()), ["Time", "Channel A", "Channel B"]),
    "LeCroy": (lines("LECROYWR64Xi-A,21087,Waveform", "Segments,1,SegmentSize,60",
        "Segment,TrigTime,TimeSinceSegment1",
        "#1,15-May-2014 12:01:30,0", "Time,Ampl,B", rows()), ["Time", "Ampl", "B"]),
    "LabVIEW": (lines("LabVIEW Measurement\t", "Decimal_Separator\t,", "***End_of_Header***\t", "\t", "Channels\t2\t\t",
        "Samples\t60\t60\t", "X0\t0,0\t0,0\t", "Delta_X\t0,001\t0,001\t", "***End_of_Header***\t\t\t",
        "X_Value\tForce\tVoltage\tComment", rows("\t", ",")), ["X_Value", "Force", "Voltage"]),
    "Polytec": (lines("Source File Name:\tx.pvd", "Signal:\tH", "Time\tVelocity\tV", "[ s ]\t[ m/s ]\t[ V ]",
        rows("\t")), ["Time", "Velocity", "V"]),
    "Hioki": (lines('"File name","AUTO_001.CSV"', '"CH1","ON","U"', '"Time","CH1[V]","CH2[mV]"', rows()),
        ["Time", "CH1", "CH2"]),
    "Yokogawa": (lines('"Header Size","16"', '"TraceName","CH1","CH2"', '"HResolution","1e-3","1e-3"', "",
        ["," + row for row in rows()]), [2, 3, 4]),
    "Rohde & Schwarz": (lines("in s,C1 in V,C2 in V", rows()), ["in s", "C1", "C2"]),
    "spreadsheet": (lines("sep=;", "a;b;c", rows(";")), ["a", "b", "c"]),
    "sections": (lines("[Header]", "Device=X, Y", "Rate=1000", "[Data]", "a,b,c", rows()), ["a", "b", "c"]),
    "names above a mark": (lines("a,b,c", "[Data]", rows()), ["a", "b", "c"]),
    "dashes": (lines("a    b   c", "-----------", rows("   ")), ["a", "b", "c"]),
    "logger with dates": (lines("Logger,X1,", "Interval,0.001,s", "Range,10,V", "Samples,60,", "", "date,a,b,c",
        [f"2024-03-01 10:00:00.{n:03d},{row}" for n, row in enumerate(rows())]), ["a", "b", "c"]),
    "DIN": (lines("t/s\tF / N\tU in V", rows("\t", ",")), ["t", "F", "U"]),
    "quoted decimal commas": (lines('"a","b","c"', ['"' + row.replace(";", '","') + '"' for row in rows(";", ",")]),
        ["a", "b", "c"]),
    "blanks and quoted names": (lines('"time s" "force N" "voltage V"', rows("  ")),
        ["time s", "force N", "voltage V"]),
}  # fmt: skip


def read(path, *columns, **where):
    with open_reader(path, **where) as reader:
        names = [reader.resolve(column) for column in columns]
        values = reader.read(names)
        return [values[name] for name in names], reader


def written(folder, text, encoding="utf-8"):
    path = folder / "run.csv"
    path.write_bytes(text.encode(encoding))
    return path


def same(path, *columns, **where):
    """The three columns come back as they were; returns the reader."""
    found, reader = read(path, *columns, **where)
    for values, wanted in zip(found, COLUMNS, strict=True):
        np.testing.assert_array_equal(values, wanted)
    return reader


def failure(path, *columns, **where) -> ReadError:
    with pytest.raises(ReadError) as caught:
        read(path, *columns, **where)
    assert is_sentence(caught.value.message)
    assert len(caught.value.message) < 600
    return caught.value


@pytest.mark.parametrize("seed", range(300))
def test_any_combination(tmp_path, seed):
    layout = random_layout(seed)
    reader = same(written(tmp_path, layout.text(), layout.encoding), *NAMES)
    first = layout.text().split(layout.ending)[reader.first_row - 1]
    assert "0.295" in first.replace(",", ".") or "0.0" in first.replace(",", ".")
    stated = [reader.unit(name) for name in reader.names[:3]]
    assert [unit and unit.text for unit in stated] == (list(UNITS) if layout.units else [None] * 3)
    assert (reader.left_out is not None) == (layout.footer == "statistics")


@pytest.mark.parametrize("instrument", PREAMBLES)
def test_preambles(tmp_path, instrument):
    text, names = PREAMBLES[instrument]
    reader = same(written(tmp_path, text), *names)
    assert text.splitlines()[reader.first_row - 1] != text.splitlines()[reader.first_row - 2]
    assert len(text.splitlines()) - reader.first_row + 1 - SAMPLES in (0, 1)


def test_settings_beside_the_first_samples(tmp_path):
    """Older oscilloscopes write them into the first columns."""
    beside = ["Record Length,60,Points", "Sample Interval,1e-3,s", "Source,CH1,", "Vertical Units,V,"]
    beside += [",,"] * (SAMPLES - len(beside))
    text = lines([f"{some},{row}," for some, row in zip(beside, rows(), strict=True)])
    reader = same(written(tmp_path, text), 4, 5, 6)
    assert reader.first_row == 1


def test_rigol_numbers_its_samples(tmp_path):
    table = [f"{n},{f!r},{v!r},," for n, (f, v) in enumerate(zip(FORCE.tolist(), VOLTAGE.tolist(), strict=True))]
    text = lines("X,CH1,CH2,Start,Increment,", "Sequence,Volt,Volt,-6.0e-04,1.0e-06", table)
    (force, voltage), reader = read(written(tmp_path, text), "CH1", "CH2")
    np.testing.assert_array_equal(force, FORCE)
    np.testing.assert_array_equal(voltage, VOLTAGE)
    assert reader.unit("CH1").text == "Volt"


def test_a_remark_behind_the_first_row_costs_no_sample(tmp_path):
    first, *others = rows("\t")
    same(written(tmp_path, lines("X\tF\tU\tComment", first + "\tstarted by hand", others)), "X", "F", "U")
    error = failure(written(tmp_path, lines("X\tF\tU", first + "\tstarted by hand", others)), "X", "F", "U")
    assert (error.row, error.message) == (2, "found 4 columns, but 3 in the rows above")


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [("mV", "V", 1e-3), ("µm", "m", 1e-6), ("kN", "N", 1e3), ("Ω", "ohm", 1.0), ("kΩ", "ohm", 1e3),
     ("°", "rad", np.pi / 180), ("m/s²", "m/s^2", 1.0), ("m/s^2", "m/s^2", 1.0), ("g", "m/s^2", 9.80665),
     ("KHZ", "Hz", 1e3), ("Volts", "V", 1.0),
     ("milliseconds", "s", 1e-3), ("min", "s", 60.0), ("um/N", "m/N", 1e-6), ("V/(m/s^2)", "V/(m/s^2)", 1.0),
     ("dB", "dB", 1.0), ("lbf", "N", 4.4482216152605), ("µm/m", "strain", 1e-6),
     ("µε", "strain", 1e-6), ("microstrain", "strain", 1e-6), ("(mm/s)/N", "(m/s)/N", 1e-3)],
)  # fmt: skip
@pytest.mark.parametrize("form", ["{} ({})", "{}[{}]", "{}({})-data"])
def test_units_in_names(tmp_path, unit, si, factor, form):
    path = written(tmp_path, lines(";".join(["t", form.format("signal", unit), "x"]), rows(";")))
    with open_reader(path) as reader:
        found = reader.unit(reader.resolve("signal"))
    assert (found.text, found.si, found.firm) == (unit, si, True)
    assert found.factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("name", ["CH1", "A", "m", "signal (arb.)", "signal [raw]", "force_2", "response", "in"])
def test_no_unit(tmp_path, name):
    path = written(tmp_path, lines(f"t;{name};x", rows(";")))
    with open_reader(path) as reader:
        assert reader.unit(name) is None


class TestBelow:
    """What stands below the table or interrupts it."""

    @pytest.mark.parametrize(
        "footer",
        [["", "Mean,0,0", "Std,1,1"], ["Mean,0.5,1"], ['"Statistics"', '"Mean","0.1","0.2"'], ["Samples,60"],
         ["Mean:", ",0.1,0.2"], ["rms 0.7 N"], ["-" * 40, "Max,1,2,3,4"]],
    )  # fmt: skip
    def test_statistics(self, tmp_path, footer):
        reader = same(written(tmp_path, lines("a,b,c", rows(), footer)), "a", "b", "c")
        numbers = any(cell.strip('"').replace(".", "").isdigit() for line in footer for cell in line.split(","))
        assert (reader.left_out is not None) == numbers

    def test_statistics_are_no_samples_of_the_columns_behind_their_names(self, tmp_path):
        (force, voltage), _ = read(written(tmp_path, lines("a,b,c", rows(), "Mean,0,0")), "b", "c")
        assert len(force) == len(voltage) == SAMPLES

    @pytest.mark.parametrize("between", [[], [""], ["", "", ""], ["# pause"], ["a,b,c"], ["", "a,b,c"]])
    def test_the_table_goes_on(self, tmp_path, between):
        table = rows()
        text = lines("a,b,c", table[:20], between, table[20:])
        reader = same(written(tmp_path, text), "a", "b", "c")
        found = text.splitlines()
        numbering = np.broadcast_to(reader.numbering, SAMPLES) + (0 if between else np.arange(SAMPLES))
        assert [found[row - 1] for row in numbering] == table

    def test_another_table_is_not_read_and_named(self, tmp_path):
        text = lines("BEGIN CH1", "f(Hz),R(ohm),X(ohm)", rows(), "END", "", "BEGIN CH2", "f(Hz),C(F),D", rows()[:5])
        reader = same(written(tmp_path, text), "f", "R", "X")
        assert text.splitlines()[reader.left_out[0] - 1] == rows()[0]

    def test_another_table_with_the_same_names(self, tmp_path):
        """Impedance analysers write one trace below the other: phase is no further sweep of the magnitude."""
        text = lines('"TRACE: A"', "f\tRe\tIm", rows("\t"), "", '"TRACE: B"', "f\tRe\tIm", rows("\t")[:9])
        reader = same(written(tmp_path, text), "f", "Re", "Im")
        assert reader.left_out[0] == SAMPLES + 6

    def test_a_table_of_another_width(self, tmp_path):
        reader = same(written(tmp_path, lines("a,b,c", rows(), "", "x,y", "1,2", "3,4")), "a", "b", "c")
        assert reader.left_out == (SAMPLES + 4, "1 2")

    @pytest.mark.parametrize("text", ["PAUSE", "OVERLOAD,1,2", "!!"])
    def test_text_among_the_rows(self, tmp_path, text):
        table = rows()
        error = failure(written(tmp_path, lines("a,b,c", table[:20], text, table[20:])), "a", "b", "c")
        assert error.row == 22
        assert text.split(",")[0] in error.message

    def test_rows_of_delimiters_are_missing_values_where_others_follow(self, tmp_path):
        table = rows()
        (a, _), _ = read(written(tmp_path, lines("a,b,c", table[:20], ",,", table[20:], ",,", ",,")), "a", "b")
        assert len(a) == SAMPLES + 1
        assert np.flatnonzero(np.isnan(a)).tolist() == [20]

    @pytest.mark.parametrize("kept", [1, 5, 9])
    def test_a_last_row_that_is_cut_off(self, tmp_path, kept):
        text = lines("a,b,c", rows()) + "0.06,-0.5,1.25"[:kept]
        assert failure(written(tmp_path, text), "a", "b", "c").row == SAMPLES + 2

    def test_delimiters_at_the_end_of_some_rows(self, tmp_path):
        table = [row + ("," if n % 7 == 3 else "") for n, row in enumerate(rows())]
        same(written(tmp_path, lines("a,b,c", table)), "a", "b", "c")


def test_a_row_of_a_preamble_is_a_sample_where_it_comes_again(tmp_path):
    table = rows()
    text = lines("limits", table[7], "a,b,c", table)
    same(written(tmp_path, text), "a", "b", "c", header_row=3)
    table.insert(20, "# remark")  # which has the rows looked at one by one
    same(written(tmp_path, lines("limits", table[7], "a,b,c", table)), "a", "b", "c")


@pytest.mark.parametrize(
    ("name", "asked"), [("x (\u00b5m)", "x (\u03bcm)"), ("R (\u2126)", "R (\u03a9)"), ("time\u00a0(s)", "time (s)")]
)
def test_signs_that_look_the_same(tmp_path, name, asked):
    assert name != asked
    path = written(tmp_path, lines(f"{name},b,c", rows()))
    np.testing.assert_array_equal(read(path, asked)[0][0], TIME)


@pytest.mark.parametrize(
    ("name", "text"),
    [("my_force_kN", "kN"), ("base_acceleration_m_per_s2", "m_per_s2"), ("x_m_s2", "m_s2"), ("t_ms", "ms")],
)
def test_a_name_may_end_in_a_unit(tmp_path, name, text):
    with open_reader(written(tmp_path, lines(f"a,{name},c", rows()))) as reader:
        assert (reader.unit(name).text, reader.unit(name).firm) == (text, False)


class TestSaidOtherwise:
    CALIBRATION = lines("Calibration", "1,2,3", "4,5,6", "7,8,9", "", "a,b,c", rows())

    def test_the_first_table_is_the_table(self, tmp_path):
        path = written(tmp_path, self.CALIBRATION)
        error = failure(path, "a")
        assert "in the table that begins in line 2" in error.message
        assert "skip_rows" in error.message
        assert "header_row" in error.message
        np.testing.assert_array_equal(read(path, 2)[0][0][:3], [2, 5, 8])

    @pytest.mark.parametrize("where", [{"skip_rows": 4}, {"skip_rows": 5}, {"header_row": 6}])
    def test_which_one(self, tmp_path, where):
        assert same(written(tmp_path, self.CALIBRATION), "a", "b", "c", **where).first_row == 7

    def test_names_right_above_the_table_count_where_they_are_skipped(self, tmp_path):
        same(written(tmp_path, self.CALIBRATION), "a", "b", "c", skip_rows=6)

    def test_a_header_that_is_no_header_is_skipped(self, tmp_path):
        path = written(tmp_path, lines("Sample Interval,0.001", rows()))
        assert "but 2 in the header (line 1: 'Sample Interval,0.001'); skip_rows" in failure(path, 1).message
        same(path, 1, 2, 3, skip_rows=1)

    def test_header_row_that_does_not_fit(self, tmp_path):
        error = failure(written(tmp_path, self.CALIBRATION), "a", header_row=1)
        assert "found 1 name in 'Calibration', but 3" in error.message

    @pytest.mark.parametrize("where", [{"skip_rows": 1000}, {"header_row": 1000}])
    def test_lines_that_are_not_there(self, tmp_path, where):
        assert (
            f"the file has only {SAMPLES + 6} lines"
            in failure(written(tmp_path, self.CALIBRATION), "a", **where).message
        )

    def test_names_of_many_preamble_lines(self, tmp_path):
        text = lines([f"setting {n}" for n in range(3000)], "a,b,c", rows())
        assert "skip_rows" in failure(written(tmp_path, text), "a").message
        same(written(tmp_path, text), "a", "b", "c", skip_rows=3000)

    def test_other_formats_have_no_lines(self, tmp_path):
        np.savez(tmp_path / "run.npz", a=TIME)
        error = failure(tmp_path / "run.npz", "a", skip_rows=3)
        assert error.message == "skip_rows may be given for text files only (.csv, .dat, .lvm, .tsv, .txt)"


class TestRefused:
    @pytest.mark.parametrize(
        "begins",
        ["x" * 3_000_000, ",".join(f"x{n}" for n in range(300_000)), "x" * 20_000_000, "x"],
        ids=["3 MB", "300,000 names", "20 MB", "a letter"],
    )
    def test_what_was_seen_is_said_in_few_words(self, tmp_path, begins):
        error = failure(written(tmp_path, begins + "\ny\nz\n"), "time")
        assert repr(begins[:60])[:-1] in error.message

    def test_a_missing_column_of_long_names(self, tmp_path):
        text = lines(",".join(f"{n}" * 5000 for n in "abc"), rows())
        failure(written(tmp_path, text), "d" * 5000)

    def test_one_column_with_decimal_commas_or_two(self, tmp_path):
        text = lines("force", [f"0,{n}" for n in range(10, 40)])
        assert "decimal comma" in failure(written(tmp_path, text), 1).message

    def test_numbers_tell_columns_of_one_name_apart(self, tmp_path):
        path = written(tmp_path, lines("a,b,b", rows()))
        assert "found 2 columns 'b'" in failure(path, "b").message
        same(path, "a", 2, 3)

    def test_thousands(self, tmp_path):
        error = failure(written(tmp_path, lines("a;b", "1,5;2,5", "2,5;3,5", "3,5;4,5", "4,5;1.234,5")), "b")
        assert (error.column, error.row) == ("b", 5)
