"""Parameters that change from record to record: with the time of the campaign, or with the amplitude of the motion."""

from dataclasses import replace

import numpy as np
import pytest
from nameless import BEAM, Drive, Laws, nameless_campaign

from piezoharvest import Resistor, SineForce, System, Transducer, diagnose, simulate
from piezoharvest.description.effects.nameless.forms import Line
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import PARAMETERS_OVER_TIME, OverTime
from piezoharvest.diagnose.discovery.places import places_of
from piezoharvest.diagnose.discovery.tables.visited import visited_inputs
from piezoharvest.identify.fitting.data import data_of
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.prediction import Prediction
from piezoharvest.records import load_campaign

RATE, LOAD, COUNT = 16000.0, 1e5, 6400
DRIVE = Drive((0.02, 0.01), (48.0, 53.0))
LENGTH = (COUNT - 1) / RATE


def predicted(device, **sizes):
    setting = setting_of("force", Resistor(resistance=LOAD), 1.0 / RATE, DRIVE(np.arange(COUNT) / RATE))
    setting = replace(setting, size=setting.size._replace(**sizes))
    (block,) = Prediction(device, setting).blocks(False, channels=["displacement", "voltage"])
    return block.values


def changed(parameter, factor, *effects):
    return Transducer(**{**BEAM, parameter: BEAM[parameter] * (1.0 + factor)}, effects=effects)


@pytest.mark.parametrize("parameter", PARAMETERS_OVER_TIME)
def test_over_the_time_of_a_campaign_a_record_begins_with_what_has_changed_before_it(parameter):
    per_second, begin = 0.05, 3.0
    law = Law(place=OverTime(parameter, "campaign_time"), form=Line(factor=per_second))
    found = predicted(Transducer(**BEAM, effects=(law,)), begin=begin)
    before = per_second * begin
    rest = Law(place=OverTime(parameter), form=Line(factor=per_second / (1.0 + before)))
    wanted, without = predicted(changed(parameter, before, rest)), predicted(Transducer(**BEAM))
    # A change over time acts as a straight line between samples, the other way for less of it: of second order.
    assert np.all(np.abs(found - wanted).max(axis=0) < 1e-4 * np.abs(without - wanted).max(axis=0))


@pytest.mark.parametrize("parameter", PARAMETERS_OVER_TIME)
def test_with_the_amplitude_of_the_motion_a_parameter_is_one_number_in_a_record(parameter):
    law = Law(place=OverTime(parameter, "displacement_amplitude"), form=Line(factor=200.0))
    found = predicted(Transducer(**BEAM, effects=(law,)), displacement_amplitude=4e-4)
    wanted = predicted(changed(parameter, 0.08))
    assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("of", ["campaign_time", "displacement_amplitude"])
def test_what_no_record_knows_changes_nothing_and_a_simulation_says_so(of):
    law = Law(place=OverTime("stiffness", of), form=Line(factor=0.1))
    device, bare = Transducer(**BEAM, effects=(law,)), Transducer(**BEAM)
    assert np.array_equal(predicted(device), predicted(bare))
    drive = SineForce(amplitude=0.02, frequency=50.0)
    found, wanted = (simulate(System(each, Resistor(resistance=LOAD)), drive) for each in (device, bare))
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-12)
    assert "parameter.stiffness linear: not part of a simulation" in found.message


def test_the_sizes_of_a_record_are_those_of_its_channels(tmp_path):
    campaign = nameless_campaign(tmp_path, "beam", Laws(), [(Drive((0.02,), (48.0,)), LOAD)] * 2, duration=1.0)
    record = campaign.records[0]
    size = data_of(record, campaign.transducer).setting.size
    assert (size.begin, size.length) == (0.0, pytest.approx(0.999))
    assert size.displacement_amplitude == pytest.approx(np.sqrt(2.0) * np.std(record["displacement"]), rel=1e-12)


@pytest.mark.parametrize(("second", "offered"), [(0.0, False), (60.0, True)])
def test_the_time_of_the_campaign_is_a_place_only_where_records_begin_at_different_times(second, offered, tmp_path):
    nameless_campaign(tmp_path, "beam", Laws(), [(Drive((0.02,), (48.0,)), LOAD)] * 3, duration=0.3)
    text = (tmp_path / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(text.replace('file = "r1.csv"', f'file = "r1.csv"\nstart_time = {second}'))
    campaign = load_campaign(tmp_path / "campaign.toml")
    problem = Problem(prepared(campaign, "fit"), campaign.transducer, ("displacement",))
    found = identify(campaign, offsets=("displacement",)).found
    inputs = {place.input for place in places_of(problem, visited_inputs(problem, found))}
    assert "time" in inputs
    assert ("campaign_time" in inputs) is offered


def worn(t):
    """Relative growth of the damping over the time of the campaign, s."""
    return 0.4 * (1.0 - np.exp(-t / 700.0))


@pytest.mark.slow
def test_a_damping_that_grows_over_the_campaign_is_found(tmp_path):
    begins = (0.0, 400.0, 900.0, 2000.0, 1400.0)
    drives = [Drive((0.02, 0.01), (48.0 + 0.2 * n, 53.0)) for n in range(5)]
    at = dict(zip(drives, begins, strict=True))
    nameless_campaign(
        tmp_path, "beam", lambda drive: Laws(damper=lambda u: BEAM["damping"] * worn(at[drive]) * u),
        [(drive, LOAD) for drive in drives], rate=2000.0, duration=0.6,
    )  # fmt: skip
    text = (tmp_path / "campaign.toml").read_text()
    for n, begin in enumerate(begins):
        text = text.replace(f'file = "r{n}.csv"', f'file = "r{n}.csv"\nstart_time = {begin}')
    (tmp_path / "campaign.toml").write_text(text)
    found = diagnose(load_campaign(tmp_path / "campaign.toml"))
    assert found.verdict == "new_effect"
    (law,) = found.discovery
    assert (law.place, law.law.place.input) == ("parameter.damping", "campaign_time")
    assert law.gain > 0.95
    at_records = np.interp(begins, law.input, law.value)
    assert at_records - at_records[0] == pytest.approx(worn(np.array(begins)), abs=0.02)
