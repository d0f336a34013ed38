"""Results as notebooks show them: a short text, a table, a frame, axes."""

import dataclasses

import matplotlib
import numpy as np
import pytest

from piezoharvest import (
    Campaign,
    DesignOptions,
    Digital,
    Hysteresis,
    Leakage,
    Mode,
    ParallelSSHI,
    Resistor,
    SineForce,
    Study,
    System,
    Transducer,
    TwoPort,
    design,
    frequency_response,
    identify,
    sampled_loop,
    simulate,
)
from piezoharvest.design.result import DesignResult
from piezoharvest.identify.confidence import confidence_region, correlations
from piezoharvest.specimen import Specimen

matplotlib.use("agg")

TRANSDUCER = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
FORCE = SineForce(amplitude=0.02, frequency=50.6)
SSHI = ParallelSSHI(inductance=0.1, quality=5.0, smoothing_capacitance=1e-6, load_resistance=1e6, diode_drop=0.3)


@pytest.fixture(scope="module")
def response():
    return simulate(System(TRANSDUCER, SSHI), FORCE)


@pytest.fixture(scope="module")
def designed() -> DesignResult:
    options = DesignOptions(candidates=("resistor", "short"))
    return design(Study(transducer=TRANSDUCER, excitation=FORCE, design=options))


@pytest.fixture(scope="module")
def campaign():
    f, n = np.linspace(40.0, 60.0, 30), np.arange(400)
    data = {"force_N": 0.02 * np.sin(0.2 * n), "displacement_m": 3e-5 * np.sin(0.2 * n)}
    time = {"data": data, "sample_rate": 1000.0, "load_resistance": 1e5, "name": "shaker"}
    s = 2j * np.pi * f
    response = {"frequency_Hz": f, "response": s / (986.96 + 0.0628 * s + 0.01 * s**2)}
    spectrum = {"data": response, "kind": "frf", "output": "velocity", "shunt": {"kind": "short"}, "name": "hammer"}
    return Campaign.from_arrays(TRANSDUCER, [time, spectrum], title="bench")


class TestCampaign:
    """Records hold thousands of samples, which a text or a table of them does not list."""

    def test_text_is_a_line(self, campaign):
        assert repr(campaign) == "<Campaign: bench, 2 records, 0 warnings>"
        assert [repr(record) for record in campaign.records] == [
            "<Record: shaker, 400 samples, driven by force>", "<FrequencyRecord: hammer, 30 lines of velocity/force>",
        ]  # fmt: skip

    def test_table(self, campaign):
        assert [(row["record"], row["drive"], row["load"]) for row in campaign.rows] == [
            ("shaker", "force", "resistor"), ("hammer", "frf", "short"),
        ]  # fmt: skip
        assert "<td>hammer</td>" in campaign._repr_html_()
        assert "<td>displacement</td><td>-3e-05</td>" in campaign.records[0]._repr_html_()

    def test_frames_hold_what_was_measured(self, campaign):
        pytest.importorskip("pandas")
        time, spectrum = (record.to_frame() for record in campaign.records)
        np.testing.assert_array_equal(time["force"], campaign.records[0]["force"])
        np.testing.assert_array_equal(spectrum["velocity/force"], campaign.records[1].response)
        assert (time.index.name, spectrum.index.name, len(time), len(spectrum)) == ("time", "frequency", 400, 30)


class TestResponse:
    def test_text_is_a_line(self, response):
        text = repr(response)
        assert text.startswith("<Response: parallel_sshi, ") and "converged" in text and len(text) < 100

    def test_table(self, response):
        page = response._repr_html_()
        assert "<td>harvested_power</td>" in page and f"<td>{response.harvested_power:.4g}</td>" in page

    def test_frame_of_the_waveforms(self, response):
        found = response.to_frame()
        assert found.index.name == "time" and len(found) == len(response.waveforms.time)
        assert np.array_equal(found["voltage"], response.waveforms.voltage)
        figures = dataclasses.replace(response, waveforms=None).to_frame().set_index("figure")
        assert figures.loc["harvested_power", "value"] == response.harvested_power

    def test_plot(self, response):
        above, below = response.plot()
        assert np.array_equal(above.lines[0].get_ydata(), response.waveforms.displacement)
        assert [line.get_label() for line in below.lines] == ["electrodes", "behind the bridge"]
        given = matplotlib.figure.Figure().subplots()
        assert response.plot(given) is given and np.array_equal(given.lines[0].get_ydata(), response.waveforms.voltage)
        with pytest.raises(ValueError, match="no waveforms"):
            dataclasses.replace(response, waveforms=None).plot()


LEAKY = dataclasses.replace(
    TRANSDUCER, name="bench <1>", effects=(Leakage(resistance=1e7),), modes=(Mode(mass=0.01, damping=0.1, stiffness=1e4,
    coupling=1e-3),), hysteresis=Hysteresis(weights=(1e5, 2e5), thresholds=(1e-7, 2e-7)),
)  # fmt: skip
FREQUENCIES = np.linspace(40.0, 60.0, 300)
SPECIMEN = Specimen({"mass": 0.01, "effects.leakage.resistance": 1e7}, np.diag([1e-8, 1e10]), ("linear", "log"), LEAKY,
                    lacking={"coupling": "a voltage"})  # fmt: skip
RESISTIVE = System(TRANSDUCER, Resistor(resistance=1e5))
SAMPLED = Digital(numerator=(1.0,), denominator=(1e5,), sample_time=1e-5)


@pytest.mark.parametrize(
    ("what", "line"),
    [
        (lambda: TwoPort.of(TRANSDUCER, FREQUENCIES), "<TwoPort: 300 frequencies from 40 to 60 Hz>"),
        (lambda: TwoPort.of(TRANSDUCER, 50.0), "<TwoPort: 1 frequency, 50 Hz>"),
        (lambda: SPECIMEN, "<Specimen: 2 identified values, 1 not identifiable>"),
        (lambda: dataclasses.replace(SPECIMEN, transducer=None, lacking={}), "<Specimen: 2 identified values>"),
        (lambda: frequency_response(RESISTIVE, FREQUENCIES),
         "<FrequencyResponse: 300 frequencies from 40 to 60 Hz, per N of force>"),
    ],
)  # fmt: skip
def test_what_holds_arrays_is_shown_in_a_line_and_a_table(what, line):
    found = what()
    assert repr(found) == line
    assert found._repr_html_().count("<tr>") == 1 + len(found.rows)


def test_waveforms_are_a_line_and_a_table(response):
    waves = response.waveforms
    n, span, events = len(waves.time), waves.time[-1] - waves.time[0], len(waves.event_times)
    assert repr(waves) == f"<Waveforms: {n} samples over {span:.4g} s, {events} events>"
    rows = {row["quantity"]: (row["unit"], row["most"]) for row in waves.rows}
    assert rows["voltage"] == ("V", waves.voltage.max()) and len(rows) == 10


def test_a_sampled_loop_is_a_line():
    text = repr(sampled_loop(System(TRANSDUCER, SAMPLED)))
    assert text.startswith("<SampledLoop: ") and " states, every 1e-05 s, radius 0.99" in text and len(text) < 100


def test_a_batch_of_designs_is_one_line():
    loads = np.array([[1e4], [1e5]])
    found = frequency_response(System(TRANSDUCER, Resistor(resistance=loads)), FREQUENCIES)
    assert repr(found) == "<FrequencyResponse: 2 designs at 300 frequencies from 40 to 60 Hz, per N of force>"
    assert {row["quantity"]: row["unit"] for row in found.rows}["harvested_power"] == "W/N^2"


def test_tables_hold_the_values():
    port = TwoPort.of(TRANSDUCER, FREQUENCIES)
    row = next(row for row in port.rows if row["quantity"] == "z12")
    assert row == {"quantity": "z12", "unit": "N/A", "least": abs(port.z[:, 0, 1]).min(),
                   "most": abs(port.z[:, 0, 1]).max()}  # fmt: skip
    values = {row["parameter"]: (row.get("value"), row.get("unit")) for row in SPECIMEN.rows}
    assert values == {
        "mass": (0.01, "kg"), "effects.leakage.resistance": (1e7, "ohm"), "coupling": (None, None),
    }  # fmt: skip


def test_a_transducer_has_a_table():
    rows = {row["parameter"]: (row["value"], row["unit"]) for row in LEAKY.rows}
    wanted = {
        "mass": (0.01, "kg"), "coupling": (1e-3, "N/V"), "modes.0.stiffness": (1e4, "N/m"),
        "hysteresis.thresholds.1": (2e-7, "C"), "effects.leakage.resistance": (1e7, "ohm"),
    }  # fmt: skip
    assert rows.items() >= wanted.items() and "effective_mass" not in rows
    page = LEAKY._repr_html_()
    assert "<caption>bench &lt;1&gt;, 50 Hz shorted, k_e^2 0.02533</caption>" in page
    assert "<td>capacitance</td><td>4e-08</td><td>F</td><td>clamped capacitance C</td>" in page
    assert repr(LEAKY).startswith("Transducer(mass=0.01, ")  # as Python writes it, to be copied


def test_a_table_of_transducers_that_are_a_batch_or_quasi_static():
    batch = dataclasses.replace(TRANSDUCER, stiffness=np.array([[900.0], [1000.0]]))
    assert "<caption>transducer, a batch of designs</caption>" in batch._repr_html_()
    assert "<td>2 from 900 to 1000</td>" in batch._repr_html_()
    film = dataclasses.replace(TRANSDUCER, quasi_static=True)
    assert film.heading == "transducer, k_e^2 0.02533"
    assert not {"mass", "damping"} & {row["parameter"] for row in film.rows}


def test_frames_of_what_holds_arrays(response):
    pytest.importorskip("pandas")
    port, swept = TwoPort.of(TRANSDUCER, FREQUENCIES), frequency_response(RESISTIVE, FREQUENCIES)
    waveforms = response.waveforms
    for found, index, column, wanted in (
        (port, "frequency", "z22", port.z[:, 1, 1]), (swept, "frequency", "voltage", swept.voltage),
        (waveforms, "time", "voltage", waveforms.voltage),
    ):  # fmt: skip
        table = found.to_frame()
        assert table.index.name == index
        np.testing.assert_array_equal(table[column], wanted)


def test_a_two_port_is_drawn():
    port = TwoPort.of(TRANSDUCER, FREQUENCIES)
    above, below = port.plot()
    np.testing.assert_array_equal(above.lines[0].get_ydata(), abs(port.impedance()))
    np.testing.assert_array_equal(below.lines[1].get_ydata(), abs(port.mechanical_impedance(0.0)))
    given = matplotlib.figure.Figure().subplots()
    assert port.plot(given) is given and [line.get_label() for line in given.lines] == ["free", "clamped"]


def test_a_frequency_response_is_drawn():
    swept = frequency_response(RESISTIVE, FREQUENCIES)
    above, below = swept.plot()
    np.testing.assert_array_equal(above.lines[0].get_ydata(), abs(swept.displacement))
    np.testing.assert_array_equal(below.lines[0].get_ydata(), abs(swept.voltage))
    given = matplotlib.figure.Figure().subplots()
    loads = Resistor(resistance=np.array([[1e4], [1e5]]))
    assert frequency_response(System(TRANSDUCER, loads), FREQUENCIES).plot(given) is given
    assert (len(given.lines), given.get_ylabel()) == (2, "displacement in m/N")


def test_a_study_is_a_line_and_a_table():
    study = Study(title="fan", transducer=LEAKY, excitation=FORCE, shunts=(SSHI, Resistor(resistance=1e5)),
                  design=DesignOptions(candidates=("short",)))  # fmt: skip
    assert repr(study) == "<Study: fan, bench <1>, sine_force, 2 shunts, design>"
    page = study._repr_html_()
    assert page.count("<tr>") == 5
    assert "<td>excitation</td><td>sine_force</td><td>amplitude 0.02 N, frequency 50.6 Hz" in page
    assert "<td>shunts.1</td><td>resistor</td><td>resistance 1e+05 ohm</td>" in page


def test_a_design(designed):
    assert repr(designed).startswith("<DesignResult: best of 2: ")
    found = designed.to_frame()
    assert list(found["kind"]) == [candidate.shunt.kind for candidate in designed.candidates]
    axes = designed.plot()
    assert designed.bound.harvested_power in [line.get_ydata()[0] for line in axes.lines]


def test_markup_in_a_result_is_text(response):
    assert "<b>" not in dataclasses.replace(response, shunt="<b>")._repr_html_()


def test_without_pandas_it_is_said(response, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(ImportError, match=r"to_frame needs pandas, .*piezoharvest\[notebook\]"):
        response.to_frame()


def test_a_sign_that_is_the_nominal_one_is_told_in_the_table():
    """Responses of the structure behind several loads determine the square of the coupling alone."""
    f, rng = np.linspace(46.0, 55.0, 60), np.random.default_rng(1)

    def record(load):
        response = frequency_response(System(TRANSDUCER, Resistor(resistance=load)), f).velocity
        response = response * (1 + 1e-3 * (rng.normal(size=60) + 1j * rng.normal(size=60)))
        data = {"frequency_Hz": f, "response": response}
        return {"data": data, "kind": "frf", "output": "velocity", "load_resistance": load}

    found = identify(Campaign.from_arrays(TRANSDUCER, [record(load) for load in (1e3, 1e5, 1e7)]))
    notes = {row["parameter"]: row["note"] for row in found.rows}
    assert notes.pop("coupling") == "sign as nominal: the records determine only its square"
    assert set(notes.values()) == {""}
    assert "<th>note</th>" in found._repr_html_()
    known = dataclasses.replace(found, estimates=tuple(dataclasses.replace(e, note="") for e in found.estimates))
    assert "<th>note</th>" not in known._repr_html_()  # no empty column


class TestConfidence:
    """Against draws of the normal distribution that the covariance states."""

    SPECIMEN = Specimen(
        values={"stiffness": 1e3, "coupling": 1e-3, "mass": 0.01}, scaling=("log", "log", "log"),
        covariance=np.array([[4.0, 1.5e-6, 0.0], [1.5e-6, 1e-12, 0.0], [0.0, 0.0, 1.0]]), transducer=TRANSDUCER,
        lacking={"mass": "a record up to the resonance"},
    )  # fmt: skip

    def test_correlations_leave_out_what_is_not_determined(self):
        names, found = correlations(self.SPECIMEN)
        assert names == ("stiffness", "coupling")
        assert found == pytest.approx(np.array([[1.0, 0.75], [0.75, 1.0]]))

    def test_the_region_holds_95_of_100_draws(self):
        x, y = confidence_region(self.SPECIMEN, "stiffness", "coupling")
        draws = np.random.default_rng(1).multivariate_normal([1e3, 1e-3], self.SPECIMEN.covariance[:2, :2], 20_000)
        edge = matplotlib.path.Path(np.column_stack([(x - 1e3) / 2.0, (y - 1e-3) / 1e-6]))
        inside = edge.contains_points((draws - [1e3, 1e-3]) / [2.0, 1e-6])
        assert np.mean(inside) == pytest.approx(0.95, abs=0.006)

    def test_what_is_not_determined_has_none(self):
        with pytest.raises(ValueError, match="found 'mass', the records determine stiffness, coupling"):
            confidence_region(self.SPECIMEN, "stiffness", "mass")
        with pytest.raises(ValueError, match="'stiffness' twice"):
            confidence_region(self.SPECIMEN, "stiffness", "stiffness")
