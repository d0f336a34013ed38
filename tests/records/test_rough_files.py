"""Files as laboratories have them: cut off, with other names of columns, of another kind than their ending says."""

import numpy as np
import pytest

from piezoharvest.description.parameters import ParameterError
from piezoharvest.readers import ReadError, open_reader
from piezoharvest.readers.conversion import unit_factor, with_unit
from piezoharvest.readers.units import unit_of
from piezoharvest.records import CampaignError, load_campaign

TRANSDUCER = "[transducer]\nmass=0.010\ndamping=0.0628\nstiffness=986.96\ncoupling=1e-3\ncapacitance=40e-9\n"
TIME = np.arange(400) / 1000
FORCE = 0.02 * np.sin(2 * np.pi * 20 * TIME)
MOVED = 21e-6 * np.sin(2 * np.pi * 20 * TIME - 0.02)
ROWS = [f"{t:.3f},{f:.8e},{x:.8e}" for t, f, x in zip(TIME, FORCE, MOVED, strict=True)]
TEKTRONIX = ["Model,MSO24", "Horizontal Units,s", "Sample Interval,0.001", "Record Length,400", "Vertical Units,V,V"]
LABVIEW = [
    "LabVIEW Measurement\t", "Separator\tTab", "Decimal_Separator\t.", "X_Columns\tNo", "***End_of_Header***\t",
    "Channels\t2", "Samples\t400\t400", "Y_Unit_Label\tN\tm", "X0\t0\t0", "Delta_X\t0.001\t0.001",
    "***End_of_Header***", "X_Value\tforce\tdisplacement\tComment",
]  # fmt: skip
TOUCHSTONE = ["[Version] 2.0", "# Hz Z RI R 1", "[Number of Ports] 1", "[Number of Frequencies] 30", "[Network Data]"]
IMPEDANCES = [f"{f:.1f} 100.000000 {-1 / (2 * np.pi * f * 40e-9):.6f}" for f in np.linspace(10, 400, 30)]


def campaign(tmp_path, name, lines, record="", end="\n"):
    """Campaign of one record with these lines in its file."""
    (tmp_path / name).write_text("\n".join(lines) + end, encoding="utf-8")
    path = tmp_path / "campaign.toml"
    load = "" if "impedance" in record else "load_resistance = 1e5\n"
    path.write_text(f'{TRANSDUCER}[[records]]\nfile = "{name}"\n{load}{record}')
    return load_campaign(path)


def cut_off(found):
    return [finding.message for finding in found.warnings if finding.check == "cut off"]


CHANNELS = 'channels = { force = { column = "CH1", unit = "N" }, displacement = { column = "CH2", unit = "m" } }\n'
NAMED = 'channels = { force = { column = "force" }, displacement = { column = "displacement" } }\n'
KINDS = {
    "scope.csv": ([*TEKTRONIX, "TIME,CH1,CH2"], ROWS, CHANNELS, "found 300 samples, but the header of the file"),
    "run.lvm": (LABVIEW, ["\t" + r.partition(",")[2].replace(",", "\t") for r in ROWS], NAMED, "found 300 samples"),
    "leads.z1p": (TOUCHSTONE, IMPEDANCES, 'kind = "impedance"\n', "found 22 frequencies, but the header of the file"),
}  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_fewer_rows_than_the_header_promises(tmp_path, name):
    head, rows, record, said = KINDS[name]
    assert not cut_off(campaign(tmp_path, name, head + rows, record))
    found = cut_off(campaign(tmp_path, name, head + rows[: len(rows) * 3 // 4], record))
    assert len(found) == 1 and found[0].startswith(said) and found[0].endswith("likely the file is cut off")


@pytest.mark.parametrize("name", ["run.csv", "leads.z1p"])
def test_a_file_that_ends_within_a_number(tmp_path, name):
    head, rows, record = ["time_s,force_N,displacement_m"], ROWS, ""
    if name == "leads.z1p":
        head, rows, record = TOUCHSTONE[1:2], IMPEDANCES, 'kind = "impedance"\n'
    assert not cut_off(campaign(tmp_path, name, head + rows, record, end=""))  # as some programs write
    found = cut_off(campaign(tmp_path, name, head + rows[:-1] + [rows[-1][:-6]], record, end=""))
    assert len(found) == 1 and "is not terminated and is shorter than those before it" in found[0]


@pytest.mark.parametrize(("title", "warned"), [("TIME", 1), ("Time (s)", 0), ("time_s", 0), ("Time [ms]", 0)])
def test_a_column_named_time_is_the_time(tmp_path, title, warned):
    step = 1e3 if "ms" in title else 1.0
    rows = [f"{float(row.partition(',')[0]) * step:.3f},{row.partition(',')[2]}" for row in ROWS]
    found = campaign(tmp_path, "run.csv", [f"{title},force_N,displacement_m", *rows])
    assert found.records[0].sample_rate == pytest.approx(1000.0)
    assert sum(finding.check == "time unit" for finding in found.warnings) == warned


def frf(tmp_path, names, scale=1.0, degrees=True, record=""):
    """Campaign of a receptance under column names."""
    f = np.linspace(40, 60, 101)
    receptance = 1 / (986.96 + 0.0628j * 2 * np.pi * f - 0.010 * (2 * np.pi * f) ** 2)
    phase = np.angle(receptance, deg=degrees)
    rows = [f"{a:.4f},{scale * abs(b):.8e},{c:.8e}" for a, b, c in zip(f, receptance, phase, strict=True)]
    found = campaign(tmp_path, "h.csv", [names, *rows], f'kind = "frf"\noutput = "displacement"\n{record}')
    return found, receptance


@pytest.mark.parametrize(
    ("names", "scale", "degrees"),
    [
        ("Frequency (Hz),Magnitude [nm/N],Phase [deg]", 1e9, True),
        ("Frequency [Hz],Magnitude [nm/(N)],Phase [°]", 1e9, True),
        ("f [Hz],Mag (m/N),Phase (rad)", 1.0, False),
        ("Frequency (Hz),Trace 1: Gain: Magnitude,Trace 1: Gain: Phase (°)", 1.0, True),
    ],
)
def test_columns_of_a_response_as_analysers_name_them(tmp_path, names, scale, degrees):
    found, receptance = frf(tmp_path, names, scale, degrees)
    np.testing.assert_allclose(found.records[0].response, receptance, rtol=1e-6)
    assert not found.warnings


def test_a_phase_in_degrees_that_nothing_says(tmp_path):
    columns = 'channels = { magnitude = { column = "a" }, phase = { column = "b" PLUS } }\n'
    found, _ = frf(tmp_path, "frequency_Hz,a,b", record=columns.replace(" PLUS", ""))
    assert [(f.channel, f.message) for f in found.warnings if f.check == "unit"] == [
        ("phase", 'found up to 176.9, taken for radians; likely degrees, which need unit = "deg"')
    ]
    found, receptance = frf(tmp_path, "frequency_Hz,a,b", record=columns.replace(" PLUS", ', unit = "deg"'))
    np.testing.assert_allclose(found.records[0].response, receptance, rtol=1e-6)
    assert not found.warnings


def test_magnitudes_below_zero_and_levels_are_refused(tmp_path):
    with pytest.raises(CampaignError, match=r"magnitude, rows 2-102: found 101 values below 0, allowed are"):
        frf(tmp_path, "frequency_Hz,magnitude,phase_deg", -1.0)
    with pytest.raises(CampaignError, match=r'found levels in dB in the file: unit = "dB re m/N" defines 0 dB'):
        frf(tmp_path, "Frequency (Hz),Magnitude (dB),Phase (deg)")


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.npz", b"hello", "does not begin as .npz files do"),
        ("a.tdms", b"hello", "does not begin as .tdms files do"),
        ("a.wav", b"hello", "does not begin as .wav files do"),
        ("a.parquet", b"hello", "does not begin as .parquet files do"),
        ("a.xlsx", b"PK", "a spreadsheet, which cannot be read: save the sheet as .csv"),
        ("folder.csv", None, "a directory"),
        ("folder", None, "found a directory, but a data file is needed"),
    ],
)
def test_files_of_another_kind(tmp_path, name, data, said):
    path = tmp_path / name
    path.mkdir() if data is None else path.write_bytes(data)
    with pytest.raises(ReadError) as error:
        open_reader(path)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [("kOhm", "ohm", 1e3), ("MOHM", "ohm", 1e6), ("Ohms", "ohm", 1.0), ("khz", "Hz", 1e3), ("HZ", "Hz", 1.0),
     ("V/kOhm", "A", 1e-3)],
)  # fmt: skip
def test_units_as_people_write_them(unit, si, factor):
    assert unit_factor(unit, si) == pytest.approx(factor)


def test_a_decimal_comma_is_named():
    with pytest.raises(ParameterError, match=r"found '10,5 g', must have a decimal point, not a comma"):
        with_unit("10,5 g", "kg")


@pytest.mark.parametrize(
    ("text", "of", "size"),
    [
        ("dB re 1 m/(s\u00b7N)", "(m/s)/N", 1.0), ("dB (re 1 m/s/N)", "(m/s)/N", 1.0),
        ("dB rel 1 mm/s/N", "(m/s)/N", 1e-3),
        ("dB re 1 mm/(N s\u00b2)", "(m/s^2)/N", 1e-3), ("dB (um/N)", "m/N", 1e-6),
    ],
)  # fmt: skip
def test_what_zero_decibels_are_of(text, of, size):
    """As analysers write it, with what a mobility is divided by in brackets."""
    unit = unit_of(text)
    assert unit is not None
    assert (unit.si, unit.of) == ("dB", of)
    assert unit.factor == pytest.approx(size, rel=1e-12)


@pytest.mark.parametrize(("text", "si"), [("33", "ohm"), (" -1.5e-3 ", "N"), ("4.", "m/s^2")])
def test_a_missing_unit_is_named(text, si):
    """It read "found '33', must be a finite number greater than 0 ohm", which 33 is."""
    with pytest.raises(ParameterError, match="without its unit, must be a number, or text such as") as caught:
        with_unit(text, si)
    assert f"found {text!r}" in caught.value.message and f"'{text.strip()} {si}'" in caught.value.message
    assert with_unit(text, "") is None  # a pure number has none
