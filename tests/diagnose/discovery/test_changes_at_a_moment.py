"""What changes at once at a moment within one of several records: a glue joint that cracks, a sensor that slips."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnose.cracked import BEGINS, LOAD, RATE, TRUE, campaign, motion

from piezoharvest import Resistor, Transducer
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import GainOverTime, OverTime, Reading
from piezoharvest.description.effects.nameless.shapes import StepChange
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.discovery.forms.formulas import recorded
from piezoharvest.diagnose.discovery.forms.moments import better_moment
from piezoharvest.diagnose.discovery.law_fits import fitted
from piezoharvest.diagnose.discovery.places import every_place, places_of
from piezoharvest.diagnose.discovery.search import search
from piezoharvest.diagnose.discovery.tables.knots import table_for
from piezoharvest.diagnose.discovery.tables.visited import visited_inputs
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.prediction import Prediction

SHORT, MOMENT = 0.5, 20.2  # s: of records, and within the second one


def slipped(channel, gain=0.0, offset=0.0):
    """What a sensor shows whose gain or offset changes at the moment."""
    return lambda time, exact: {**exact, channel: exact[channel] + (time >= MOMENT) * (gain * exact[channel] + offset)}


@cache
def start_of(change=(), read=None):
    """Problem of a campaign's fitted records and its fit without a law."""
    options = {} if read is None else {"read": slipped(*read)}
    before = identify(campaign(1, MOMENT, dict(change), duration=SHORT, **options), offsets=("displacement",))
    return Problem(prepared(before.campaign, "fit"), before.campaign.transducer, before.offsets), before.found


def searched(place, change=(), read=None):
    """What is found at one place."""
    problem, start = start_of(change, read)
    assert place in every_place(problem, visited_inputs(problem, start))
    return search(problem, start, lambda text: None, lambda problem, visited: [place]).best


@pytest.mark.parametrize("parameter", ["stiffness", "damping", "coupling", "capacitance"])
def test_a_record_in_which_a_parameter_changes_is_predicted(parameter):
    at, share, begin = 0.2, 0.1, 20.0
    time, true = motion(0.3, (60.0, 130.0), SHORT, {parameter: share}, at)
    step = StepChange(factor=share, at=begin + at, width=1e-6)
    device = Transducer(**TRUE, effects=(Law(place=OverTime(parameter, "campaign_time"), form=step),))
    setting = setting_of("force", Resistor(resistance=LOAD), 1.0 / RATE, true["force_N"])
    setting = replace(setting, size=setting.size._replace(begin=begin, length=float(time[-1])), fine=8)
    errors, clear = [], np.abs(time - at) > 1.5 / RATE  # a voltage may jump
    for each in (device, replace(device, effects=())):
        (block,) = Prediction(each, setting).blocks(False, channels=["displacement", "voltage"])
        missed = block.values - np.column_stack([true["displacement_m"], true["voltage_V"]])
        errors.append(np.abs(missed[clear]).max(axis=0))
    assert np.all(errors[0] < 5e-3 * errors[1]), errors


def test_a_gain_that_changes_is_a_share_of_what_the_sensor_shows():
    time, true = motion(0.3, (60.0, 130.0), SHORT, {}, 0.0)
    setting = replace(setting_of("force", Resistor(resistance=LOAD), 1.0 / RATE, true["force_N"]), fine=8)
    law = Law(place=GainOverTime("displacement"), form=StepChange(factor=0.1, at=0.12, width=0.015))
    shown, plain = (
        next(Prediction(Transducer(**TRUE, effects=e), setting).blocks(False, channels=["displacement"])).values[:, 0]
        for e in ((law,), ())
    )
    assert shown == pytest.approx(plain * (1.0 + law.form.values(time)), rel=1e-9, abs=1e-15)
    assert not law.of_specimen


def test_a_table_over_the_campaign_has_its_corners_within_records():
    visited = np.concatenate([begin + np.arange(2000) / 4000.0 for begin in BEGINS])
    knots = np.array(table_for(OverTime("stiffness", "campaign_time"), visited).knots)
    within = [np.sum((knots >= begin) & (knots <= begin + 0.5)) for begin in BEGINS]
    assert sum(within) == len(knots)
    assert min(within) >= 3
    length, sample = recorded(visited)
    assert (length, sample) == (pytest.approx(2.0, rel=1e-3), pytest.approx(1.0 / 4000.0))


def test_sensors_are_places_over_the_campaign_where_records_begin_at_several_times():
    problem, start = start_of((("stiffness", -0.03),))
    visited = visited_inputs(problem, start)
    every, inside = every_place(problem, visited), places_of(problem, visited)
    added = {place for place in every if place not in inside and place.input == "campaign_time"}
    channels = ("force", "displacement", "voltage")
    assert added == {kind(name, "campaign_time") for name in channels for kind in (Reading, GainOverTime)}
    del visited["campaign_time"]
    assert not any(place.input == "campaign_time" for place in every_place(problem, visited))


@pytest.mark.slow
def test_the_moment_at_which_a_stiffness_changes_is_found():
    best = searched(OverTime("stiffness", "campaign_time"), (("stiffness", -0.03),))
    assert isinstance(best.form, StepChange)
    assert best.form.factor == pytest.approx(-0.03, rel=5e-3)
    assert best.form.at == pytest.approx(MOMENT, abs=4.0 / RATE)
    assert best.form.width < 6.0 / RATE


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "read", "factor"),
    [
        (GainOverTime("voltage", "campaign_time"), ("voltage_V", 0.03, 0.0), 0.03),
        (GainOverTime("force", "campaign_time"), ("force_N", 0.03, 0.0), 0.03 / 1.03),  # of what is shown
        (Reading("displacement", "campaign_time"), ("displacement_m", 0.0, 4e-5), 4e-5),
    ],
    ids=["voltage", "force", "offset"],
)  # fmt: skip
def test_the_moment_at_which_a_sensor_slips_is_found(place, read, factor):
    best = searched(place, read=read)
    assert isinstance(best.form, StepChange)
    assert best.form.factor == pytest.approx(factor, rel=0.03)
    assert best.form.at == pytest.approx(MOMENT, abs=4.0 / RATE)


@cache
def fitted_step():
    """Fit of a stiffness that changes at the moment, from one that changes later and slowly."""
    problem, start = start_of((("stiffness", -0.03),))
    form = StepChange(factor=-0.02, at=MOMENT + 0.05, width=0.05, finest=1.0 / RATE)
    law = Law(place=OverTime("stiffness", "campaign_time"), form=form)
    return problem, fitted(problem, start, law, visited_inputs(problem, start)["campaign_time"])


def test_a_fit_from_a_slow_change_nearby_finds_the_moment():
    form = fitted_step()[1].form
    assert form.factor == pytest.approx(-0.03, rel=5e-3)
    assert form.at == pytest.approx(MOMENT, abs=4.0 / RATE)
    assert 1.0 / RATE * (1.0 - 1e-9) <= form.width < 6.0 / RATE  # within a sample there is no slope to follow


@pytest.mark.parametrize("away", [-30.0 / RATE, 12.0 / RATE])
def test_a_moment_some_way_off_is_left_for_the_better_one(away):
    problem, right = fitted_step()
    model = right.found.model
    wrong = replace(right.law, form=replace(right.form, at=right.form.at + away))
    model = replace(model, transducer=replace(model.transducer, effects=(wrong,)))
    found = better_moment(problem, replace(right, found=replace(right.found, model=model)), 0.05)
    assert found.at == pytest.approx(right.form.at, abs=0.25 * abs(away))
    assert better_moment(problem, right, 0.05) is None


@pytest.mark.slow
@pytest.mark.parametrize(("change", "seed"), [({"stiffness": -0.02}, 1), ({"coupling": 0.05}, 2)])
def test_a_joint_that_cracks_in_one_of_several_records_is_told(change, seed):
    moment, ((name, share),) = 20.75, change.items()
    found = diagnose(campaign(seed, moment, change))
    assert found.verdict == "new_effect", (found.verdict, found.effects)
    (discovery,) = found.discovery
    law = discovery.law
    assert law.place == OverTime(name, "campaign_time")
    assert isinstance(law.form, StepChange)
    assert law.form.factor == pytest.approx(share, rel=0.03)
    assert law.form.at == pytest.approx(moment, abs=1e-3)
    assert discovery.gain > 0.95
