"""Formats of instruments, in files written here after their description: values, units and times come back."""

from __future__ import annotations

import struct
import sys
import tracemalloc

import numpy as np
import pytest
from messages import is_sentence
from scipy.io import wavfile

from piezoharvest.readers import ReadError, open_reader
from piezoharvest.readers.base import named_time
from piezoharvest.records import CampaignError, load_campaign
from piezoharvest.records.recognition.files import look_into

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

    @pytest.mark.parametrize("stated", [",", "0.0,", ",1e-3", "0.0,nan", "x,1e-3", "0.0,y"])
    def test_rigol_without_start_or_increment_has_no_times(self, tmp_path, stated):
        rows = "".join(f"{n},{f}\n" for n, f in enumerate(FORCE))
        (tmp_path / "run.csv").write_text(f"X,CH1,Start,Increment\nSequence,Volt,{stated}\n{rows}")
        with open_reader(tmp_path / "run.csv") as reader:
            assert (reader.time_of("CH1"), reader.step_error) == (None, 0.0)

    def test_rigol_without_its_first_samples(self, tmp_path):
        self.rigol(tmp_path / "run.csv")
        with open_reader(tmp_path / "run.csv", skip_rows=12) as reader:
            np.testing.assert_allclose(reader.time_of("2"), -1.2e-3 + 2e-6 * np.arange(10, COUNT), rtol=1e-12)

    def rigol_rows(self, path):
        """As an MSO5000 or a DHO800 writes it: the line of names has the times, above empty cells."""
        rows = "".join(f"{f:.6e},{v:.6e},,\n" for f, v in zip(FORCE, VOLTAGE, strict=True))
        path.write_text(f"CH1V,CH2A,t0 =-2.500000e-03, tInc = 5.000000e-09,\n{rows}")

    @pytest.mark.parametrize("skipped", [0, 11])
    def test_rigol_with_its_times_in_the_line_of_names(self, tmp_path, skipped):
        self.rigol_rows(tmp_path / "run.csv")
        sources = "channels = { force = { column = 1, gain = 1.0 }, current = { column = 2, gain = 1e-3 } }"
        skip = f"skip_rows = {skipped}\n" if skipped else ""
        record = campaign(tmp_path, f'file = "run.csv"\n{skip}{sources}').records[0]
        first = max(skipped - 1, 0)
        np.testing.assert_allclose(record["time"], -2.5e-3 + 5e-9 * np.arange(first, COUNT), rtol=1e-12)
        np.testing.assert_allclose(record["force"], FORCE[first:], rtol=1e-12)
        np.testing.assert_allclose(record["current"], 1e-3 * VOLTAGE[first:], rtol=1e-6)

    def test_rigol_states_the_unit_at_the_end_of_a_name(self, tmp_path):
        self.rigol_rows(tmp_path / "run.csv")
        with open_reader(tmp_path / "run.csv") as reader:
            assert [reader.unit(name).si for name in ("CH1V", "CH2A")] == ["V", "A"]

    @pytest.mark.parametrize("stated", ["t0 =, tInc = 5e-9", "t0 =nan, tInc = 5e-9", "t0 =0.0, tInc = 0.0,"])
    def test_rigol_with_unusable_times_has_none(self, tmp_path, stated):
        rows = "".join(f"{f},{v},,\n" for f, v in zip(FORCE, VOLTAGE, strict=True))
        (tmp_path / "run.csv").write_text(f"CH1V,CH2V,{stated}\n{rows}")
        with open_reader(tmp_path / "run.csv") as reader:
            assert (reader.time_of("CH1V"), reader.step_error) == (None, 0.0)

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

    def tektronix(self, path, values=FORCE):
        """As a TDS2000 writes it: the first rows have the settings in three further columns on the left."""
        settings = ["Record Length,4.0e+01,", "Sample Interval,2e-06,", "Trigger Point,20,", ",,", ",,", "Source,CH1,"]
        settings += ["Vertical Units,V,", "Vertical Scale,1.0,", "Horizontal Units,s,", *[",,"] * (COUNT - 9)]
        samples = [f"{n * 2e-6 - 4e-5:018.12f},  {value:.5f}," for n, value in enumerate(values)]
        rows = [f"{left},{right}" for left, right in zip(settings, samples, strict=True)]
        path.write_text("\n".join(rows) + "\n")

    def test_tektronix_with_settings_beside_the_samples(self, tmp_path):
        self.tektronix(tmp_path / "run.csv")
        with open_reader(tmp_path / "run.csv") as reader:
            names = [reader.resolve(n) for n in (4, 5)]
            assert [(name, reader.unit(name).si) for name in names] == [("Time", "s"), ("CH1", "V")]
            time, values = (reader.read([name])[name] for name in ("Time", "CH1"))
        np.testing.assert_allclose(values, FORCE.round(5), atol=1e-12)
        np.testing.assert_allclose(time, np.arange(COUNT) * 2e-6 - 4e-5, atol=1e-12)

    def test_tektronix_needs_no_channel_for_its_times(self, tmp_path):
        self.tektronix(tmp_path / "force.csv")
        self.tektronix(tmp_path / "other.csv", FORCE**2)  # it writes a file for each of its channels
        sources = 'channels = { force = { column = 5, gain = 2.0 }, voltage = { file = "other.csv", column = "CH1" } }'
        record = campaign(tmp_path, f'file = "force.csv"\n{sources}').records[0]
        np.testing.assert_allclose(record["time"], np.arange(COUNT) * 2e-6 - 4e-5, atol=1e-12)
        np.testing.assert_allclose(record["force"], 2.0 * FORCE.round(5), atol=1e-12)
        np.testing.assert_allclose(record["voltage"], (FORCE**2).round(5), atol=1e-12)

    def test_tektronix_cut_off_or_begun_later(self, tmp_path):
        self.tektronix(tmp_path / "run.csv")
        with open_reader(tmp_path / "run.csv", skip_rows=12) as reader:
            assert (len(reader.read(["CH1"])["CH1"]), reader.cut_off) == (COUNT - 12, "")
        (tmp_path / "run.csv").write_text("".join((tmp_path / "run.csv").read_text().splitlines(True)[:30]))
        with open_reader(tmp_path / "run.csv") as reader:
            reader.read(["CH1"])
            assert reader.cut_off == "found 30 samples, but the header of the file promises 40"


class TestWav:
    SAMPLES = np.round(20_000 * np.random.default_rng(3).uniform(-1, 1, (COUNT, 2)))

    def write(self, path, bits, rate=44100):
        """Header and samples by Microsoft's description of RIFF WAVE; 24 bits are three bytes, low byte first."""
        if bits == "float":
            data, tag, width = (self.SAMPLES / 2**15).astype("<f4").tobytes(), 3, 4
        else:
            whole, tag, width = self.SAMPLES.astype("<i8") << (bits - 16), 1, bits // 8
            data = b"".join(int(x).to_bytes(width, "little", signed=True) for x in whole.ravel())
        form = struct.pack("<HHIIHH", tag, 2, rate, rate * 2 * width, 2 * width, 8 * width)
        junk = b"bext" + struct.pack("<I", 6) + b"remark"
        body = b"WAVEfmt " + struct.pack("<I", len(form)) + form + junk + b"data" + struct.pack("<I", len(data)) + data
        path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)

    SOURCES = 'channels = { force = { column = 1, gain = 25.0 }, voltage = { column = "channel 2", gain = 10.0 } }'

    @pytest.mark.parametrize("bits", [16, 24, 32, "float"])
    def test_samples(self, tmp_path, bits):
        self.write(tmp_path / "run.wav", bits)
        record = campaign(tmp_path, f'file = "run.wav"\n{self.SOURCES}').records[0]
        np.testing.assert_array_equal(record["force"], 25.0 * (self.SAMPLES[:, 0] / 2**15))
        np.testing.assert_array_equal(record["voltage"], 10.0 * (self.SAMPLES[:, 1] / 2**15))
        np.testing.assert_allclose(record["time"], np.arange(COUNT) / 44100, rtol=1e-15)

    def test_full_scale_is_not_taken_for_newtons(self, tmp_path):
        self.write(tmp_path / "run.wav", 16)
        with pytest.raises(CampaignError, match=r"found the unit 'full scale' in the file .* or a gain"):
            campaign(tmp_path, f'file = "run.wav"\n{self.SOURCES.replace(", gain = 25.0", "")}')

    @pytest.mark.parametrize("kept", [12, 20, 43, 80, -1, -2])
    def test_cut_off(self, tmp_path, kept):
        self.write(tmp_path / "run.wav", 16)
        (tmp_path / "run.wav").write_bytes((tmp_path / "run.wav").read_bytes()[:kept])
        message = failure(tmp_path / "run.wav", 1)
        assert "not a complete WAV file" in message
        assert "local variable" not in message

    @pytest.mark.parametrize(("place", "bits"), [(16, 16), (40, 16), (54, 16), (54, 24), (54, "float")])
    def test_a_length_beyond_the_file_takes_no_memory(self, tmp_path, place, bits):
        """Of the format, of a remark, and of the samples: 2 GiB in a file of a few hundred bytes."""
        self.write(tmp_path / "run.wav", bits)
        data = bytearray((tmp_path / "run.wav").read_bytes())
        assert data[place - 4 : place] in (b"fmt ", b"bext", b"data")
        data[place : place + 4] = struct.pack("<I", 2**31)
        (tmp_path / "run.wav").write_bytes(data)
        tracemalloc.start()
        try:
            assert "not a complete WAV file" in failure(tmp_path / "run.wav", 1)
            assert tracemalloc.get_traced_memory()[1] < 2**24
        finally:
            tracemalloc.stop()

    def test_nothing_recorded(self, tmp_path):
        wavfile.write(tmp_path / "run.wav", 1000, np.zeros((0, 2), "i2"))
        assert "no samples" in failure(tmp_path / "run.wav", 1)


def fortran(value, width, digits):
    """A number as Fortran's E format writes it for universal files."""
    return f"{value:{width}.{digits}E}"


def universal(kind, values, *, step, labels=("NONE", "NONE"), types=(8, 13), freedoms="3+Z/1+X", binary=False) -> bytes:
    """Data set 58 with even spacing, by the description of the University of Cincinnati: complex or real, double."""
    (node, direction), (reference, its) = ((int(f[0]), "XYZ".index(f[2]) + 1) for f in freedoms.split("/"))
    complex_valued, count = np.iscomplexobj(values), len(values)
    flat = np.ascontiguousarray(values).view(float)
    data = flat.astype("<f8").tobytes()
    head = f"{58:6d}b{1:6d}{2:6d}{11:12d}{len(data):12d}{0:6d}{0:6d}{0:12d}{0:12d}" if binary else f"{58:6d}"
    axes = [(18 if kind != 1 else 17, "Hz" if kind != 1 else "s"), *zip(types, labels, strict=True), (0, "NONE")]
    lines = [f"{-1:6d}", head, *["NONE"] * 5]
    nothing, spacing = fortran(0, 13, 5), fortran(step, 13, 5)
    lines += [
        f"{kind:5d}{0:10d}{0:5d}{0:10d} {'NONE':10s}{node:10d}{direction:4d} {'NONE':10s}{reference:10d}{its:4d}",
        f"{6 if complex_valued else 4:10d}{count:10d}{1:10d}{nothing}{spacing}{nothing}",
    ]
    lines += [f"{number:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {label:20s}" for number, label in axes]
    text = "".join(f"{line:80s}\n" for line in lines).encode()
    if binary:
        return text + data + f"{-1:6d}\n".encode()
    cells = [fortran(x, 20, 12) for x in flat]
    rows = ["".join(cells[n : n + 4]) for n in range(0, len(cells), 4)]
    return text + "".join(f"{row}\n" for row in [*rows, f"{-1:6d}"]).encode()


class TestUniversalFiles:
    FREQUENCY = 10.0 * np.arange(1, COUNT + 1)
    VALUES = (1 / (1 - (10.0 * np.arange(COUNT) / 207) ** 2 + 0.02j)).round(9)

    @pytest.fixture(autouse=True)
    def pyuff(self):
        pytest.importorskip("pyuff", reason="the extra [uff] is not installed")

    @pytest.mark.parametrize("binary", [False, True])
    def test_a_receptance_with_its_coherence(self, tmp_path, binary):
        coherence = np.linspace(0.9, 1.0, COUNT)
        response = universal(4, self.VALUES, step=10.0, labels=("mm", "N"), binary=binary)
        (tmp_path / "run.uff").write_bytes(response + universal(6, coherence, step=10.0, binary=binary))
        record = campaign(tmp_path, 'file = "run.uff"\nkind = "frf"\noutput = "displacement"').records[0]
        np.testing.assert_allclose(record.frequency, 10.0 * np.arange(1, COUNT))  # the line at 0 Hz is left out
        np.testing.assert_allclose(record.response, 1e-3 * self.VALUES[1:], rtol=1e-11)
        np.testing.assert_allclose(record.coherence, coherence[1:], rtol=1e-11)

    def test_several_are_told_apart_by_their_degrees_of_freedom(self, tmp_path):
        sets = [universal(4, n * self.VALUES, step=10.0, freedoms=f"{n}+Z/1+X") for n in (2, 3)]
        (tmp_path / "run.unv").write_bytes(b"".join(sets))
        with open_reader(tmp_path / "run.unv") as reader:
            assert reader.names == ("frequency_Hz", "response 2+Z/1+X", "response 3+Z/1+X")
            found = reader.read(reader.names[2:])
            assert reader.unit(reader.names[1]) is None
        np.testing.assert_allclose(found["response 3+Z/1+X"], 3 * self.VALUES, rtol=1e-11)

    def test_units_of_the_whole_file(self, tmp_path):
        """Data set 164 with millimetres: SI times its factors is in the units of the file."""
        factors = ["  1.0000000000000000D+03  1.0000000000000000D+00  1.0000000000000000D+00", "  2.73149999999999D+02"]
        lines = ["    -1", "   164", f"{9:10d}{'mm (newton)':20s}{2:10d}", *factors, "    -1"]
        units = "".join(f"{line}\n" for line in lines)
        (tmp_path / "run.uff").write_bytes(units.encode() + universal(4, self.VALUES, step=10.0))
        record = campaign(tmp_path, 'file = "run.uff"\nkind = "frf"\noutput = "displacement"').records[0]
        np.testing.assert_allclose(record.response, 1e-3 * self.VALUES[1:], rtol=1e-11)

    def test_signals_over_time(self, tmp_path):
        force = universal(1, FORCE, step=1e-3, labels=("N", "NONE"), types=(13, 0), freedoms="1+X/0+X")
        voltage = universal(1, VOLTAGE, step=1e-3, labels=("mV", "NONE"), types=(0, 0), freedoms="2+X/0+X")
        (tmp_path / "run.uff").write_bytes(force + voltage)
        sources = 'channels = { force = { column = "signal 1+X" }, voltage = { column = "signal 2+X" } }'
        record = campaign(tmp_path, f'file = "run.uff"\n{sources}').records[0]
        np.testing.assert_allclose(record["force"], FORCE, rtol=1e-11)
        np.testing.assert_allclose(record["voltage"], 1e-3 * VOLTAGE, rtol=1e-11)
        np.testing.assert_allclose(record["time"], np.arange(COUNT) * 1e-3, rtol=0, atol=1e-15)

    def test_cut_off(self, tmp_path):
        whole = universal(4, self.VALUES, step=10.0)
        for kept in (40, 500, 1300, len(whole) - 80):
            (tmp_path / "run.uff").write_bytes(whole[:kept])
            failure(tmp_path / "run.uff", "response")

    @pytest.mark.parametrize("binary", [False, True])
    def test_a_last_function_without_an_end(self, tmp_path, binary):
        whole = universal(4, self.VALUES, step=10.0, labels=("mm", "N"), binary=binary)
        (tmp_path / "run.uff").write_bytes(whole)
        entry = 'file = "run.uff"\nkind = "frf"\noutput = "displacement"'
        assert not [each for each in campaign(tmp_path, entry).warnings if each.check == "cut off"]
        (tmp_path / "run.uff").write_bytes(whole + whole[:900])
        found = [each.message for each in campaign(tmp_path, entry).warnings if each.check == "cut off"]
        assert found == ["its last data set has no end (-1); likely the file is cut off"]


def test_without_pyuff(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyuff", None)
    (tmp_path / "run.uff").write_bytes(universal(4, TestUniversalFiles.VALUES, step=10.0))
    message = "the package pyuff is missing, which reads universal files: pip install 'piezoharvest[uff]'"
    assert failure(tmp_path / "run.uff", 1) == message


class TestImpedances:
    """The same impedance, of a capacitor with a resonant branch beside it, as each analyser would write it."""

    FREQUENCY = 1e3 + 200.0 * np.arange(COUNT)
    S = 2j * np.pi * FREQUENCY
    OHM = 1 / (40e-9 * S + 1 / (200.0 + 0.9 * S + 1 / (1e-9 * S)))

    def same(self, folder, name, text, *, rtol, channels="", encoding="utf-8"):
        (folder / name).write_text(text, encoding=encoding)
        record = campaign_of_impedance(folder, f'file = "{name}"\n{channels}')
        np.testing.assert_allclose(record.frequency, self.FREQUENCY, rtol=1e-12)
        np.testing.assert_allclose(record.response, self.OHM, rtol=rtol)
        return record

    @pytest.mark.parametrize("version", [1, 2])
    @pytest.mark.parametrize("form", ["MA", "DB", "RI"])
    @pytest.mark.parametrize("parameter", ["S", "Y", "Z"])
    def test_touchstone(self, tmp_path, parameter, form, version):
        """Y and Z of version 1 are relative to the reference resistance, those of version 2 are in S and ohm."""
        reference = 75.0
        unit = reference if version == 1 else 1.0
        reflection = (self.OHM - reference) / (self.OHM + reference)
        value = {"S": reflection, "Y": unit / self.OHM, "Z": self.OHM / unit}[parameter]
        size, angle = np.abs(value), np.angle(value, deg=True)
        pair = {"MA": (size, angle), "DB": (20 * np.log10(size), angle), "RI": (value.real, value.imag)}[form]
        points = zip(self.FREQUENCY, *pair, strict=True)
        rows = "".join(f"{f / 1e3:.10g}\t{a:.17g}  {b:.17g} ! point\n" for f, a, b in points)
        head = "! made by hand\n" + ("[Version] 2.0\n" if version == 2 else "")
        head += f"# kHz {parameter} {form} R {reference}\n"
        head += "[Number of Ports] 1\n[Reference] 75.0\n[Network Data]\n" if version == 2 else ""
        self.same(tmp_path, "run.s1p", f"{head}{rows}" + ("[End]\n" if version == 2 else ""), rtol=1e-9)

    @pytest.mark.parametrize(
        ("text", "what"),
        [("# Hz S RI R 50\n1e3 0.1\n", "a frequency and two numbers"), ("# Hz H RI\n1e3 1 1\n", "found 'H'"),
         ("# Hz S RI R 0\n1e3 1 1\n", "reference resistance '0'"), ("! nothing\n", "no rows"),
         ("[Version] 2.0\n# Hz Z RI\n[Number of Ports] 2\n1 2 3\n", "found 2 ports"),
         ("[Version] 2.0\n# Hz Z RI\n[Number of Ports]\n1 2 3\n", "found no number of ports"),
         ("# Hz S RI\n1e3 1 1 2 2 3 3 4 4\n", "of one port")],
    )  # fmt: skip
    def test_touchstone_of_another_kind(self, tmp_path, text, what):
        (tmp_path / "run.s1p").write_text(text)
        assert what in failure(tmp_path / "run.s1p", 1)

    def e4990a(self, columns, channel=1):
        rows = [", ".join(f"{x:+.11e}" for x in row) for row in zip(self.FREQUENCY, *columns.values(), strict=True)]
        begin = f"BEGIN CH{channel}_DATA\nTitle label, TEST DATA\nDCV(V), +5.230e-005, DCI(A), +2.335e-005\n"
        return begin + "\n".join([", ".join(["Frequency(Hz)", *columns]), *rows, "END"]) + "\n"

    def test_keysight_e4990a(self, tmp_path):
        """As in the example of the instrument's help, with a trace in memory, and the data of a second channel."""
        head = "!Agilent Technologies,E4990A,MY521012345,A.02.10\n!Date: Fri Apr 03 13:41:16 2015\n"
        angle = np.angle(self.OHM, deg=True)
        polar = {"|Z|(Ohm)-data": np.abs(self.OHM), "theta-z(deg)-data": angle, "theta-z(deg)-mem": angle + 1}
        other = self.e4990a({"Cp(F)-data": 1e-9 * angle, "D-data": 0 * angle}, 2)
        self.same(tmp_path, "polar.csv", head + self.e4990a(polar) + other, rtol=1e-9)
        cartesian = {"Z-Real(Ohm)-data": self.OHM.real, "Z-Imag(Ohm)-data": self.OHM.imag}
        self.same(tmp_path, "cartesian.csv", head + self.e4990a(cartesian), rtol=1e-9)

    def agilent_4294a(self, **shown):
        """A file of traces by what they show: each is a table below the one before it."""
        text = '"4294A REV1.11"\n""\n"SWEEP TYPE: LIN FREQ"\n"NUMBER of POINTS: 40"\n"OSC LEVEL: 500 [mV]"\n\n'
        for title, (form, values) in shown.items():
            points = zip(self.FREQUENCY, np.real(values), np.imag(values), strict=True)
            rows = "".join(f"{f:.8e}\t{a:.8e}\t{b:.8e}\n" for f, a, b in points)
            text += f'"TRACE: {title}"\n"FORMAT: {form}"\n\n"Frequency"\t"Real"\t"Imag"\n{rows}\n'
        return text

    @pytest.mark.parametrize(
        "names", ["|Z| Theta", "|Y| THETA", "R X", "G B", "Cp D", "Cs Rs", "Lp Q", "Ls Rs", "Cp Rp", "Z", "Y"]
    )
    def test_agilent_4294a_says_what_it_shows(self, tmp_path, names):
        z, y, pairs = self.OHM, 1 / self.OHM, {name.partition("(")[0]: x for name, x in self.pairs().items()}
        angle = np.angle(y if "Y" in names else z, deg=True)
        known = pairs | {"|Z|": np.abs(z), "Theta": angle, "THETA": angle, "Z": z, "Y": y}
        if names.startswith("L"):  # of a coil, whose reactance has the other sign
            known["Q"] = -known["Q"]
        traces = zip("AB", names.split(), strict=False)
        text = self.agilent_4294a(**{title: (name, known[name]) for title, name in traces})
        self.same(tmp_path, "run.txt", text, rtol=1e-6)
        found = look_into(tmp_path / "run.txt")
        assert (found.kind, found.columns, found.count) == ("impedance", {}, COUNT)

    @pytest.mark.parametrize(("form", "angle"), [("LOG Y", 57.3), ("Theta", 1.0)])
    def test_agilent_4294a_whose_traces_are_not_certain(self, tmp_path, form, angle):
        """A phase in radians may be one in degrees; the record has to name the columns."""
        text = self.agilent_4294a(A=("|Z|", np.abs(self.OHM)), B=(form, angle * np.angle(self.OHM)))
        (tmp_path / "run.txt").write_text(text)
        assert look_into(tmp_path / "run.txt").kind == "impedance"
        with pytest.raises(CampaignError, match="names in the record's channels"):
            campaign_of_impedance(tmp_path, 'file = "run.txt"')

    def test_agilent_4294a(self, tmp_path):
        """|Z| stands in the table of trace A, the phase in that of trace B below it."""
        text = self.agilent_4294a(A=("|Z|", np.abs(self.OHM)), B=("Theta", np.angle(self.OHM, deg=True)))
        channels = """channels = { frequency = { column = "Frequency" }, magnitude = { column = "A Real" },
            phase = { column = "B Real", unit = "deg" } }""".replace("\n", "")
        record = self.same(tmp_path, "run.txt", text, rtol=1e-7, channels=channels)
        assert text.splitlines()[record.first_row - 1].startswith("1.00000000e+03")

    def bode_100(self, names, quantity, decimal="."):
        """Table of the Bode Analyzer Suite: a frequency, real and imaginary part, magnitude and phase."""
        value = self.OHM if quantity.startswith("Imp") else 1 / self.OHM
        columns = self.FREQUENCY, value.real, value.imag, np.abs(value), np.angle(value, deg=True)
        rows = [";".join(f"{x:.17g}".replace(".", decimal) for x in row) for row in zip(*columns, strict=True)]
        header = ";".join(f'"{name}"' if ": " in name else name for name in names)
        return "\n".join([header, *rows]) + "\n"

    def test_bode_100(self, tmp_path):
        """Header of the Bode Analyzer Suite: all forms of the trace, the units in the names."""
        parts = "1: Real (Ω)", "1: Imaginary (Ω)", "1: Magnitude (Ω)", "2: Phase (°)"
        names = ["Frequency (Hz)", *(f"Trace {part.replace(': ', ': Impedance: ')}" for part in parts)]
        self.same(tmp_path, "run.csv", self.bode_100(names, "Impedance"), rtol=1e-12, encoding="utf-8-sig")

    @pytest.mark.parametrize(("quantity", "unit"), [("Impedanz", "Ω"), ("Admittanz", "S")])
    @pytest.mark.parametrize("forms", [(1, 2), (3, 4)])
    def test_bode_100_in_german(self, tmp_path, quantity, unit, forms):
        parts = f"1: Realteil ({unit})", f"1: Imaginärteil ({unit})", f"1: Betrag ({unit})", "2: Phase (°)"
        names = ["Frequenz (Hz)", *(f"Trace {part.replace(': ', f': {quantity}: ')}" for part in parts)]
        names = [name if n in (0, *forms) else f"other {n}" for n, name in enumerate(names)]
        text = self.bode_100(names, quantity, ",")
        self.same(tmp_path, "run.csv", text, rtol=1e-12, encoding="utf-8-sig")

    def test_lcr_meter_with_units_in_brackets(self, tmp_path):
        angle = np.angle(self.OHM, deg=True)
        points = enumerate(zip(self.FREQUENCY, np.abs(self.OHM), angle, strict=True))
        rows = [f'"{n}","{f:.5E}","{z:.9E}","{a:.9f}"' for n, (f, z, a) in points]
        text = '"Date","2024/03/01"\n"No.","FREQ[Hz]","Z[ohm]","PHASE[deg]"\n' + "\n".join(rows) + "\n"
        self.same(tmp_path, "run.csv", text, rtol=1e-8)

    def pairs(self):
        """Pairs of quantities as meters show them, by their definitions in series and in parallel.

        Above its resonance a capacitor shows as one below zero, with a loss factor below zero.
        """
        omega, z, y = 2 * np.pi * self.FREQUENCY, self.OHM, 1 / self.OHM
        of_capacitor = z.real / -z.imag
        cs, cp, ls, lp = -1 / (omega * z.imag), y.imag / omega, z.imag / omega, -1 / (omega * y.imag)
        series = {"Cs(F)": cs, "Ls(H)": ls, "Rs(Ohm)": z.real, "R(Ohm)": z.real, "X(Ohm)": z.imag}
        parallel = {"Cp(F)": cp, "Lp(H)": lp, "Rp(Ohm)": 1 / y.real, "G(S)": y.real, "B(S)": y.imag}
        polar = {"|Y|(S)": np.abs(y), "theta-y(deg)": np.angle(y, deg=True)}
        return {**series, **parallel, **polar, "D": of_capacitor, "Q": 1 / of_capacitor}

    @pytest.mark.parametrize(
        "names",
        ["Cp(F) D", "Cp(F) Q", "Cp(F) G(S)", "Cp(F) Rp(Ohm)", "Cs(F) D", "Cs(F) Q", "Cs(F) Rs(Ohm)", "Lp(H) D",
         "Lp(H) Q", "Lp(H) G(S)", "Lp(H) Rp(Ohm)", "Ls(H) D", "Ls(H) Q", "Ls(H) Rs(Ohm)", "G(S) B(S)", "R(Ohm) X(Ohm)",
         "|Y|(S) theta-y(deg)"],
    )  # fmt: skip
    def test_every_pair_of_an_analyser(self, tmp_path, names):
        """As an E4990A writes them, and as an LCR meter does with units in brackets."""
        columns = {name: self.pairs()[name] for name in names.split(" ")}
        if names.startswith("L"):  # of a coil, whose reactance has the other sign
            columns |= {name: -columns[name] for name in ("D", "Q") if name in columns}
        head = "!Agilent Technologies,E4990A,MY521012345,A.02.10\n!Date: Fri Apr 03 13:41:16 2015\n"
        text = head + self.e4990a({f"{name}-data": values for name, values in columns.items()})
        self.same(tmp_path, "e4990a.csv", text, rtol=1e-8)
        brackets = [name.replace("(", "[").replace(")", "]") for name in columns]
        titles = [f"{name.partition('[')[0].upper()}{''.join(name.partition('[')[1:])}" for name in brackets]
        points = enumerate(zip(self.FREQUENCY, *columns.values(), strict=True))
        rows = [",".join(f'"{x:.12E}"' for x in (n, *values)) for n, values in points]
        head = '"Date","2024/03/01"\n' + ",".join(f'"{name}"' for name in ("No.", "FREQ[Hz]", *titles)) + "\n"
        self.same(tmp_path, "meter.csv", head + "\n".join(rows) + "\n", rtol=1e-8)

    @pytest.mark.parametrize("quantity", ["Impedance", "Admittance"])
    def test_bode_100_of_version_2(self, tmp_path, quantity):
        """As its users' files of a gain are: both traces in their parts, the form of each in brackets."""
        values = self.OHM if quantity == "Impedance" else 1 / self.OHM
        unit = "Ohm" if quantity == "Impedance" else "S"
        parts = {
            f"TR1: {quantity} ({unit})": np.abs(values), f"TR2: {quantity} (Real)": values.real,
            f"TR2: {quantity} (Degree)": np.angle(values, deg=True),
        }  # fmt: skip
        points = zip(self.FREQUENCY, *parts.values(), strict=True)
        rows = "".join(",".join(f"{x:.15g}" for x in row) + "\n" for row in points)
        head = "---Measurement Setup----\nDevice Type: Bode100\nDate: 07-12-2016\nNumber of Points: 40\n---------\n"
        text = f"{head}Frequency (Hz),{','.join(parts)}\n{rows}"
        self.same(tmp_path, "run.csv", text, rtol=1e-12)

    @pytest.mark.parametrize("names", ["Cp(F) D()", "Cs(F) Q()"])
    def test_pairs_with_empty_units(self, tmp_path, names):
        """A loss factor has none; the analyser writes its brackets all the same."""
        columns = {f"{name}-data": self.pairs()[name.removesuffix("()")] for name in names.split(" ")}
        head = "!CSV A.01.01\n!Keysight Technologies,E4990A,MY541012345,A.03.01\n"
        self.same(tmp_path, "e4990a.csv", head + self.e4990a(columns), rtol=1e-8)

    def test_german_names_and_commas(self, tmp_path):
        points = zip(self.FREQUENCY, np.abs(self.OHM) / 1e3, np.angle(self.OHM, deg=True), strict=True)
        rows = [";".join(f"{x:.15g}" for x in row).replace(".", ",") for row in points]
        text = "\n".join(["Frequenz;Scheinwiderstand;Phase", "Hz;kOhm;\u00b0", *rows]) + "\n"
        self.same(tmp_path, "run.csv", text, rtol=1e-12, encoding="latin-1")

    def test_admittance_of_a_bode_100(self, tmp_path):
        columns = {"Real (S)": (1 / self.OHM).real, "Imaginary (S)": (1 / self.OHM).imag}
        names = ";".join(["Frequency (Hz)", *(f'"Trace 1: Admittance: {name}"' for name in columns)])
        rows = [";".join(f"{x:.17g}" for x in row) for row in zip(self.FREQUENCY, *columns.values(), strict=True)]
        self.same(tmp_path, "run.csv", "\n".join([names, *rows]) + "\n", rtol=1e-12, encoding="utf-8-sig")

    def test_pairs_in_columns_of_their_default_names(self, tmp_path):
        rows = zip(self.FREQUENCY, self.pairs()["Cp(F)"], self.pairs()["D"], strict=True)
        lines = [
            "frequency_Hz,parallel_capacitance_F,loss_factor",
            *(",".join(f"{x:.15g}" for x in row) for row in rows),
        ]
        self.same(tmp_path, "run.csv", "\n".join(lines) + "\n", rtol=1e-9)

    def test_pairs_by_channels(self, tmp_path):
        """Named, with units of the user's own, beside a column that would make another pair."""
        rows = zip(self.FREQUENCY, 1e9 * self.pairs()["Cp(F)"], self.pairs()["D"], 0 * self.FREQUENCY, strict=True)
        lines = ["f,c,loss,Q", *(",".join(f"{x:.15g}" for x in row) for row in rows)]
        channels = 'channels = { frequency = { column = 1 }, parallel_capacitance = { column = "c", unit = "nF" }, '
        channels += 'loss_factor = { column = "loss" } }'
        self.same(tmp_path, "run.csv", "\n".join(lines) + "\n", rtol=1e-9, channels=channels)

    def test_a_phase_without_a_unit_is_not_taken_for_radians(self, tmp_path):
        rows = "".join(f"{f},{abs(z)},{np.angle(z, deg=True)}\n" for f, z in zip(self.FREQUENCY, self.OHM, strict=True))
        (tmp_path / "run.csv").write_text(f"Frequency,|Z|,Phase\n{rows}")
        with pytest.raises(CampaignError, match=r"response: missing column, the file has Frequency, \|Z\|, Phase"):
            campaign_of_impedance(tmp_path, 'file = "run.csv"')


def campaign_of_impedance(folder, record):
    (folder / "campaign.toml").write_text(f'{CAMPAIGN}\n[[records]]\nkind = "impedance"\n{record}\n')
    return load_campaign(folder / "campaign.toml").records[0]


@pytest.mark.parametrize(
    ("head", "found"),
    [
        ("x-axis,1,2\nsecond,Volt,Volt\n", "x-axis"),  # Keysight InfiniiVision
        ("x-axis (ms),1,2\n", "x-axis (ms)"),
        ("x-axis,1,2\nVolt,Volt,Volt\n", None),
        ("a,b,1\nsecond,ms,Volt\n", None),
    ],
)
def test_the_one_column_with_a_unit_of_time_is_the_time(tmp_path, head, found):
    (tmp_path / "scope.csv").write_text(head + "".join(f"{n / 100},{n % 7},{n % 5}\n" for n in range(50)))
    with open_reader(tmp_path / "scope.csv") as reader:
        assert named_time(reader) == found
