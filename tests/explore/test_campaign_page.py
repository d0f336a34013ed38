"""The page of a campaign, against records that scipy makes, and the command."""

import http.client
import sys

import numpy as np
import pytest
import scipy.signal

from piezoharvest import Campaign, Transducer, identify
from piezoharvest.cli import main
from piezoharvest.description.effects import Leakage

pytest.importorskip("bokeh", reason="bokeh is not installed (the extra explore)")

from piezoharvest.explore.campaign import CampaignExplorer, telling, with_values
from piezoharvest.explore.campaign_page import CampaignPage

NOMINAL = Transducer(mass=0.010, damping=0.2, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
LOAD, LEAK = 1e5, 3e5
FINER = 20  # instants to a sample, between which scipy takes the force as linear: an error of 2e-5
INSTANTS = np.arange(400 * FINER) / (1000.0 * FINER)
TIME, DRIVE = INSTANTS[::FINER], np.sin(2 * np.pi * np.outer([31.0, 55.0], INSTANTS))
FORCE = 0.02 * DRIVE[0] + 0.01 * DRIVE[1]


def responses(t, resistance):
    """Displacement and voltage with a resistance across the electrodes, from rest."""
    a = [[0, 1, 0], [-t.stiffness / t.mass, -t.damping / t.mass, t.coupling / t.mass],
         [0, -t.coupling / t.capacitance, -1 / (resistance * t.capacitance)]]  # fmt: skip
    system = scipy.signal.StateSpace(a, [[0], [1 / t.mass], [0]], [[1, 0, 0], [0, 0, 1]], np.zeros((2, 1)))
    return scipy.signal.lsim(system, FORCE, INSTANTS)[1][::FINER].T


@pytest.fixture(scope="module")
def explorer():
    both = 1 / (1 / LOAD + 1 / LEAK)
    displacement, voltage = (x + 1e-4 * np.ptp(x) * np.random.default_rng(1).normal(size=400)
                             for x in responses(NOMINAL, both))  # fmt: skip
    data = {"time_s": TIME, "force_N": FORCE[::FINER], "displacement_m": displacement, "voltage_V": voltage}
    return CampaignExplorer(identify(Campaign.from_arrays(NOMINAL, [{"data": data, "load_resistance": LOAD}])))


def test_an_effect_that_is_on_changes_the_prediction_as_it_does(explorer):
    fitted = explorer.found.transducer
    wanted = responses(fitted, 1 / (1 / LOAD + 1 / LEAK)) - responses(fitted, LOAD)
    on = with_values(explorer.effects["leakage"], "leakage", {"leakage.resistance": LEAK, "creep.time_constant": 1.0})
    assert on == Leakage(resistance=LEAK)
    found = explorer.seen(0, [on])
    for channel, values in zip(("displacement", "voltage"), wanted, strict=True):
        change = found.predicted[channel] - explorer.seen(0).predicted[channel]
        # Initial states were fitted to the noise, 1e-4 of the range, and decay differently.
        np.testing.assert_allclose(change, values, atol=1e-3 * np.max(np.abs(values)))
        left = found.measured[channel] - found.predicted[channel]
        np.testing.assert_allclose(left, found.residual[channel], atol=1e-12 * np.ptp(found.measured[channel]))
        assert found.rms[channel] == pytest.approx(np.sqrt(np.mean(found.residual[channel] ** 2)))


def test_a_frequency_response_follows_too():
    """Against 1/(k - m w^2 + jwb + jw T^2/(jwC + 1/R)); the start values of some effects need a record over time."""
    frequency = np.linspace(40.0, 60.0, 60)

    def receptance(t, resistance):
        s = 2j * np.pi * frequency
        shunted = s * t.coupling**2 / (s * t.capacitance + 1 / resistance)
        return 1 / (t.mass * s**2 + t.damping * s + t.stiffness + shunted)

    data = {"frequency_Hz": frequency, "response": receptance(NOMINAL, LOAD)}
    record = {"kind": "frf", "output": "displacement", "load_resistance": LOAD, "data": data}
    found = CampaignExplorer(identify(Campaign.from_arrays(NOMINAL, [record])))
    (shown,) = found.seen(0, [Leakage(resistance=LEAK)]).predicted.values()
    wanted = receptance(found.found.transducer, 1 / (1 / LOAD + 1 / LEAK))
    np.testing.assert_allclose(shown, 20 * np.log10(np.abs(wanted)), atol=1e-6)
    assert found.knobs("leakage", 0)


def test_a_strength_begins_where_it_is_just_seen(explorer):
    (knob,) = explorer.knobs("leakage", 0)
    assert knob.logarithmic and knob.low < LEAK < knob.high
    change = [np.max(np.abs(explorer.seen(0, [Leakage(resistance=r)]).predicted["voltage"]
                            - explorer.seen(0).predicted["voltage"])) for r in (knob.low, knob.high)]  # fmt: skip
    assert change[1] < 2e-3 * np.ptp(explorer.seen(0).measured["voltage"]) < change[0]


def test_extrema_are_drawn(explorer):
    shown = explorer.seen(0)
    at = telling(shown, "voltage", 20)
    assert len(at) <= 80
    for values in (shown.measured["voltage"], shown.residual["voltage"]):
        assert {int(np.argmax(values)), int(np.argmin(values))} <= set(at.tolist())


def test_page_is_drawn(explorer, served):
    server = served(lambda document: CampaignPage(explorer, document))
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("GET", "/")
    answer = connection.getresponse()
    assert answer.status == 200 and b"piezoharvest: campaign" in answer.read()


class TestCommand:
    def test_without_bokeh_one_sentence_says_what_to_install(self, tmp_path, monkeypatch, capsys):
        monkeypatch.setitem(sys.modules, "piezoharvest.explore.server", None)
        assert main(["explore", str(tmp_path / "study.toml")]) == 2
        assert "pip install 'piezoharvest[explore]'" in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("text", "words"), [(None, "No such file"), ("records = []", "transducer"), ("[transducer]\n", "excitation")]
    )
    def test_bad_input_is_one_sentence(self, tmp_path, capsys, text, words):
        if text is not None:
            (tmp_path / "study.toml").write_text(text)
        assert main(["explore", str(tmp_path / "study.toml")]) == 2
        found = capsys.readouterr()
        assert words in found.err and found.err.count("\n") == 1 and not found.out
