"""Laws that are in no file of the package, in data of another integrator: place, form, curve within its band, gain."""

import json

import numpy as np
import pytest
from nameless import Drive, Laws, nameless_campaign
from remembering import searched

from piezoharvest.cli.on_campaigns.diagnose_command import diagnosis_json
from piezoharvest.description.effects import Leakage
from piezoharvest.description.effects.nameless.forms import TwoKnees
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.discovery.forms.formulas import candidates
from piezoharvest.diagnose.discovery.result import discovery
from piezoharvest.diagnose.summary import sentence
from piezoharvest.report import write_diagnosis
from piezoharvest.specimen import load_specimen

STACK = [
    (Drive((450.0,), (4.0,), 550.0), 97780.0),
    (Drive((300.0, 150.0), (3.0, 7.3), 500.0), 51430.0),
    (Drive((350.0,), (5.0,), 450.0), 97780.0),
]
BEAM = [
    (Drive((0.02, 0.01), (48.0, 53.0)), 1e5),
    (Drive((0.03,), (50.6,)), 4e4),
    (Drive((0.02, 0.008), (50.0, 46.0)), 1e5),
]


def conducts(v, knee=2.19, slope=5e-5):
    """A load that conducts beyond a voltage."""
    return slope * np.sign(v) * np.maximum(np.abs(v) - knee, 0.0)


LAWS = {
    "load": ("stack", Laws(load=conducts), "voltage", conducts, "knee"),
    "damper": (
        "beam",
        Laws(damper=lambda u: 0.02 * np.sign(u) * np.abs(u) ** 1.7),
        "velocity",
        lambda u: 0.02 * np.sign(u) * np.abs(u) ** 1.7,
        "power",
    ),
    "spring": (
        "beam",
        Laws(spring=lambda x: 3e-3 * (np.exp(x / 8e-4) - 1.0 - x / 8e-4)),
        "displacement",
        lambda x: 3e-3 * (np.exp(x / 8e-4) - 1.0 - x / 8e-4),
        "exponential",
    ),
    "reading.displacement": (
        "stack",
        Laws(reading={"displacement": lambda true: 5e4 * true["displacement"] ** 2}),
        "displacement",
        lambda x: 5e4 * x**2,
        "polynomial",
    ),
}
SAMPLING = {"stack": {"rate": 500.0, "duration": 1.5}, "beam": {"rate": 2000.0, "duration": 0.6}}


def measured(folder, kind, laws, records=None):
    return nameless_campaign(folder, kind, laws, records or (STACK if kind == "stack" else BEAM), **SAMPLING[kind])


@pytest.fixture(scope="module")
def knee(tmp_path_factory):
    """The first law, by the search alone."""
    campaign = measured(tmp_path_factory.mktemp("knee"), "stack", LAWS["load"][1])
    return searched(campaign)


def within_its_band(found, true):
    """Share of the visited range in which a curve is within three of its standard errors."""
    rounding = 1e-4 * np.abs(true(found.input)).max()  # of the prediction between samples, where the band is narrow
    return np.mean(np.abs(found.value - true(found.input)) < 3.0 * found.std + rounding)


def test_a_load_that_conducts_beyond_a_voltage_is_found_in_the_load(knee):
    found = discovery(knee.best, 1.0, 0.0, ())
    assert (found.place, found.law.place.input, found.form) == ("load", "voltage", "knee")
    value, std, unit = found.parameters["knee"]
    assert value == pytest.approx(2.19, abs=max(4.0 * std, 1e-3))
    assert unit == "V"
    value, std, unit = found.parameters["slope"]
    assert value == pytest.approx(5e-5, abs=max(4.0 * std, 1e-8))
    assert unit == "A/V"
    assert found.formula.endswith("hinge(v - 2.19 V), odd")
    assert within_its_band(found, conducts) > 0.95


def test_other_places_are_ruled_out_and_named(knee):
    assert not knee.close
    rivals = [(rival.place.name, knee.log_odds(rival)) for rival in knee.rivals]
    rivals += [(law.place.name, odds) for law, odds in knee.ruled_out]
    assert len(rivals) > 3
    assert all(odds < -100.0 for _, odds in rivals)
    assert "load" not in dict(rivals)


def test_the_formulas_of_a_table_are_ranked_by_what_they_leave_of_it(knee):
    some = [each for each in candidates(knee.table) if not isinstance(each.form, TwoKnees)]  # of which one is a case
    assert some[0].form.label == "knee"
    assert some[0].form.knee == pytest.approx(2.19, abs=0.05)  # a table of nine corners
    assert some[0].criterion < some[1].criterion


@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_a_diagnosis_finds_place_and_law(name, tmp_path):
    kind, laws, of, true, form = LAWS[name]
    found = diagnose(measured(tmp_path, kind, laws))
    assert found.verdict == "new_effect", sentence(found)
    (law,) = found.discovery
    assert (law.place, law.law.place.input, law.form) == (name, of, form)
    assert within_its_band(law, true) > 0.95
    assert law.gain > 0.95
    assert law.p_value < 1e-9
    assert not found.effects
    table = json.loads(json.dumps(diagnosis_json(found), allow_nan=False))
    assert table["discovery"][0]["place"] == name
    assert len(table["discovery"][0]["curve"]["std"]) == len(law.input)
    assert sentence(found).startswith("No known effect explains what was missing")
    found.save(tmp_path / "specimen.toml")
    specimen = load_specimen(tmp_path / "specimen.toml")
    assert specimen.transducer is not None
    assert law.law in (*specimen.transducer.effects, *specimen.measurement)
    if law.law.of_specimen:
        assert any(key.startswith(f"effects.{law.law.name}.form.") and std > 0 for key, std in specimen.errors.items())
    if name == "spring":
        page = write_diagnosis(found, tmp_path / "page").read_text()
        assert "A law without a name: spring" in page
        assert "exp(x / " in page
        assert (tmp_path / "page" / "law_1.png").stat().st_size > 1000
    for estimate in found.estimates:
        if estimate.identifiable and estimate.std:
            true_value = {"stiffness": {"stack": 3.125e8, "beam": 986.96}, "coupling": {"stack": 7.822, "beam": 1e-3}}
            wanted = true_value.get(estimate.parameter.name, {}).get(kind)
            assert wanted is None or estimate.value == pytest.approx(wanted, abs=5.0 * estimate.std)


@pytest.mark.slow
def test_healthy_records_need_no_law(tmp_path):
    found = diagnose(measured(tmp_path, "beam", Laws()))
    assert (found.verdict, found.discovery) == ("adequate", ())


@pytest.mark.slow
def test_what_no_law_of_one_input_explains_stays_unexplained(tmp_path):
    # A current that comes and goes by itself, thirty times in each record.
    campaign = measured(tmp_path, "stack", Laws())
    rng = np.random.default_rng(3)
    for record in campaign.records:
        bursts = np.repeat(rng.standard_normal(30), -(-len(record["voltage"]) // 30))[: len(record["voltage"])]
        record["voltage"][:] += 0.02 * bursts
    found = diagnose(campaign)
    assert (found.verdict, found.discovery) == ("unexplained", ())


def test_only_a_whole_library_is_followed_by_a_search_for_laws(tmp_path):
    told = []
    campaign = measured(tmp_path, "stack", LAWS["reading.displacement"][1])
    found = diagnose(campaign, told.append, library=[Leakage])
    assert (found.verdict, found.discovery) == ("unexplained", ())
    assert not any("law" in text for text in told)


@pytest.mark.slow
def test_two_laws_are_found_one_after_the_other(tmp_path):
    def bent(true):
        return 5e4 * true["displacement"] ** 2

    both = Laws(load=lambda v: conducts(v, slope=2e-6), reading={"displacement": bent})
    found = diagnose(measured(tmp_path, "stack", both))
    assert found.verdict == "new_effect", sentence(found)
    load, reading = found.discovery
    assert (load.place, load.form) == ("load", "knee")
    assert load.parameters["knee"][0] == pytest.approx(2.19, abs=5.0 * (load.parameters["knee"][1] or 0.0))
    assert (reading.place, reading.law.place.input) == ("reading.displacement", "displacement")
    assert within_its_band(reading, lambda x: 5e4 * x**2) > 0.95
    assert load.gain + reading.gain > 0.95
