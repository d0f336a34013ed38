"""Campaigns from arrays and DataFrames: the same as from files, with the same checks."""

from __future__ import annotations

import doctest
from dataclasses import replace

import numpy as np
import pytest
from messages import is_sentence

from piezoharvest import Campaign, CampaignError, Resistor, Transducer, load_campaign
from piezoharvest.description.transducer import Electrode
from piezoharvest.records import loading

RATE = 1000.0
NOMINAL = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
RANDOM = np.random.default_rng(5)
DATA = {"force_N": RANDOM.normal(size=300), "displacement_m": 1e-3 * RANDOM.normal(size=300)}
KEYS = {"sample_rate": RATE, "load_resistance": 1e5}


def failure(*arguments, **keywords) -> CampaignError:
    with pytest.raises(CampaignError) as caught:
        Campaign.from_arrays(*arguments, **keywords)
    assert is_sentence(caught.value.message)
    return caught.value


def test_the_example_of_its_documentation_runs():
    runner = doctest.DocTestRunner()
    (example,) = doctest.DocTestFinder().find(loading.Campaign.from_arrays, "from_arrays")
    assert runner.run(example) == doctest.TestResults(failed=0, attempted=8)


def test_the_same_as_from_a_file(tmp_path):
    np.savez(tmp_path / "run.npz", **DATA)
    keys = "".join(f"{key} = {value}\n" for key, value in KEYS.items())
    nominal = "mass = 0.01\ndamping = 0.0628\nstiffness = 986.96\ncoupling = 1e-3\ncapacitance = 40e-9\n"
    channels = 'displacement = { unit = "mm", gain = 2e3, sigma = 0.5 }\n'
    text = f'[transducer]\n{nominal}[channels]\n{channels}[[records]]\nfile = "run.npz"\n{keys}'
    (tmp_path / "campaign.toml").write_text(text)
    from_file = load_campaign(tmp_path / "campaign.toml")
    assert isinstance(from_file, Campaign)
    displacement = {"unit": "mm", "gain": 2e3, "sigma": 0.5}
    made = Campaign.from_arrays(NOMINAL, [{"data": DATA, **KEYS}], channels={"displacement": displacement})
    assert made.transducer == from_file.transducer
    (record,), (other,) = made.records, from_file.records
    assert (record.drive, record.shunt, record.role) == (other.drive, other.shunt, other.role)
    for channel in ("time", *other.signals):
        np.testing.assert_array_equal(record[channel], other[channel])
    assert record.signals["displacement"].sigma == other.signals["displacement"].sigma == 0.5e-3


def test_a_record_stays_as_it_was():
    data = {name: values.copy() for name, values in DATA.items()}
    (record,) = Campaign.from_arrays(NOMINAL, [{"data": data, **KEYS}]).records
    data["force_N"][:] = 0.0
    np.testing.assert_array_equal(record["force"], DATA["force_N"])


def test_frequency_responses_stand_beside_time_records():
    f = np.linspace(1.0, 400.0, 60)
    w = 2 * np.pi * f
    accelerance = -(w**2) / (986.96 + (1e-3) ** 2 / 40e-9 - 0.01 * w**2 + 0.0628j * w)
    response = {"kind": "frf", "output": "acceleration", "shunt": {"kind": "open"}}
    frf = {"data": {"frequency_Hz": f, "response": accelerance}, "name": "hammer", **response}
    time, spectrum = Campaign.from_arrays(NOMINAL, [{"data": DATA, **KEYS}, frf]).records
    assert (time.name, spectrum.name) == ("record 1", "hammer")
    np.testing.assert_array_equal(spectrum.response, accelerance)


@pytest.mark.parametrize("index", ["numbers", "differences", "dates", "none"])
def test_a_frame(index):
    pandas = pytest.importorskip("pandas")
    time = np.arange(300) / RATE
    frame = pandas.DataFrame({**DATA, "note": "x"})
    if index != "none":
        stamps = {"numbers": time, "differences": pandas.to_timedelta(time, unit="s"),
                  "dates": pandas.Timestamp("2024-03-01") + pandas.to_timedelta(time, unit="s")}[index]  # fmt: skip
        frame.index = pandas.Index(stamps, name="time_s")
    keys = {"shunt": Resistor(resistance=1e5), **({"sample_rate": np.float64(RATE)} if index == "none" else {})}
    (record,) = Campaign.from_frame(frame, NOMINAL, name="shaker", **keys).records
    np.testing.assert_allclose(record["time"], time, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(record["displacement"], DATA["displacement_m"])
    assert (record.name, record.shunt) == ("shaker", Resistor(resistance=1e5))


GAP = {**DATA, "displacement_m": np.where(np.arange(300) == 40, np.nan, DATA["displacement_m"])}


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ({"data": GAP, **KEYS}, ["record 1: displacement, row 41: found 1 value NaN"]),
        ({"data": GAP, "name": "run 7", **KEYS}, ["run 7: displacement, row 41"]),
        ({"data": {**DATA, "displacement_m": DATA["force_N"][:7]}, **KEYS}, ["displacement: found 7 samples"]),
        ({"data": {**DATA, "displacement_m": ["a"] * 300}, **KEYS}, ["record 1: displacement", "allowed are numbers"]),
        ({"data": {**DATA, "x": np.eye(3)}, **KEYS}, ["record 1: x: found an array of shape (3, 3)"]),
        ({"data": {"force": DATA["force_N"]}, **KEYS},
         ["record 1: force, the drive: the mapping has no key 'force_N' (did you mean 'force'?), its keys are force; "
          'channels = {"force": {"column": NAME}} names another key']),
        ({"data": {}, **KEYS}, ["record 1: force, the drive: the mapping has no key 'force_N', it is empty"]),
        ({"data": DATA, "load_resistance": 1e5},
         ["record 1: time: there is no time among the keys ",
          "another one in channels, or sample_rate in the record"]),
        ({"data": {"f": DATA["force_N"]}, "kind": "frf", "output": "velocity", "load_resistance": 1.0},
         ["record 1: response: missing key, the mapping has f; expected are "]),
        ({"data": DATA, "sample_rate": RATE}, ["records.0.load_resistance: missing key"]),
        ({"data": 3, **KEYS}, ["record 1: found data of type int"]),
        ({"data": DATA, "skip_rows": 3, **KEYS}, ["records.0.skip_rows: found a key of records in files"]),
        (KEYS, ["records.0.data: missing key"]),
        (3, ["records.0: found 3"]),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_record_and_channel(record, words):
    message = str(failure(NOMINAL, [record]))
    assert [word for word in words if word not in message] == [], message


def test_the_words_of_a_frame():
    pandas = pytest.importorskip("pandas")
    message = str(failure(NOMINAL, [{"data": pandas.DataFrame({"Kraft": DATA["force_N"]}), **KEYS}]))
    assert "the DataFrame has no column 'force_N', its columns are Kraft; channels = " in message


def test_a_key_whose_name_is_almost_that_of_a_channel():
    data = {**DATA, "velocity_mm_s": np.gradient(DATA["displacement_m"])}
    (finding,) = Campaign.from_arrays(NOMINAL, [{"data": data, **KEYS}]).warnings
    assert (finding.check, finding.channel) == ("unused column", "velocity")
    assert finding.message.startswith("the key 'velocity_mm_s' is not used, as 'velocity_m_s' is expected; channels")


def test_no_records():
    assert failure(NOMINAL, []).key == failure(NOMINAL, {"data": DATA}).key == "records"


RECORDS = 'as in records = [{"data": {"force_N": ..., "displacement_m": ...}, "load_resistance": 1e5}]'


@pytest.mark.parametrize(
    ("records", "found"),
    [
        ({"data": DATA, **KEYS}, "a dict"),
        ("run.csv", "'run.csv'"),
        (3, "3"),
        (None, "None"),
        (Campaign.from_arrays(NOMINAL, [{"data": DATA, **KEYS}]), "a Campaign"),
    ],
)
def test_records_that_are_no_list(records, found):
    assert failure(NOMINAL, records).message == f"found {found}, must be a list of mappings, {RECORDS}"


def test_a_frame_in_the_place_of_records():
    pandas = pytest.importorskip("pandas")
    message = failure(NOMINAL, pandas.DataFrame(DATA)).message
    assert message == f"found a DataFrame, must be a list of mappings, {RECORDS}"


@pytest.mark.parametrize(
    ("record", "found"), [(DATA["force_N"], "a ndarray"), (["x"], "a list"), ("run.csv", "'run.csv'")]
)
def test_a_record_that_is_no_mapping(record, found):
    caught = failure(NOMINAL, [record])
    assert caught.key == "records.0"
    assert caught.message == f"found {found}, must be a mapping with the key data, {RECORDS}"


@pytest.mark.parametrize("channels", [[3], "force", 3, [{"force": "F"}]])
def test_channels_that_are_no_table(channels):
    caught = failure(NOMINAL, [{"data": DATA, **KEYS}], channels=channels)
    assert caught.key == "channels"
    example = 'force = { column = "F" } (in Python: {"force": {"column": "F"}})'
    assert caught.message.endswith(f", must be a table for each channel, as in {example}")


@pytest.mark.parametrize(
    ("source", "found", "toml", "python"),
    [
        ("Kraft", "'Kraft'", '{ column = "Kraft" }', '{"column": "Kraft"}'),
        (2, "2", "{ column = 2 }", '{"column": 2}'),
        (["a", "b"], "a list", '{ column = "F" }', '{"column": "F"}'),
        (DATA["force_N"], "a ndarray", '{ column = "F" }', '{"column": "F"}'),
    ],
)
@pytest.mark.parametrize("own", [False, True])
def test_a_channel_that_is_no_table(source, found, toml, python, own):
    """The campaign's channels and those of one record."""
    channels = {"channels": {"force": source}}
    record = {"data": DATA, **KEYS, **(channels if own else {})}
    caught = failure(NOMINAL, [record], **({} if own else channels))
    assert caught.key == ("records.0.channels.force" if own else "channels.force")
    assert caught.message == f"found {found}, must be a table, as in force = {toml} (in Python: {python})"


def test_a_transducer_with_further_electrodes():
    several = replace(NOMINAL, electrodes=(Electrode(coupling=(1e-3,), capacitance=1e-9),))
    assert failure(several, [{"data": DATA, **KEYS}]).key == "transducer.electrodes"


def test_a_table_of_a_transducer_is_checked():
    assert failure({"mass": 1.0}, [{"data": DATA, **KEYS}]).key == "transducer.damping"


def test_masked_samples_are_missing():
    force = np.ma.masked_array(DATA["force_N"], mask=[True, *[False] * 299])
    caught = failure(NOMINAL, [{"data": {**DATA, "force_N": force}, **KEYS}])
    assert "NaN, infinite or missing" in caught.message


@pytest.mark.parametrize("keys", [{}, {"kind": "periodic"}])
def test_a_tracker_needs_the_excitation_of_a_study(keys):
    tracker = {"kind": "mppt", "fraction": 0.5}
    caught = failure(NOMINAL, [{"data": DATA, "sample_rate": RATE, "shunt": tracker, **keys}])
    assert caught.key == "records.0.shunt.kind"
    assert caught.message.startswith("found 'mppt', which takes its voltage from the excitation of a study")
