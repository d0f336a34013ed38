"""Campaigns: what is accepted, units and signs of the channels, and that whatever is wrong is said in one sentence."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from messages import is_sentence
from record_cases import stack_sine
from scipy.io import savemat

from piezoharvest.cli import MOST_ERRORS, main
from piezoharvest.description.shunts import Open, Resistor, SeriesRL
from piezoharvest.description.system import System
from piezoharvest.linear import TwoPort, frequency_response
from piezoharvest.output import write_table
from piezoharvest.records import Campaign, CampaignError, Finding, FrequencyRecord, Record, load_campaign
from piezoharvest.study import StudyError, build_transducer

TRANSDUCER = '[transducer]\ncatalogue = "NAC2125-H10"\n'
RECORD = '[[records]]\nfile = "run.csv"\nload_resistance = 97780.0\n'
NAMES = {"time": "time_s", "force": "force_N", "displacement": "displacement_m", "voltage": "voltage_V",
         "current": "current_A"}  # fmt: skip


@pytest.fixture
def columns():
    of, _ = stack_sine()
    return {name: of[channel] for channel, name in NAMES.items()}


def load(folder, text, **tables) -> Campaign:
    """Campaign of a text and tables by file name (its last underscore the dot)."""
    for name, table in tables.items():
        stem, _, ending = name.rpartition("_")
        write_table(table, folder / f"{stem}.{ending}")
    (folder / "campaign.toml").write_text(text)
    return load_campaign(folder / "campaign.toml")


def failure(folder, text, **tables) -> CampaignError:
    with pytest.raises(CampaignError) as caught:
        load(folder, text, **tables)
    error = caught.value
    assert isinstance(error, StudyError)
    assert "\n" not in str(error)
    assert is_sentence(error.message)
    assert str(error).startswith(str(folder))
    return error


class TestAccepted:
    def test_default_header(self, tmp_path, columns):
        campaign = load(tmp_path, TRANSDUCER + RECORD, run_csv=columns)
        (record,) = campaign.records
        assert isinstance(record, Record)
        assert (campaign.title, campaign.path) == ("campaign", tmp_path / "campaign.toml")
        assert campaign.transducer == build_transducer({"catalogue": "NAC2125-H10"})
        assert (record.name, record.role, record.drive, record.start_time) == ("run.csv", "fit", "force", 0.0)
        assert record.shunt == Resistor(resistance=97780.0)
        assert record.responses == ("displacement", "voltage", "current")
        for channel, name in NAMES.items():
            np.testing.assert_array_equal(record[channel], columns[name])
        assert record.sample_rate == pytest.approx(1000.0)
        assert len(record) == 5000
        assert record.signals["voltage"].column == "voltage_V"
        assert campaign.warnings == campaign.errors == ()

    @pytest.mark.parametrize("missing", [["current_A"], ["displacement_m", "voltage_V"], ["voltage_V", "current_A"]])
    def test_any_channel_but_the_drive_may_be_missing(self, tmp_path, columns, missing):
        kept = {name: values for name, values in columns.items() if name not in missing}
        campaign = load(tmp_path, TRANSDUCER + RECORD, run_csv=kept)
        assert {signal.column for signal in campaign.records[0].signals.values()} == kept.keys() - {"time_s"}
        assert campaign.warnings == ()

    @pytest.mark.parametrize("name", ["base_acceleration_m_s2", "base_acceleration_m_per_s2"])
    def test_either_spelling_of_a_unit_is_a_default_column(self, tmp_path, columns, name):
        """The bench and `simulate --out` write one, the interface the other: a record was refused for it."""
        renamed = columns | {"velocity_m_per_s": np.gradient(columns["displacement_m"], columns["time_s"])}
        renamed[name] = -50.0 * renamed.pop("force_N")  # m/s^2, as the base drives it by -m a
        record = RECORD + 'drive = "base_acceleration"\n'
        (found,) = load(tmp_path, TRANSDUCER + record, run_csv=renamed).records
        np.testing.assert_array_equal(found.signals["base_acceleration"].values, renamed[name])
        np.testing.assert_array_equal(found.signals["velocity"].values, renamed["velocity_m_per_s"])
        both = renamed | {"velocity_m_s": 1.1 * renamed["velocity_m_per_s"]}  # the usual one counts
        (found,) = load(tmp_path, TRANSDUCER + record, run_csv=both).records
        np.testing.assert_array_equal(found.signals["velocity"].values, both["velocity_m_s"])

    def test_units_gain_offset_and_sigma(self, tmp_path, columns):
        pounds = columns["force_N"] / 4.4482216152605
        raw = {"t": 1e3 * columns["time_s"], "F": pounds, "v": columns["voltage_V"] / 20 + 1,
               "x": 1e6 * columns["displacement_m"] + 3, "sense": (columns["current_A"] - 1e-7) / 2e-4}  # fmt: skip
        text = """
        [channels]
        time = { column = "t", unit = "ms" }
        force = { column = "F", unit = "lbf" }
        displacement = { column = "x", unit = "µm", offset = -3, sigma = 0.012 }
        voltage = { column = "v", gain = 20, offset = -20.0, sigma = 1e-3 }
        current = { column = "sense", unit = "mA", gain = 0.2, offset = 1e-4 }
        """
        (record,) = load(tmp_path, TRANSDUCER + text + RECORD, run_npz=raw, run_csv=raw).records
        for channel, name in NAMES.items():
            scale = np.max(np.abs(columns[name]))
            np.testing.assert_allclose(record[channel], columns[name], rtol=1e-12, atol=1e-12 * scale)
        assert record.signals["displacement"].sigma == pytest.approx(1.2e-8)
        assert record.signals["voltage"].sigma == pytest.approx(1e-3)
        assert record.signals["force"].sigma is None

    def test_offset_and_sigma_are_in_the_unit_that_the_file_states(self, tmp_path, columns):
        """Beside `Displacement [um]`, sigma = 0.012 was 12 mm: whatever was left of the fit was noise."""
        displacement = 1e6 * columns.pop("displacement_m") + 3
        raw = {**columns, "Displacement [um]": displacement}
        text = '[channels]\ndisplacement = { column = "Displacement [um]", offset = -3, sigma = 0.012 }\n'
        campaign = load(tmp_path, TRANSDUCER + text + RECORD, run_csv=raw)
        (record,) = campaign.records
        assert campaign.warnings == ()
        np.testing.assert_allclose(record["displacement"], 1e-6 * (raw["Displacement [um]"] - 3), rtol=1e-12)
        assert record.signals["displacement"].sigma == pytest.approx(1.2e-8)

    def test_columns_are_averaged(self, tmp_path, columns):
        x = columns.pop("displacement_m")
        tilt = 1e-6 * np.sin(np.arange(len(x)))
        text = '[channels]\ndisplacement = { column = ["left", "right"], unit = "m" }\n'
        (record,) = load(
            tmp_path, TRANSDUCER + text + RECORD, run_csv={**columns, "left": x + tilt, "right": x - tilt}
        ).records
        np.testing.assert_allclose(record["displacement"], x, atol=1e-20)

    def test_a_record_has_channels_of_its_own(self, tmp_path, columns):
        other = {name: values for name, values in columns.items() if name != "displacement_m"}
        text = (
            RECORD + '[records.channels]\ndisplacement = { file = "laser.npz", column = "data[:, 1]", unit = "um" }\n'
        )
        np.savez(tmp_path / "laser.npz", data=np.column_stack([columns["time_s"], 1e6 * columns["displacement_m"]]))
        (record,) = load(tmp_path, TRANSDUCER + text, run_csv=other).records
        np.testing.assert_allclose(record["displacement"], columns["displacement_m"], rtol=1e-12)
        assert record.signals["displacement"].file == "laser.npz"
        assert record.signals["displacement"].first_row == 1

    def test_sample_rate_instead_of_time(self, tmp_path, columns):
        del columns["time_s"]
        (record,) = load(tmp_path, TRANSDUCER + RECORD + "sample_rate = 1000\n", run_csv=columns).records
        np.testing.assert_allclose(record["time"], np.arange(5000) / 1000)

    def test_a_part_of_the_rows(self, tmp_path, columns):
        text = TRANSDUCER + RECORD + "rows = [1002, 3001]\n" + RECORD + 'rows = [3002, 5001]\nrole = "validate"\n'
        campaign = load(tmp_path, text, run_csv=columns)
        first, second = campaign.records
        np.testing.assert_array_equal(first["voltage"], columns["voltage_V"][1000:3000])
        np.testing.assert_array_equal(second["voltage"], columns["voltage_V"][3000:])
        assert first.signals["voltage"].first_row == 1002
        assert campaign.of_role("validate") == (second,)

    def test_rows_of_findings_are_lines_of_the_file(self, tmp_path, columns):
        columns["voltage_V"][1500] = np.nan
        error = failure(tmp_path, TRANSDUCER + RECORD + "rows = [1002, 3001]\n", run_csv=columns)
        assert error.rows == ((1502, 1502),)
        assert "nan" in (tmp_path / "run.csv").read_text().splitlines()[1501].lower() + "nan"
        assert (tmp_path / "run.csv").read_text().splitlines()[1501].split(",")[3] in ("", "nan")

    def test_shunts_and_start_times(self, tmp_path, columns):
        text = (
            '[[records]]\nfile = "run.csv"\nstart_time = 60\nshunt = { kind = "resistor", resistance = 97780 }\n'
            '[[records]]\nfile = "run.csv"\n'
            '[records.shunt]\nkind = "series_rl"\ninductance = 1e-3\nresistance = 97780.0\n'
        )
        first, second = load(tmp_path, TRANSDUCER + text, run_csv=columns).records
        assert first.start_time == 60.0
        assert second.shunt == SeriesRL(inductance=1e-3, resistance=97780.0)

    def test_an_actuator_needs_no_load(self, tmp_path):
        time = np.arange(2000) / 200.0
        voltage = 50 + 50 * np.sin(2 * np.pi * time)
        table = {"time_s": time, "voltage_V": voltage, "displacement_m": 7.822 * voltage / 3.125e8}
        text = '[[records]]\nfile = "run.csv"\ndrive = "voltage"\n'
        (record,) = load(tmp_path, TRANSDUCER + text, run_csv=table).records
        assert (record.drive, record.shunt, record.responses) == ("voltage", None, ("displacement",))

    @pytest.mark.parametrize("ending", ["csv", "npz", "h5", "parquet"])
    def test_all_formats_say_the_same(self, tmp_path, columns, ending):
        text = TRANSDUCER + RECORD.replace("csv", ending)
        (record,) = load(tmp_path, text, **{f"run_{ending}": columns}).records
        np.testing.assert_array_equal(record["force"], columns["force_N"])

    def test_a_recording_of_dspace(self, tmp_path, columns):
        names = [name for name in columns if name != "time_s"]
        y = np.array([(f'"Model Root"/"ADC"/"{name}"', columns[name], 1) for name in names],
                     dtype=[("Name", "O"), ("Data", "O"), ("XIndex", "O")])  # fmt: skip
        savemat(tmp_path / "run.mat", {"run": {"X": {"Name": "t", "Data": columns["time_s"]}, "Y": y}})
        (record,) = load(tmp_path, TRANSDUCER + RECORD.replace("csv", "mat")).records
        np.testing.assert_array_equal(record["time"], columns["time_s"])
        np.testing.assert_array_equal(record["voltage"], columns["voltage_V"])

    def test_signals_of_another_raster_do_not_belong_together(self, tmp_path, columns):
        y = np.array([("force_N", columns["force_N"], 1), ("voltage_V", columns["voltage_V"][::2], 2)],
                     dtype=[("Name", "O"), ("Data", "O"), ("XIndex", "O")])  # fmt: skip
        x = np.array([(columns["time_s"],), (columns["time_s"][::2],)], dtype=[("Data", "O")])
        savemat(tmp_path / "run.mat", {"run": {"X": x, "Y": y}})
        error = failure(tmp_path, TRANSDUCER + RECORD.replace("csv", "mat"))
        assert error.channel == "voltage"
        assert "found 2500 samples, but 5000" in error.message


class TestWarnings:
    def test_warnings_are_carried_on(self, tmp_path, columns):
        columns["voltage_V"] = np.minimum(columns["voltage_V"], 0.9 * columns["voltage_V"].max())
        (finding,) = load(tmp_path, TRANSDUCER + RECORD, run_csv=columns).warnings
        assert isinstance(finding, Finding)
        assert (finding.check, finding.channel, finding.file) == ("clipped", "voltage", "run.csv")
        assert str(finding).startswith("run.csv: voltage, rows ")

    def test_a_column_that_no_record_has(self, tmp_path, columns):
        text = '[channels]\nvoltage = { column = "voltage" }\n'
        (finding,) = load(tmp_path, TRANSDUCER + text + RECORD, run_csv=columns).warnings
        assert (finding.check, finding.channel) == ("missing column", "voltage")
        assert (
            "the file has no column 'voltage' (did you mean 'voltage_V'?), its columns are time_s, force_N"
            in finding.message
        )

    def test_a_column_whose_name_is_almost_that_of_a_channel(self, tmp_path, columns):
        columns["displacement_mm"] = 1e3 * columns.pop("displacement_m")
        (finding,) = load(tmp_path, TRANSDUCER + RECORD, run_csv=columns).warnings
        assert (finding.check, finding.channel) == ("unused column", "displacement")
        assert finding.message.startswith("the column 'displacement_mm' is not used, as 'displacement_m' is expected; ")
        text = '[channels]\ndisplacement = { column = "displacement_mm", unit = "mm" }\n'
        assert load(tmp_path, TRANSDUCER + text + RECORD, run_csv=columns).warnings == ()

    @pytest.mark.parametrize(
        ("name", "warned"),
        [
            ("displacement", True), ("Displacement [um]", True), ("displacement_2", True),
            ("displacement_ref", False), ("displacement_limit_mm", False), ("displacements_seen", False),
        ],
    )  # fmt: skip
    def test_a_column_whose_name_only_begins_as_that_of_a_channel(self, tmp_path, columns, name, warned):
        columns[name] = 1e3 * columns.pop("displacement_m")
        found = load(tmp_path, TRANSDUCER + RECORD, run_csv=columns).warnings
        assert [(finding.check, finding.channel) for finding in found] == [("unused column", "displacement")] * warned

    def test_a_column_that_one_record_has_not(self, tmp_path, columns):
        text = '[channels]\nvoltage = { column = "voltage_V" }\n' + RECORD + RECORD.replace("run", "two")
        two = {name: values for name, values in columns.items() if name != "voltage_V"}
        campaign = load(tmp_path, TRANSDUCER + text, run_csv=columns, two_csv=two)
        assert campaign.warnings == ()
        assert "voltage" not in campaign.records[1].signals


class TestWrong:
    @pytest.mark.parametrize(
        ("text", "key", "message"),
        [
            (RECORD, "transducer", "missing table [transducer]"),
            (TRANSDUCER, "records", "missing, at least one table [[records]] is needed"),
            (TRANSDUCER + "records = []\n", "transducer.records", "unknown key"),
            ("records = []\n" + TRANSDUCER, "records", "found [], at least one table [[records]] is needed"),
            (
                TRANSDUCER + '[records]\nfile = "run.csv"\n', "records",
                "found {'file': 'run.csv'}, must be a list of tables, written as [[records]], not [records]",
            ),
            (TRANSDUCER + '[[records]]\nfile = "run.csv"\n', "records.0.load_resistance", "missing key"),
            (TRANSDUCER + "[[records]]\nload_resistance = 1.0\n", "records.0.file", "missing key"),
            (TRANSDUCER + RECORD.replace("97780.0", "-1.0"), "records.0.load_resistance", "found -1.0"),
            (TRANSDUCER + RECORD + 'role = "test"\n', "records.0.role", "'fit' or 'validate'"),
            (TRANSDUCER + RECORD + 'drive = "current"\n', "records.0.drive", "found 'current'"),
            (TRANSDUCER + RECORD + 'kind = "spectrum"\n', "records.0.kind", "allowed are time, periodic, frf"),
            (TRANSDUCER + RECORD + "sample_rate = 0\n", "records.0.sample_rate", "found 0"),
            (TRANSDUCER + RECORD + "samplerate = 10\n", "records.0.samplerate", "did you mean 'sample_rate'?"),
            (TRANSDUCER + RECORD + 'shunt = { kind = "open" }\n', "records.0.shunt", "load_resistance is given too"),
            (TRANSDUCER + RECORD + "rows = [9, 2]\n", "records.0.rows", "first < last"),
            (TRANSDUCER + "records = 3\n", "transducer.records", "unknown key"),
            ("x = 1\n" + TRANSDUCER + RECORD, "x", "unknown key, known keys are channels, experiment, records"),
            ("title = 3\n" + TRANSDUCER + RECORD, "title", "found 3, must be a string"),
            (TRANSDUCER + "[channels]\nvolts = {}\n" + RECORD, "channels.volts", "unknown channel"),
            (TRANSDUCER + "[channels]\nvoltage = 3\n" + RECORD, "channels.voltage", "must be a table"),
            (TRANSDUCER + '[channels]\nvoltage = { unit = "mm" }\n' + RECORD, "channels.voltage.unit", "converts to V"),
            (TRANSDUCER + '[channels]\nvoltage = { unit = "volz" }\n' + RECORD, "channels.voltage.unit", "'volz'"),
            (TRANSDUCER + '[channels]\nvoltage = { unit = "V*" }\n' + RECORD, "channels.voltage.unit", "'V*'"),
            (TRANSDUCER + '[channels.base_acceleration]\nunit = "kg"\n' + RECORD, "channels.base_acceleration.unit",
             "converts to m/s^2"),
            (TRANSDUCER + "[channels]\nvoltage = { gain = 0 }\n" + RECORD, "channels.voltage.gain", "found 0"),
            (TRANSDUCER + "[channels]\nvoltage = { sigma = 0 }\n" + RECORD, "channels.voltage.sigma", "greater than 0"),
            (TRANSDUCER + "[channels]\nvoltage = { column = 0 }\n" + RECORD, "channels.voltage.column", "from 1"),
            (TRANSDUCER + "[channels]\nvoltage = { column = [] }\n" + RECORD, "channels.voltage.column", "empty list"),
            (TRANSDUCER + "[channels]\nvoltage = { col = 1 }\n" + RECORD, "channels.voltage.col", "unknown key"),
            (TRANSDUCER.replace("NAC2125", "NAC") + RECORD, "transducer.catalogue", "did you mean"),
        ],
    )  # fmt: skip
    def test_tables(self, tmp_path, columns, text, key, message):
        error = failure(tmp_path, text, run_csv=columns)
        assert (error.path, error.key) == (str(tmp_path / "campaign.toml"), key)
        assert message in error.message

    def test_no_campaign(self, tmp_path):
        with pytest.raises(CampaignError, match="the file cannot be read"):
            load_campaign(tmp_path / "campaign.toml")
        (tmp_path / "campaign.toml").write_text("= 3")
        with pytest.raises(CampaignError, match="not a valid TOML file"):
            load_campaign(tmp_path / "campaign.toml")

    def test_no_data_file(self, tmp_path):
        error = failure(tmp_path, TRANSDUCER + RECORD)
        assert error.path == str(tmp_path / "run.csv")
        assert "No such file" in error.message

    def test_the_drive_is_missing(self, tmp_path, columns):
        del columns["force_N"]
        error = failure(tmp_path, TRANSDUCER + RECORD, run_csv=columns)
        assert (error.path, error.key, error.channel) == (str(tmp_path / "run.csv"), "force, the drive", "force")
        assert error.message == (
            "the file has no column 'force_N', its columns are time_s, displacement_m, voltage_V, current_A; "
            "force = { column = NAME } in [channels] names another column"
        )
        error = failure(tmp_path, TRANSDUCER + '[channels]\nforce = { column = "F" }\n' + RECORD, run_csv=columns)
        assert error.message.endswith("voltage_V, current_A")  # the name is the user's own: how to give one is known

    def test_a_record_of_a_moving_base_is_told_the_drive_that_it_needs(self, tmp_path, columns):
        del columns["force_N"]
        columns["a"] = columns["voltage_V"]
        error = failure(
            tmp_path, TRANSDUCER + '[channels]\nbase_acceleration = { column = "a" }\n' + RECORD, run_csv=columns
        )
        assert error.message.endswith('where the base is what moves, the record needs drive = "base_acceleration"')

    def test_nothing_but_the_drive(self, tmp_path, columns):
        kept = {name: columns[name] for name in ("time_s", "force_N")}
        assert (
            "no channel other than the drive was found" in failure(tmp_path, TRANSDUCER + RECORD, run_csv=kept).message
        )

    def test_a_column_that_the_record_itself_names(self, tmp_path, columns):
        text = TRANSDUCER + RECORD + '[records.channels]\nvoltage = { column = "u" }\n'
        error = failure(tmp_path, text, run_csv=columns)
        assert (error.channel, error.path) == ("voltage", str(tmp_path / "run.csv"))

    def test_no_time(self, tmp_path, columns):
        del columns["time_s"]
        error = failure(tmp_path, TRANSDUCER + RECORD, run_csv=columns)
        assert error.channel == "time"
        assert "sample_rate in the record" in error.message

    def test_two_times(self, tmp_path, columns):
        error = failure(tmp_path, TRANSDUCER + RECORD + "sample_rate = 2000.0\n", run_csv=columns)
        assert error.message == "the time stamps have a sample rate of 1000 Hz, but sample_rate says 2000 Hz"
        load(tmp_path, TRANSDUCER + RECORD + "sample_rate = 1000.0\n")

    def test_text_among_the_numbers(self, tmp_path, columns):
        write_table(columns, tmp_path / "run.csv")
        lines = (tmp_path / "run.csv").read_text().splitlines()
        lines[41] = ",".join(["0.04", "OVERLOAD", *lines[41].split(",")[2:]])
        (tmp_path / "run.csv").write_text("\n".join(lines))
        error = failure(tmp_path, TRANSDUCER + RECORD)
        assert (error.channel, error.rows) == ("force", ((42, 42),))
        assert str(error) == (
            f"{tmp_path / 'run.csv'}: force (column 'force_N'), row 42: found 'OVERLOAD', must be a number"
        )

    def test_files_of_different_length(self, tmp_path, columns):
        text = TRANSDUCER + RECORD + '[records.channels]\nvoltage = { file = "v.npy", column = "[:]" }\n'
        np.save(tmp_path / "v.npy", columns["voltage_V"][:-1])
        error = failure(tmp_path, text, run_csv=columns)
        assert error.path == str(tmp_path / "v.npy")
        assert "found 4999 samples, but 5000 in the drive, force" in error.message

    def test_complex_samples(self, tmp_path, columns):
        error = failure(
            tmp_path,
            TRANSDUCER + RECORD.replace("csv", "npz"),
            run_npz={**columns, "voltage_V": 1j * columns["voltage_V"]},
        )
        assert (error.channel, error.message) == ("voltage", "found complex numbers, allowed are real numbers")

    @pytest.mark.parametrize("count", [0, 1])
    def test_no_samples(self, tmp_path, columns, count):
        text = TRANSDUCER + RECORD.replace("csv", "parquet")
        error = failure(tmp_path, text, run_parquet={name: values[:count] for name, values in columns.items()})
        assert f"found {count} sample" in error.message

    @pytest.mark.parametrize("rows", [[1, 100], [2, 5002]])
    def test_rows_that_are_not_there(self, tmp_path, columns, rows):
        error = failure(tmp_path, TRANSDUCER + RECORD + f"rows = {rows}\n", run_csv=columns)
        assert error.message == f"found {rows}, allowed are rows from 2 to 5001"

    def test_the_first_of_several_errors_is_told(self, tmp_path, columns):
        columns["voltage_V"][[10, 11]] = np.nan
        columns["current_A"][7] = np.inf
        error = failure(tmp_path, TRANSDUCER + RECORD, run_csv=columns)
        assert error.path == str(tmp_path / "run.csv")
        assert (error.channel, error.rows) == ("voltage", ((12, 13),))
        assert str(error).endswith("voltage, rows 12-13: found 2 values NaN, infinite or missing, allowed are finite "
                                   "numbers (and 1 more error)")  # fmt: skip
        assert [finding.channel for finding in error.campaign.errors] == ["voltage", "current"]
        assert len(error.campaign.records) == 1

    def test_the_command_tells_every_error_in_its_own_line(self, tmp_path, columns, capsys):
        columns["voltage_V"][[10, 11]] = np.nan
        columns["current_A"][7] = np.inf
        with pytest.raises(CampaignError):
            load(tmp_path, TRANSDUCER + RECORD, run_csv=columns)
        assert main(["identify", str(tmp_path / "campaign.toml")]) == 2
        first, second = capsys.readouterr().err.splitlines()
        assert "voltage, rows 12-13" in first
        assert second.startswith(f"piezoharvest: error: {tmp_path / 'run.csv'}: current, row 9: found 1 value ")

    def test_very_many_errors_are_counted(self, tmp_path, columns, capsys):
        columns["voltage_V"][10] = np.nan
        with pytest.raises(CampaignError):
            load(tmp_path, TRANSDUCER + 30 * RECORD, run_csv=columns)
        assert main(["diagnose", str(tmp_path / "campaign.toml")]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == MOST_ERRORS + 2
        assert lines[-1] == "piezoharvest: error: 9 more of them are not shown"


# Columns by unit of the header, keys in [channels] and what is to be written there for a voltage of the other sign.
REVERSED = [
    ("voltage_V", "", 'unit = "V", gain = -1'),
    ("voltage (mV)", "", 'unit = "V", gain = -0.001'),
    ("voltage (mV)", 'unit = "mV"', 'unit = "mV", gain = -1'),
    ("voltage_V", "gain = 0.001", 'unit = "V", gain = -0.001'),
    ("voltage_V", 'unit = "mV", gain = 0.5, offset = 20.0', 'unit = "mV", gain = -0.5, offset = -20'),
    ("voltage (mV)", "offset = 20.0, sigma = 5.0", 'unit = "V", gain = -0.001, offset = -0.02, sigma = 0.005'),
]


def test_a_gain_that_turns_a_sign_does_not_silently_change_the_unit(tmp_path, columns):
    """A gain overrules the unit of the file: of -1 beside millivolts, the values would be volts."""
    columns["voltage (mV)"] = -1e3 * columns.pop("voltage_V")

    def text(keys):
        return f'{TRANSDUCER}[channels]\nvoltage = {{ column = "voltage (mV)", {keys} }}\n{RECORD}'

    error = failure(tmp_path, text("gain = -1"), run_csv=columns)
    assert "found the unit 'mV' in the file" in str(error)
    advice = 'unit = "V", gain = -0.001'
    assert advice in str(error)
    for keys in (advice, 'unit = "mV", gain = -1'):
        assert load(tmp_path, text(keys), run_csv=columns).warnings == ()


@pytest.mark.parametrize(("column", "keys", "advice"), REVERSED)
def test_what_is_advised_for_a_wrong_sign_is_right_as_it_stands(tmp_path, columns, column, keys, advice):
    """With the unit and the gain that the channel has, from the campaign or from its file."""
    si, gain = ("mV" not in column + keys) or 1e-3, 1.0
    if "gain" in keys:
        gain = 0.5 if "offset" in keys else 1e-3
    raw = (-columns.pop("voltage_V") / (1.0 if si is True else si) - 20.0 * ("offset" in keys)) / gain
    columns = {**columns, column: raw}

    def text(*keys):
        inside = ", ".join([f"column = {column!r}", *filter(None, keys)])
        return f"{TRANSDUCER}[channels]\nvoltage = {{ {inside} }}\n{RECORD}"

    error = failure(tmp_path, text(keys), run_csv=columns)
    assert error.channel == "voltage"
    assert f"voltage = {{ {advice} }}" in error.message
    right = load(tmp_path, text(advice), run_csv=columns)
    assert right.errors == ()


FREQUENCIES = np.geomspace(1.0, 400.0, 60)
FRF = '[[records]]\nkind = "frf"\nfile = "frf.csv"\noutput = "displacement"\nload_resistance = 97780.0\n'
IMPEDANCE = '[[records]]\nkind = "impedance"\nfile = "z.csv"\n'


@pytest.fixture(scope="module")
def device():
    return build_transducer({"catalogue": "NAC2125-H10"})


@pytest.fixture(scope="module")
def compliance(device):
    return frequency_response(System(device, Resistor(resistance=97780.0)), FREQUENCIES).displacement


@pytest.fixture(scope="module")
def impedance(device):
    return TwoPort.of(device, FREQUENCIES).impedance()


class TestFrequencyRecords:
    def only(self, folder, text, **tables) -> FrequencyRecord:
        campaign = load(folder, TRANSDUCER + text, **tables)
        assert campaign.warnings == ()
        (record,) = campaign.records
        assert isinstance(record, FrequencyRecord)
        return record

    @pytest.mark.parametrize("form", ["complex", "cartesian", "polar", "degrees"])
    def test_frf(self, tmp_path, compliance, form):
        polar = {"magnitude": np.abs(compliance)}
        table = {
            "complex": {"response": compliance}, "cartesian": {"real": compliance.real, "imaginary": compliance.imag},
            "polar": {**polar, "phase_rad": np.angle(compliance)},
            "degrees": {**polar, "phase_deg": np.degrees(np.angle(compliance))},
        }[form]  # fmt: skip
        table = {"frequency_Hz": FREQUENCIES, "coherence": np.full(60, 0.99), **table}
        record = self.only(tmp_path, FRF.replace("csv", "npz"), frf_npz=table)
        np.testing.assert_allclose(record.response, compliance, rtol=1e-12)
        np.testing.assert_allclose(record.frequency, FREQUENCIES)
        np.testing.assert_allclose(record.coherence, 0.99)
        assert (record.kind, record.input, record.output) == ("frf", "force", "displacement")
        assert record.shunt == Resistor(resistance=97780.0)

    @pytest.mark.parametrize(("output", "rate", "unit"), [("velocity", 1, "mm/s/N"), ("acceleration", 2, "g_0/kN")])
    def test_mobility_and_accelerance(self, tmp_path, compliance, output, rate, unit):
        """Of the same motion, each in a unit of its own, 0.001 m/s/N and 9.80665e-3 m/s^2/N."""
        response = compliance * (2j * np.pi * FREQUENCIES) ** rate
        values = response / {1: 1e-3, 2: 9.80665e-3}[rate]
        text = FRF.replace("displacement", output) + f'[records.channels]\nresponse = {{ unit = "{unit}" }}\n'
        table = {"frequency_Hz": FREQUENCIES, "response": values}
        record = self.only(tmp_path, text.replace("csv", "npz"), frf_npz=table)
        np.testing.assert_allclose(record.response, response, rtol=1e-12)
        assert record.output == output

    @pytest.mark.parametrize(
        ("column", "source", "reference"),
        [("magnitude_dB", 'unit = "dB"', 1.0), ("a", 'column = "a", unit = "dB"', 1.0),
         ("a (dB)", 'column = "a", unit = "dB re m/N"', 1.0), ("a", 'column = "a", unit = "dB re um/N"', 1e-6),
         ("a", 'column = "a", unit = "dB", offset = -40.0', 100.0)],
    )  # fmt: skip
    def test_decibels_and_degrees(self, tmp_path, compliance, column, source, reference):
        table = {"frequency_Hz": FREQUENCIES, column: 20 * np.log10(np.abs(compliance) / reference),
                 "phase_deg": np.degrees(np.angle(compliance))}  # fmt: skip
        if "offset" in source:
            table[column] += 80.0  # which the offset of -40 dB and the reference of 40 dB take back
        text = FRF + f"[records.channels]\nmagnitude = {{ {source} }}\n"
        record = self.only(tmp_path, text, frf_csv=table)
        np.testing.assert_allclose(record.response, compliance, rtol=1e-9)

    @pytest.mark.parametrize(
        ("name", "source", "zero"),
        [("a (dB re 1 um/N)", "", 1e-6), ("a [dB re. 1e-9 m/N]", "", 1e-9), ("a (dB ref m/kN)", 'unit = "dB"', 1e-3),
         ("a (dB (um/N))", 'unit = "dB re um/N"', 1e-6), ("a (dB re 1 um/N)", 'unit = "dB re m/N", gain = 1.0', 1.0)],
    )  # fmt: skip
    def test_decibels_whose_zero_the_file_states(self, tmp_path, compliance, name, source, zero):
        table = {"frequency_Hz": FREQUENCIES, name: 20 * np.log10(np.abs(compliance) / zero),
                 "phase_deg": np.degrees(np.angle(compliance))}  # fmt: skip
        keys = ", ".join(['column = "a"', *([source] if source else [])])
        record = self.only(tmp_path, FRF + f"[records.channels]\nmagnitude = {{ {keys} }}\n", frf_csv=table)
        np.testing.assert_allclose(record.response, compliance, rtol=1e-9)

    def test_decibels_of_another_zero_than_the_file_states(self, tmp_path, compliance):
        table = {"frequency_Hz": FREQUENCIES, "a (dB re 1 g/N)": 20 * np.log10(np.abs(compliance)),
                 "phase_deg": np.degrees(np.angle(compliance))}  # fmt: skip
        for unit in ("dB", "dB re m/N"):
            text = FRF + f'[records.channels]\nmagnitude = {{ column = "a", unit = "{unit}" }}\n'
            with pytest.raises(CampaignError, match=rf"found levels in 'dB re 1 g/N' in the file and '{unit}'"):
                self.only(tmp_path, text, frf_csv=table)

    def test_units_of_a_response(self, tmp_path, compliance):
        text = FRF + (
            '[records.channels]\nfrequency = { column = "w", unit = "rad/s" }\n'
            'magnitude = { column = "a", unit = "um/kN" }\nphase = { column = "p", unit = "deg" }\n'
        )
        table = {"w": 2 * np.pi * FREQUENCIES, "a": 1e9 * np.abs(compliance), "p": np.degrees(np.angle(compliance))}
        record = self.only(tmp_path, text, frf_csv=table)
        np.testing.assert_allclose(record.frequency, FREQUENCIES, rtol=1e-12)
        np.testing.assert_allclose(record.response, compliance, rtol=1e-9)

    @pytest.mark.parametrize("form", ["polar", "cartesian"])
    def test_impedance(self, tmp_path, impedance, form):
        table = {
            "polar": {"impedance_ohm": np.abs(impedance), "phase_deg": np.degrees(np.angle(impedance))},
            "cartesian": {"resistance_ohm": impedance.real, "reactance_ohm": impedance.imag},
        }[form]
        record = self.only(tmp_path, IMPEDANCE, z_csv={"frequency_Hz": FREQUENCIES, **table})
        np.testing.assert_allclose(record.response, impedance, rtol=1e-9)
        assert (record.kind, record.input, record.output, record.shunt) == ("impedance", "current", "voltage", None)
        assert record.mechanical == "free"

    def test_beside_time_records(self, tmp_path, columns, compliance, impedance):
        frf = {"frequency_Hz": FREQUENCIES, "real": compliance.real, "imaginary": compliance.imag}
        z = {"frequency_Hz": FREQUENCIES, "resistance_ohm": impedance.real, "reactance_ohm": impedance.imag}
        campaign = load(tmp_path, TRANSDUCER + RECORD + FRF + IMPEDANCE, run_csv=columns, frf_csv=frf, z_csv=z)
        assert [type(record) for record in campaign.records] == [Record, FrequencyRecord, FrequencyRecord]
        assert campaign.warnings == ()

    @pytest.mark.parametrize(
        ("change", "check", "rows"),
        [
            (lambda f, z: (f, np.where(np.arange(60) == 5, np.nan, z)), "nan", ((7, 7),)),
            (lambda f, z: (f - 2.0, z), "frequency", ((2, 8),)),
            (lambda f, z: (f, 1e3 * z), "unit", ((2, 61),)),
            (lambda f, z: (f, 1e-3 * z), "unit", ((2, 61),)),
            (lambda f, z: (f, -z), "sign", ((2, 61),)),
            (lambda f, z: (f, z.conj()), "sign", ((2, 61),)),
            (lambda f, z: (f, 0 * z + 3.0), "constant", ((2, 61),)),
        ],
    )
    def test_what_is_wrong_with_an_impedance(self, tmp_path, impedance, change, check, rows):
        f, z = change(FREQUENCIES, impedance + 0j)
        table = {"frequency_Hz": f, "resistance_ohm": z.real, "reactance_ohm": z.imag}
        error = failure(tmp_path, TRANSDUCER + IMPEDANCE, z_csv=table)
        assert (error.campaign.errors[0].check, error.rows) == (check, rows)

    @pytest.mark.parametrize(("factor", "check"), [(1e6, "unit"), (-1, "sign")])
    @pytest.mark.parametrize(("output", "rate"), [("velocity", 1), ("acceleration", 2)])
    def test_what_is_wrong_with_a_rate(self, tmp_path, compliance, output, rate, factor, check):
        response = factor * compliance * (2j * np.pi * FREQUENCIES) ** rate
        table = {"frequency_Hz": FREQUENCIES, "real": response.real, "imaginary": response.imag}
        error = failure(tmp_path, TRANSDUCER + FRF.replace("displacement", output), frf_csv=table)
        assert (error.channel, error.campaign.errors[0].check) == ("response", check)

    @pytest.mark.parametrize(("factor", "check"), [(1e6, "unit"), (-1, "sign"), (1e-3, "unit")])
    def test_what_is_wrong_with_a_response(self, tmp_path, compliance, factor, check):
        table = {"frequency_Hz": FREQUENCIES, "real": factor * compliance.real, "imaginary": factor * compliance.imag}
        error = failure(tmp_path, TRANSDUCER + FRF, frf_csv=table)
        assert (error.channel, error.campaign.errors[0].check) == ("response", check)

    @pytest.mark.parametrize(("ohm", "found"), [("5.2 mohm", 0.0052), ("5.2 uohm", 5.2e-6)])
    def test_a_response_behind_a_load_with_a_wrong_prefix(self, tmp_path, device, ohm, found):
        """At 5.2 kohm, as most of these lines are below 1/(R C): there the voltage is in proportion to R."""
        voltage = frequency_response(System(device, Resistor(resistance=5.2e3)), FREQUENCIES).voltage
        text = TRANSDUCER + FRF.replace("displacement", "voltage").replace("97780.0", f'"{ohm}"')
        table = {"frequency_Hz": FREQUENCIES, "real": voltage.real, "imaginary": voltage.imag}
        message = failure(tmp_path, text, frf_csv=table).message
        assert f"a wrong prefix of the load resistance (found {found:g} ohm, 5200 ohm would do" in message

    def test_coherence_beyond_1(self, tmp_path, compliance):
        table = {"frequency_Hz": FREQUENCIES, "real": compliance.real, "imaginary": compliance.imag,
                 "coherence": np.where(FREQUENCIES > 300, 1.3, 0.9)}  # fmt: skip
        assert failure(tmp_path, TRANSDUCER + FRF, frf_csv=table).channel == "coherence"

    @pytest.mark.parametrize(
        ("text", "table", "key"),
        [
            (FRF, {"frequency_Hz": FREQUENCIES, "magnitude": FREQUENCIES}, "response"),
            (FRF, {"line": FREQUENCIES, "real": FREQUENCIES, "imaginary": FREQUENCIES}, "frequency"),
            (FRF + '[records.channels]\nmagnitude = { column = "a" }\n', {"frequency_Hz": FREQUENCIES}, "magnitude"),
            (FRF + '[records.channels]\nmagnitude = { unit = "mm" }\n', {"frequency_Hz": FREQUENCIES},
             "records.0.channels.magnitude.unit"),
            (FRF.replace("displacement", "force"), {"frequency_Hz": FREQUENCIES}, "records.0.output"),
            (FRF.replace("displacement", "velocity") + 'input = "displacement"\n', {"frequency_Hz": FREQUENCIES},
             "records.0.output"),
            (FRF + '[records.channels]\nmagnitude = { unit = "dB re mm" }\n', {"frequency_Hz": FREQUENCIES},
             "records.0.channels.magnitude.unit"),
            (FRF + '[records.channels]\nreal = { unit = "dB" }\n', {"frequency_Hz": FREQUENCIES},
             "records.0.channels.real.unit"),
            (FRF.replace('output = "displacement"\n', ""), {"frequency_Hz": FREQUENCIES}, "records.0.output"),
        ],
    )  # fmt: skip
    def test_what_is_missing(self, tmp_path, text, table, key):
        assert failure(tmp_path, TRANSDUCER + text, frf_csv=table).key == key

    def test_open_leads_are_said(self, tmp_path, device):
        response = frequency_response(System(device, Open()), FREQUENCIES).voltage
        table = {"frequency_Hz": FREQUENCIES, "real": response.real, "imaginary": response.imag}
        text = FRF.replace("displacement", "voltage").replace("load_resistance = 97780.0", 'shunt = { kind = "open" }')
        record = self.only(tmp_path, text, frf_csv=table)
        assert (record.output, record.shunt) == ("voltage", Open())


class TestInstruments:
    """What instruments do to the files of a campaign; see test_instrument_files for the text itself."""

    def written(self, folder, columns, change=lambda text: text, **options):
        """Text file of columns, in some way changed."""
        write_table(columns, folder / "run.csv")
        text = change((folder / "run.csv").read_text())
        (folder / "run.csv").write_text(text, **options)
        return text

    def test_rows_outside_are_not_looked_at(self, tmp_path, columns):
        def change(text):
            lines = text.splitlines()
            lines[100] = "warming up"
            return "\n".join([*lines, "", "Mean,0,0,0,0", "OVERLOAD"])

        text = self.written(tmp_path, columns, change)
        campaign = load(tmp_path, TRANSDUCER + RECORD + "rows = [1002, 5001]\n")
        np.testing.assert_array_equal(campaign.records[0]["voltage"], columns["voltage_V"][1000:])
        assert campaign.records[0].signals["force"].first_row == 1002
        assert campaign.warnings == ()
        assert failure(tmp_path, TRANSDUCER + RECORD).rows == ((101, 101),)
        (tmp_path / "run.csv").write_text(text.replace("warming up", "0.099,0,0,0,0"))
        (finding,) = load(tmp_path, TRANSDUCER + RECORD).warnings
        assert (finding.check, finding.rows) == ("rows below", ((5003, 5003),))
        assert "'Mean 0 0 0 0'" in finding.message

    def test_rows_that_end_in_blank_lines(self, tmp_path, columns):
        self.written(tmp_path, columns, lambda text: text + "\n\nMean,0,0,0,0\n")
        (record,) = load(tmp_path, TRANSDUCER + RECORD + "rows = [2, 5003]\n").records
        assert len(record) == 5000
        for rows in ([2, 5004], [2, 5005], [1, 5001]):
            assert (
                "allowed are rows from 2 to 5001" in failure(tmp_path, TRANSDUCER + RECORD + f"rows = {rows}\n").message
            )

    def test_rows_of_channels_in_files_of_their_own(self, tmp_path, columns):
        self.written(tmp_path, columns)
        np.save(tmp_path / "x.npy", columns["displacement_m"])
        lines = ["# displacement", *map(repr, columns["displacement_m"].tolist()), "Mean 0"]
        (tmp_path / "x.txt").write_text("\n".join(lines))
        for name in ("x.npy", "x.txt"):
            own = f'[records.channels]\ndisplacement = {{ file = "{name}", column = 1 }}\n'
            (record,) = load(tmp_path, TRANSDUCER + RECORD + "rows = [1002, 4001]\n" + own).records
            np.testing.assert_array_equal(record["displacement"], columns["displacement_m"][1000:4000])

    def test_rows_of_findings_where_a_header_comes_again(self, tmp_path, columns):
        columns["voltage_V"][[100, 4000]] = np.nan

        def change(text):
            lines = text.splitlines()
            return "\n".join([*lines[:2001], "", lines[0], *lines[2001:]])

        text = self.written(tmp_path, columns, change)
        error = failure(tmp_path, TRANSDUCER + RECORD)
        assert error.rows == ((102, 102), (4004, 4004))
        assert "nan" in text.splitlines()[4003].lower() or ",," in text.splitlines()[4003]

    def test_where_the_table_begins(self, tmp_path, columns):
        self.written(tmp_path, columns, lambda text: "Calibration\n1,2,3,4,5\n2,3,4,5,6\n3,4,5,6,7\n\n" + text)
        message = failure(tmp_path, TRANSDUCER + RECORD).message
        assert "in the table that begins in line 2; skip_rows" in message
        for key in ("skip_rows = 4", "header_row = 6"):
            (record,) = load(tmp_path, TRANSDUCER + RECORD + key + "\n").records
            np.testing.assert_array_equal(record["current"], columns["current_A"])

    @pytest.mark.parametrize("key", ["skip_rows = -1", "header_row = 0", "header_row = 1.5", 'skip_rows = "x"'])
    def test_lines_that_cannot_be(self, tmp_path, columns, key):
        error = failure(tmp_path, TRANSDUCER + RECORD + key + "\n", run_csv=columns)
        assert error.key == f"records.0.{key.split()[0]}"

    def test_time_in_five_digits(self, tmp_path, columns):
        rate = 1000 / 3
        columns["time_s"] = np.array([float(f"{n / rate:.5g}") for n in range(5000)])
        campaign = load(tmp_path, TRANSDUCER + RECORD, run_csv=columns)
        assert campaign.warnings == ()
        np.testing.assert_allclose(np.diff(campaign.records[0]["time"]), 1 / rate, rtol=1e-6)

    def test_time_stamps_that_are_too_coarse_to_show_a_lost_sample(self, tmp_path, columns):
        columns["time_s"] = np.round(np.arange(5000) / 2500, 3)
        (finding,) = load(tmp_path, TRANSDUCER + RECORD, run_csv=columns).warnings
        assert (finding.check, finding.channel) == ("coarse time", "time")
        campaign = load(tmp_path, TRANSDUCER + RECORD + "sample_rate = 2500.0\n")
        assert campaign.warnings == ()
        assert campaign.records[0].sample_rate == pytest.approx(2500.0, rel=1e-9)

    @pytest.mark.parametrize("lost", [7, 2500, 4990])
    def test_a_lost_sample_is_a_gap_however_it_is_printed(self, tmp_path, columns, lost):
        columns["time_s"] = np.round(np.arange(5000) / 300, 3)
        short = {name: np.delete(values, lost) for name, values in columns.items()}
        error = failure(tmp_path, TRANSDUCER + RECORD, run_csv=short)
        assert error.campaign.errors[0].check == "gap"
        assert error.rows == ((lost + 2, lost + 2),)

    def test_units_of_the_file(self, tmp_path, columns):
        raw = {"Time (ms)": 1e3 * columns["time_s"], "F [kN]": 1e-3 * columns["force_N"],
               "x (µm)": 1e6 * columns["displacement_m"], "voltage_mV": 1e3 * columns["voltage_V"]}  # fmt: skip
        text = """
        [channels]
        time = { column = "Time" }
        force = { column = "F" }
        displacement = { column = "x (µm)", sigma = 0.012, offset = 1.0 }
        voltage = { column = "voltage_mV" }
        """
        (record,) = load(tmp_path, TRANSDUCER + text + RECORD, run_csv=raw).records
        for channel, shift in (("time", 0.0), ("force", 0.0), ("displacement", 1e-6), ("voltage", 0.0)):
            scale = np.max(np.abs(columns[NAMES[channel]]))
            np.testing.assert_allclose(record[channel], columns[NAMES[channel]] + shift, rtol=1e-9, atol=1e-9 * scale)
        assert record.signals["displacement"].sigma == pytest.approx(1.2e-8)

    @pytest.mark.parametrize(
        ("name", "source", "factor"),
        [
            ("voltage (mV)", 'unit = "mV"', 1e-3),
            ("voltage (mV)", 'unit = "millivolt"', 1e-3),
            ("voltage (mV)", "gain = 20", 20.0),  # volts for one raw unit, whatever the file calls it
            ("voltage (mV)", 'unit = "V", gain = 1', 1.0),
            ("voltage (mV)", 'unit = "mV", gain = 3', 3e-3),
            ("voltage [N]", "gain = 2", 2.0),
            ("voltage_mV", 'unit = "V"', 1.0),  # the end of a name is no proof
            ("voltage_A", "", 1.0),
            ("voltage (raw)", "", 1.0),
        ],
    )
    def test_what_the_campaign_says_goes(self, tmp_path, columns, name, source, factor):
        columns[name] = columns.pop("voltage_V") / factor
        own = f'[records.channels]\nvoltage = {{ column = "{name}", {source} }}\n'.replace(",  }", " }")
        (record,) = load(tmp_path, TRANSDUCER + RECORD + own, run_csv=columns).records
        np.testing.assert_allclose(record["voltage"], columns[name] * factor, rtol=1e-12)

    @pytest.mark.parametrize(
        ("name", "source", "said"),
        [
            ("voltage (mV)", 'unit = "V"', ("'mV' in the file", "'V' in the campaign")),
            ("voltage (N)", 'unit = "V"', ("'N' in the file", "'V' in the campaign")),
            ("CH2 [A]", "", ("'A' in the file", "none in the campaign, which means 'V'")),
        ],
    )
    def test_file_and_campaign_contradict_each_other(self, tmp_path, columns, name, source, said):
        columns[name] = columns.pop("voltage_V")
        own = f'[records.channels]\nvoltage = {{ column = "{name}", {source} }}\n'.replace(",  }", " }")
        error = failure(tmp_path, TRANSDUCER + RECORD + own, run_csv=columns)
        assert error.channel == "voltage"
        assert all(part in error.message for part in said)

    def test_sensors_of_different_units_are_not_averaged(self, tmp_path, columns):
        x = columns.pop("displacement_m")
        raw = {**columns, "left (mm)": 1e3 * x, "right (um)": 1e6 * x}
        own = '[records.channels]\ndisplacement = { column = ["left", "right"] }\n'
        assert "'mm' and 'um'" in failure(tmp_path, TRANSDUCER + RECORD + own, run_csv=raw).message

    @pytest.mark.parametrize(
        "channels",
        [
            'voltage = { column = "force_N" }',
            'displacement = { column = "voltage_V", unit = "mm" }',
            "current = { column = 2 }",
            'displacement = { column = ["displacement_m", "current_A"] }',
            'time = { column = "force_N" }',
        ],
    )
    def test_two_channels_have_one_column(self, tmp_path, columns, channels):
        error = failure(tmp_path, TRANSDUCER + f"[channels]\n{channels}\n" + RECORD, run_csv=columns)
        assert "but each channel needs its own column" in error.message
        assert error.message.startswith("column ")

    def test_two_channels_have_the_same_samples(self, tmp_path, columns):
        columns["voltage_V"] = columns["force_N"]
        error = failure(tmp_path, TRANSDUCER + RECORD, run_csv=columns)
        assert (error.channel, error.message) == (
            "voltage", "its samples are the same as those of force, but each channel needs its own samples"
        )  # fmt: skip

    def test_channels_that_are_the_same_by_nature(self, tmp_path, columns):
        """At rest, or across 1 ohm."""
        columns["current_A"] = columns["voltage_V"]
        campaign = TRANSDUCER + RECORD.replace("97780.0", "1.0")
        write_table(columns, tmp_path / "run.csv")
        with pytest.raises(CampaignError) as caught:  # the checks find a current that is far too large
            load(tmp_path, campaign)
        assert "samples are the same" not in caught.value.message
        assert "samples are the same" in failure(tmp_path, campaign.replace("1.0", "2.0")).message

    def test_real_columns_of_a_complex_array(self, tmp_path, columns):
        names = list(columns)
        np.save(tmp_path / "run.npy", np.column_stack([columns[name] for name in names]).astype(complex))
        channels = "".join(f"{channel} = {{ column = {names.index(name) + 1} }}\n" for channel, name in NAMES.items())
        (record,) = load(tmp_path, TRANSDUCER + "[channels]\n" + channels + RECORD.replace("csv", "npy")).records
        np.testing.assert_array_equal(record["voltage"], columns["voltage_V"])
        assert record["voltage"].dtype == float


class TestSweeps:
    """Frequencies come in the order in which an instrument has swept them."""

    def table(self, impedance):
        return {"frequency_Hz": FREQUENCIES, "resistance_ohm": impedance.real, "reactance_ohm": impedance.imag}

    def loaded(self, folder, table):
        return load(folder, TRANSDUCER + IMPEDANCE, z_csv=table)

    def test_downward(self, tmp_path, impedance):
        campaign = self.loaded(tmp_path, {name: values[::-1] for name, values in self.table(impedance).items()})
        (record,) = campaign.records
        np.testing.assert_array_equal(record.frequency, FREQUENCIES)
        np.testing.assert_allclose(record.response, impedance, rtol=1e-12)
        np.testing.assert_array_equal(record.first_row, np.arange(61, 1, -1))
        assert campaign.warnings == ()

    @pytest.mark.parametrize(
        "order", [[*range(40), *range(39, 60)], [*range(60), *range(59, -1, -1)], [*range(60)] * 3]
    )
    def test_overlapping_and_repeated(self, tmp_path, impedance, order):
        table = {name: values[order] for name, values in self.table(impedance).items()}
        campaign = self.loaded(tmp_path, table)
        (record,) = campaign.records
        assert len(record) == len(order)
        assert np.all(np.diff(record.frequency) >= 0)
        np.testing.assert_allclose(record.response, np.interp(record.frequency, FREQUENCIES, impedance), rtol=1e-12)
        assert campaign.warnings == ()

    def test_rows_of_findings_in_a_sweep_downward(self, tmp_path, impedance):
        table = {name: values[::-1].copy() for name, values in self.table(impedance).items()}
        table["resistance_ohm"][[5, 6, 20]] = np.nan
        with pytest.raises(CampaignError) as caught:
            self.loaded(tmp_path, table)
        assert caught.value.rows == ((7, 8), (22, 22))

    @pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
    def test_a_line_at_0_hz_is_left_out(self, tmp_path, impedance, value):
        table = {name: np.append(0.0 if "Hz" in name else value, part) for name, part in self.table(impedance).items()}
        campaign = self.loaded(tmp_path, table)
        np.testing.assert_array_equal(campaign.records[0].frequency, FREQUENCIES)
        (finding,) = campaign.warnings
        assert (finding.check, finding.rows) == ("0 Hz", ((2, 2),))

    def test_nothing_but_0_hz(self, tmp_path):
        table = {name: np.zeros(3) for name in ("frequency_Hz", "resistance_ohm", "reactance_ohm")}
        with pytest.raises(CampaignError, match="all frequencies are 0 Hz"):
            self.loaded(tmp_path, table)

    def test_rows_of_a_sweep(self, tmp_path, impedance):
        write_table(self.table(impedance), tmp_path / "z.csv")
        with (tmp_path / "z.csv").open("a") as stream:
            stream.write("\nMean,0,0\n")
        (record,) = load(tmp_path, TRANSDUCER + IMPEDANCE + "rows = [12, 51]\n").records
        np.testing.assert_array_equal(record.frequency, FREQUENCIES[10:50])

    @pytest.mark.parametrize("ending", ["npz", "mat", "h5"])
    def test_a_frequency_of_a_complex_array(self, tmp_path, compliance, ending):
        data = np.column_stack([FREQUENCIES.astype(complex), compliance])
        name = tmp_path / f"frf.{ending}"
        {"npz": lambda: np.savez(name, H=data), "mat": lambda: savemat(name, {"H": data}),
         "h5": lambda: write_h5(name, data)}[ending]()  # fmt: skip
        own = '[records.channels]\nfrequency = { column = "H[:, 0]" }\nresponse = { column = "H[:, 1]" }\n'
        (record,) = load(tmp_path, TRANSDUCER + FRF.replace("csv", ending) + own).records
        np.testing.assert_array_equal(record.frequency, FREQUENCIES)
        np.testing.assert_array_equal(record.response, compliance)

    def test_parts_of_different_length(self, tmp_path, compliance):
        np.savez(tmp_path / "frf.npz", frequency_Hz=FREQUENCIES, response=compliance[:-1])
        error = failure(tmp_path, TRANSDUCER + FRF.replace("csv", "npz"))
        assert (error.channel, "found 59 values" in error.message) == ("response", True)

    def test_one_column_for_two_parts(self, tmp_path, impedance):
        own = '[records.channels]\nimaginary = { column = "resistance_ohm" }\n'
        error = failure(tmp_path, TRANSDUCER + IMPEDANCE + own, z_csv=self.table(impedance))
        assert "column 'resistance_ohm' is also that of real" in error.message

    def test_units_of_an_analyser(self, tmp_path, impedance):
        size, phase = np.abs(impedance) / 1e3, np.degrees(np.angle(impedance))
        table = {"Frequency(kHz)": FREQUENCIES / 1e3, "|Z|(kohm)-data": size, "thetaz(deg)-data": phase}
        own = "frequency = { column = 1 }, magnitude = { column = 2 }, phase = { column = 3 }"
        (record,) = load(tmp_path, TRANSDUCER + IMPEDANCE + f"channels = {{ {own} }}\n", z_csv=table).records
        np.testing.assert_allclose(record.frequency, FREQUENCIES, rtol=1e-12)
        np.testing.assert_allclose(record.response, impedance, rtol=1e-9)

    @pytest.mark.parametrize("name", ["Z (dB)", "Z_dB"])
    def test_decibels_are_no_ohms(self, tmp_path, impedance, name):
        level = 20 * np.log10(np.abs(impedance))
        table = {"frequency_Hz": FREQUENCIES, name: level, "phase_rad": np.angle(impedance)}
        own = f'channels = {{ magnitude = {{ column = "{name}" }} }}\n'
        error = failure(tmp_path, TRANSDUCER + IMPEDANCE + own, z_csv=table)
        assert "found levels in dB in the file" in error.message


def write_h5(path, data):
    with h5py.File(path, "w") as file:
        file["H"] = data
