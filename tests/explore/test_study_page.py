"""The page of a study: what it computes, what it writes, whom it serves, and how it looks in a browser."""

import http.client
import tomllib

import numpy as np
import pytest

from piezoharvest import ParameterError, StudyError, load_study, simulate
from piezoharvest.linear import TwoPort

pytest.importorskip("bokeh", reason="bokeh is not installed (the extra explore)")

from piezoharvest.explore.study import StudyExplorer
from piezoharvest.explore.study_page import StudyPage

STUDY = """
title = "bench"
[transducer]
mass = 0.010
damping = 0.0628
stiffness = 986.96
coupling = 1.0e-3
capacitance = 40e-9
[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 50.6
[[shunts]]
kind = "series_rl"
inductance = 240.0
resistance = 5e3
[[shunts]]
kind = "parallel_sshi"
inductance = 0.1
quality = 5.0
smoothing_capacitance = "1 uF"
load_resistance = 1e6
"""


@pytest.fixture
def explorer(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY)
    return StudyExplorer(load_study(tmp_path / "study.toml"))


class TestStudy:
    def test_every_value_that_matters_has_a_slider(self, explorer):
        paths = {knob.path for knob in explorer.knobs(1)}
        assert paths >= {"shunt.load_resistance", "shunt.inductance", "shunt.phase_lag", "excitation.frequency",
                         "transducer.coupling"}  # fmt: skip
        for knob in explorer.knobs(1):
            assert knob.low <= knob.value <= knob.high
            assert knob.from_slider(knob.to_slider(knob.high)) == pytest.approx(knob.high)

    @pytest.mark.parametrize(("kind", "unit"), [("sine_force", "N"), ("sine_base", "m/s^2")])
    def test_the_amplitude_has_the_unit_of_its_excitation(self, tmp_path, kind, unit):
        (tmp_path / "study.toml").write_text(STUDY.replace("sine_force", kind))
        knobs = {knob.path: knob for knob in StudyExplorer(load_study(tmp_path / "study.toml")).knobs(1)}
        assert knobs["excitation.amplitude"].unit == unit

    def test_answer_is_that_of_the_simulator_and_below_the_bound(self, explorer):
        values = {"shunt.resistance": 8e3, "excitation.frequency": 51.0, "transducer.coupling": 1.2e-3}
        found = explorer.answer(0, values)
        (system,) = found.study.systems
        assert (system.shunt.resistance, system.transducer.coupling) == (8e3, 1.2e-3)
        assert found.response.harvested_power == simulate(system, found.study.excitation).harvested_power
        # Of a source behind an impedance: |v|^2/(8 Re Z), with v and Z of the open and free transducer.
        port = TwoPort.of(system.transducer, [51.0])
        voltage = 0.02 * port.z[0, 1, 0] / port.z[0, 0, 0]
        bound = abs(voltage) ** 2 / (8 * port.impedance()[0].real)
        assert found.bound.harvested_power == pytest.approx(bound, rel=1e-9)
        assert found.response.harvested_power < bound

    def test_positions_are_values_as_they_are_shown(self, explorer):
        """A saved study has 15.85 mH where the page shows it, and no value leaves its range."""
        for knob in explorer.knobs(1):
            for position in np.linspace(knob.to_slider(knob.low), knob.to_slider(knob.high), 7):
                value = knob.from_slider(position)
                assert knob.low <= value <= knob.high
                assert value in (float(f"{value:.4g}"), knob.low, knob.high)

    def test_what_is_not_allowed_is_said(self, explorer):
        with pytest.raises(ParameterError, match=r"shunt.*inductance"):
            explorer.answer(0, {"shunt.inductance": -1.0})

    def test_saved_study_has_the_values_and_nothing_else_new(self, explorer, tmp_path):
        values = {"shunt.load_resistance": 2e6, "excitation.frequency": 51.0, "transducer.coupling": 1.2e-3}
        explorer.save(1, values, tmp_path / "saved.toml")
        saved, old = (tomllib.loads((tmp_path / name).read_text()) for name in ("saved.toml", "study.toml"))
        old["shunts"][1]["load_resistance"] = 2e6
        old["excitation"]["frequency"], old["transducer"]["coupling"] = 51.0, 1.2e-3
        assert saved == old

    def test_figures_of_a_catalogue_become_a_table(self, tmp_path):
        head, tail = STUDY.split("[transducer]")[0], STUDY[STUDY.index("[excitation]") :]
        (tmp_path / "study.toml").write_text(f'{head}[transducer]\ncatalogue = "NAC2125-H10"\n{tail}')
        explorer = StudyExplorer(load_study(tmp_path / "study.toml"))
        explorer.save(0, {"transducer.coupling": 9.0}, tmp_path / "saved.toml")
        found = load_study(tmp_path / "saved.toml").transducer
        assert (found.coupling, found.stiffness) == (9.0, explorer.study.transducer.stiffness)

    def test_without_circuits_there_is_nothing_to_explore(self, tmp_path):
        text = STUDY.split("[[shunts]]")[0] + '[design]\nobjective = "harvest"\n'
        (tmp_path / "study.toml").write_text(text)
        with pytest.raises(StudyError, match="at least one is needed to explore"):
            StudyExplorer(load_study(tmp_path / "study.toml"))


class TestServer:
    @pytest.mark.parametrize(
        ("headers", "status"),
        [
            ({}, 200),
            ({"Host": "elsewhere.example"}, 404),
            ({"Origin": "http://elsewhere.example"}, 404),
            ({"Sec-Fetch-Site": "cross-site"}, 404),
            ({"Content-Length": str(2 << 20)}, 400),
        ],
    )
    def test_only_its_own_page_is_served(self, served, headers, status):
        server = served(lambda document: None)
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
        connection.request("GET", "/", headers=headers)
        assert connection.getresponse().status == status

    def test_messages_of_other_pages_are_refused(self, served):
        server = served(lambda document: None)
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
        upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
                   "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Origin": "http://elsewhere.example"}  # fmt: skip
        connection.request("GET", "/ws", headers=upgrade)
        assert connection.getresponse().status == 404


MOVE = """(async () => {
  const document_ = Bokeh.documents[0], models = [...document_._all_models.values()];
  const table = models.find(model => model.type == "Div" && model.text.includes("harvested power"));
  const before = table.text;
  document_.get_model_by_name("shunt.resistance").value = 4.2;
  for (let n = 0; n < 400 && table.text == before; n++) await new Promise(done => setTimeout(done, 25));
  return [table.text != before, performance.getEntriesByType("resource").map(entry => entry.name)];
})()"""
AXES = """[...Bokeh.documents[0]._all_models.values()].filter(model => model.type == "LinearAxis")
  .map(axis => [axis.axis_label, axis.formatter.doFormat([-0.0031], {loc: 0})[0]])"""
READY = "window.Bokeh && Bokeh.documents.length > 0 && Bokeh.documents[0].is_idle"


@pytest.mark.browser
def test_sliders_move_what_is_shown(explorer, served, opened, tmp_path):
    server = served(lambda document: StudyPage(explorer, document, tmp_path / "saved.toml"))
    with opened(server.address) as page:
        page.wait_for(READY)
        changed, fetched = page.run(MOVE)
        assert changed
        assert all(name.startswith(server.address) for name in fetched)
        axes = page.run(AXES)
        assert ["displacement", "-3.1 mm"] in axes and ["time", "-3.1 ms"] in axes and ["voltage", "-3.1 mV"] in axes
        for width in (390, 1280):
            page.resize(width, 900)
            assert page.run("document.documentElement.scrollWidth") <= width
            assert len(np.unique(page.picture())) > 50  # of 256: curves and text on a plain ground
