"""Formats of instruments, in files written here after their description: values, units and times come back."""

from __future__ import annotations

import numpy as np
import pytest
from messages import is_sentence

from piezoharvest.readers import ReadError, open_reader
from piezoharvest.records import load_campaign

COUNT = 40
RATE = 51200.0
RANDOM = np.random.default_rng(35)
FORCE = RANDOM.normal(size=COUNT).round(6)
VOLTAGE = (1000 * RANDOM.normal(size=COUNT)).round(6)  # mV

CAMPAIGN = """
[transducer]
mass = 0.01
damping = 0.0628
stiffness = 986.96
coupling = 1e-3
capacitance = 40e-9
"""


def failure(path, *columns, **lines):
    with pytest.raises(ReadError) as caught, open_reader(path, **lines) as reader:
        reader.read([reader.resolve(column) for column in columns])
    assert is_sentence(caught.value.message)
    return caught.value.message


def campaign(folder, record):
    """A campaign of one record that names its columns itself."""
    (folder / "campaign.toml").write_text(f"{CAMPAIGN}\n[[records]]\nload_resistance = 1e5\n{record}\n")
    return load_campaign(folder / "campaign.toml")


def labview(columns="One", decimal=".", segments=1, step=1e-3) -> str:
    """A file of two channels as the specification of National Instruments has it (ni.com/tutorial/4139)."""
    between = "\t\t" if columns == "Multi" else "\t"

    def tag(name, *values):
        return f"{name}\t{between.join(values)}\t\n"

    head = [
        "LabVIEW Measurement", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
        f"Decimal_Separator\t{decimal}", f"Multi_Headings\t{'Yes' if segments > 1 else 'No'}", f"X_Columns\t{columns}",
        "Time_Pref\tRelative", "Operator\tme", "Date\t2024/03/01", "Time\t10:00:00.2846",
        "***End_of_Header***", "",
    ]  # fmt: skip
    text = "".join(f"{line}\t\n" for line in head)
    for segment in range(segments):
        text += tag("Channels", "2") + tag("Samples", str(COUNT), str(COUNT)) + tag("Y_Unit_Label", "N", "mV")
        text += tag("X_Dimension", "Time", "Time") + tag("X0", "0.0000000000000000E+0", "0.0000000000000000E+0")
        text += tag("Delta_X", f"{step:.6f}", f"{step:.6f}") + "***End_of_Header***\t\t\t\n"
        text += "X_Value\tF\tX_Value\tU\tComment\n" if columns == "Multi" else "X_Value\tF\tU\tComment\n"
        for n, (force, voltage) in enumerate(zip(FORCE, VOLTAGE, strict=True)):
            time = "" if columns == "No" else f"{n * step:.6f}"
            second = f"\t{time}" if columns == "Multi" else ""
            remark = "\tby hand" if n == 5 else ""
            text += f"{time}\t{force + 10 * segment:.6f}{second}\t{voltage:.6f}{remark}\n"
        text += "\n"
    return text if decimal == "." else text.replace(".", decimal)


RECORD = """file = "run.lvm"
channels = { force = { column = "F" }, voltage = { column = "U" } }
"""


class TestLabView:
    @pytest.mark.parametrize("decimal", [".", ","])
    @pytest.mark.parametrize("columns", ["No", "One", "Multi"])
    def test_columns_of_times(self, tmp_path, columns, decimal):
        (tmp_path / "run.lvm").write_text(labview(columns, decimal), newline="\r\n")
        record = campaign(tmp_path, RECORD).records[0]
        np.testing.assert_array_equal(record["force"], FORCE)
        np.testing.assert_allclose(record["voltage"], 1e-3 * VOLTAGE, rtol=1e-15)
        np.testing.assert_allclose(record["time"], np.arange(COUNT) * 1e-3, rtol=0, atol=1e-12)

    def test_a_rounded_interval_is_said_or_stated(self, tmp_path):
        """19.53 us are written as 0.000020."""
        (tmp_path / "run.lvm").write_text(labview("No", step=1 / RATE))
        found = campaign(tmp_path, RECORD).warnings
        assert any("2e-05 s, rounded and up to 2.5 % off" in finding.message for finding in found)
        read = campaign(tmp_path, f"{RECORD}sample_rate = {RATE}\n")
        assert not any(finding.check == "coarse time" for finding in read.warnings)
        np.testing.assert_allclose(read.records[0]["time"], np.arange(COUNT) / RATE, rtol=1e-12)

    def test_one_of_several_segments_is_chosen(self, tmp_path):
        path = tmp_path / "run.lvm"
        path.write_text(labview(segments=3))
        assert "header_row" in failure(path, "F")
        names = [row for row, line in enumerate(path.read_text().splitlines(), 1) if line.startswith("X_Value")]
        for segment, row in enumerate(names):
            with open_reader(path, header_row=row) as reader:
                np.testing.assert_allclose(reader.read(["F"])["F"], FORCE + 10 * segment, atol=1e-9)
                assert reader.unit("U").text == "mV"
                assert len(reader.time_of("U")) == COUNT

    def test_exported_as_text(self, tmp_path):
        (tmp_path / "run.txt").write_text(labview("No"))
        with open_reader(tmp_path / "run.txt") as reader:
            np.testing.assert_allclose(reader.time_of("F"), np.arange(COUNT) * 1e-3)

    def test_rows(self, tmp_path):
        (tmp_path / "run.lvm").write_text(labview("No"))
        with open_reader(tmp_path / "run.lvm") as reader:
            first = reader.first_row
        record = campaign(tmp_path, f"{RECORD}rows = [{first + 4}, {first + 23}]\n").records[0]
        np.testing.assert_array_equal(record["force"], FORCE[4:24])
        np.testing.assert_allclose(record["time"], np.arange(4, 24) * 1e-3)
        assert record.signals["force"].first_row == first + 4


class TestOscilloscopes:
    def rigol(self, path):
        """As a DS1054Z writes it: the rows are narrower than the two lines above them."""
        rows = "".join(f"{n},{f:.2e},{v:.2e},\n" for n, (f, v) in enumerate(zip(FORCE, VOLTAGE, strict=True)))
        path.write_text(f"X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-1.200000e-03,2.000000e-06\n{rows}")

    def test_rigol_numbers_become_times(self, tmp_path):
        self.rigol(tmp_path / "run.csv")
        sources = 'channels = { force = { column = "CH1", unit = "N", gain = 2.0 }, voltage = { column = "CH2" } }'
        record = campaign(tmp_path, f'file = "run.csv"\n{sources}').records[0]
        np.testing.assert_allclose(record["time"], -1.2e-3 + 2e-6 * np.arange(COUNT), rtol=1e-12)
        np.testing.assert_allclose(record["force"], [2 * float(f"{f:.2e}") for f in FORCE], rtol=1e-12)

    def test_rigol_without_its_first_samples(self, tmp_path):
        self.rigol(tmp_path / "run.csv")
        with open_reader(tmp_path / "run.csv", skip_rows=12) as reader:
            np.testing.assert_allclose(reader.time_of("2"), -1.2e-3 + 2e-6 * np.arange(10, COUNT), rtol=1e-12)

    @pytest.mark.parametrize("mark", ["\u221e", "-\u221e", "Infinity"])
    def test_picoscope_over_its_range(self, tmp_path, mark):
        """The sample is infinite, which the checks of a record report with its row."""
        rows = [f"{n / 10},{f},{v}" for n, (f, v) in enumerate(zip(FORCE, VOLTAGE, strict=True))]
        rows[7] = f"0.7,{mark},1.0"
        (tmp_path / "run.csv").write_text("\n".join(["Time,Channel A,Channel B", "(ms),(V),(mV)", "", *rows]) + "\n")
        with open_reader(tmp_path / "run.csv") as reader:
            values = reader.read(["Channel A"])["Channel A"]
        assert np.isinf(values[7]) and np.sign(values[7]) == (-1 if mark[0] == "-" else 1)
        assert np.isfinite(np.delete(values, 7)).all()

    def test_tektronix_with_settings_beside_the_samples(self, tmp_path):
        """As a TDS2000 writes it: the first rows have the settings in three further columns on the left."""
        settings = ["Record Length,40,", "Sample Interval,2e-06,", "Trigger Point,20,", ",,", ",,", "Source,CH1,"]
        settings += ["Vertical Units,V,", "Vertical Scale,1.0,", *[",,"] * (COUNT - 8)]
        samples = [f"{n * 2e-6 - 4e-5:018.12f},  {value:.5f}," for n, value in enumerate(FORCE)]
        rows = [f"{left},{right}" for left, right in zip(settings, samples, strict=True)]
        (tmp_path / "run.csv").write_text("\n".join(rows) + "\n")
        with open_reader(tmp_path / "run.csv") as reader:
            time, values = (reader.read([reader.resolve(n)])[reader.resolve(n)] for n in (4, 5))
        np.testing.assert_allclose(values, FORCE.round(5), atol=1e-12)
        np.testing.assert_allclose(time, np.arange(COUNT) * 2e-6 - 4e-5, atol=1e-12)
