"""Laws without a name behind diodes and switches: place and curve against records that SciPy made with events."""

from dataclasses import replace

import numpy as np
import pytest
from nameless import BEAM, Laws
from rectified import BRIDGE, DRIVES, RATE, rectified, rectified_campaign

from piezoharvest import Transducer
from piezoharvest.description.effects.nameless.forms import Corners, Knee, Line, Monomial, Polynomial
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Play, Relaxation
from piezoharvest.description.effects.nameless.places import (
    Capacitor,
    Coupling,
    Damper,
    Electrodes,
    OverTime,
    Reading,
    Spring,
)
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import Rectifier
from piezoharvest.diagnose.discovery.law_fits import law_parameters
from piezoharvest.diagnose.discovery.result import discovery
from piezoharvest.diagnose.discovery.search import search
from piezoharvest.equations.terms import Terms
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.growing_fit import growing_fit
from piezoharvest.identify.identification import prepared
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.setting import circuit_setting
from piezoharvest.predict.parameters import parameters_of, put, value_at
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.threads import single_threaded

CHANNELS = ("displacement", "voltage", "current", "dc_voltage", "dc_current")
PLACES = [
    Spring(), Damper(), Electrodes(), Capacitor(), OverTime("stiffness"), Reading("displacement", "displacement"),
    Reading("voltage", "voltage"), Reading("displacement", "voltage"),
]  # fmt: skip


def beyond(x, knee, slope):
    """Nothing up to a knee on both sides, and a straight line beyond it."""
    return slope * np.sign(x) * np.maximum(np.abs(x) - knee, 0.0)


def prediction(*effects, parameters=(), count=200):
    device = Transducer(**BEAM, effects=effects)
    drive = DRIVES[0](np.arange(count) / RATE)
    setting = circuit_setting("force", Rectifier(**BRIDGE), 1.0 / RATE, drive, device)
    return CircuitPrediction(device, setting, parameters)


def values(of, channels=CHANNELS):
    (block,) = of.blocks(False, channels=channels)
    return dict(zip(channels, block.values.T, strict=True))


@pytest.mark.parametrize("channel", CHANNELS)
def test_a_sensor_reads_what_a_law_adds_to_its_own_value(channel):
    true = values(prediction())
    size = np.abs(true[channel]).max()
    law = Law(place=Reading(channel, channel), form=Monomial(factor=0.1 * size, scale=size))
    read = values(prediction(law))
    assert np.ptp(true[channel]) > 0.0
    wanted = true[channel] + 0.1 * size * (true[channel] / size) ** 2
    assert read[channel] == pytest.approx(wanted, rel=1e-12, abs=1e-12 * size)
    for other in set(CHANNELS) - {channel}:
        assert np.array_equal(read[other], true[other])


def test_a_sensor_reads_another_channel_and_time():
    true, time = values(prediction()), np.arange(200) / RATE
    half = 0.5 * time[-1]
    crossed = Law(place=Reading("displacement", "voltage"), form=Knee(factor=1e-6, knee=1.0))
    drifting = Law(place=Reading("voltage", "time"), form=Corners(knots=(0.0, half), kinks=(1.0, -3.0)))
    read = values(prediction(crossed, drifting))
    assert np.abs(true["voltage"]).max() > 2.0
    wanted = true["displacement"] + beyond(true["voltage"], 1.0, 1e-6)
    assert read["displacement"] == pytest.approx(wanted, abs=1e-15)
    assert read["voltage"] == pytest.approx(true["voltage"] + time - 3.0 * np.maximum(time - half, 0.0), abs=1e-12)


def test_a_state_of_a_sensor_is_refused_and_play_is_that_of_samples():
    lagging = Law(
        place=Reading("voltage", "voltage"), form=Line(factor=1.0), memory=Relaxation(time_constant=1e-3, behind=True)
    )
    with pytest.raises(PredictionError, match="the sensor of voltage"):
        values(prediction(lagging))
    true, half = values(prediction())["displacement"], 2e-5
    loose = Law(place=Reading("displacement", "displacement"), form=Line(factor=-1.0), memory=Play(threshold=half))
    read, at = values(prediction(loose))["displacement"], 0.0
    for x, found in zip(true, read, strict=True):
        at = min(max(at, x - half), x + half)
        assert found == pytest.approx(at, abs=1e-15)


LAWS = [
    Law(place=Spring(), form=Knee(factor=300.0, knee=1e-4)),
    Law(place=Electrodes(), form=Knee(factor=2e-6, knee=1.0)),
    Law(place=Coupling(), form=Polynomial(factor=1e-8, second=5e-9, scale=1e-3)),
    Law(place=Reading("voltage", "voltage"), form=Knee(factor=-0.1, knee=1.5)),
    Law(place=OverTime("stiffness"), form=Line(factor=0.02)),
    Law(place=OverTime("capacitance", "amplitude"), form=Line(factor=0.5, start=0.01)),
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_derivatives_are_those_of_differences(law):
    parameters = law_parameters(law, 0)
    whole = prediction(law, parameters=parameters)
    (block,) = whole.blocks(channels=["displacement", "voltage"])
    for k, parameter in enumerate(parameters):
        inner, step = parameter.inner(value_at(whole.transducer, parameter.path)), 1e-4
        step *= abs(inner) or 1.0

        def moved(by, parameter=parameter, inner=inner):
            device = put(whole.transducer, parameter.path, float(parameter.outer(inner + by)))
            (of,) = CircuitPrediction(device, whole.setting).blocks(False, channels=["displacement", "voltage"])
            return of.values

        difference = (moved(step) - moved(-step)) / (2.0 * step)
        size = np.abs(difference).max(axis=0)
        assert np.any(size > 0.0)
        assert np.all(np.abs(block.derivatives[..., k] - difference).max(axis=0) <= 2e-3 * size)


def test_a_knee_acts_on_the_specimen_as_in_another_integrator():
    law = Law(place=Electrodes(), form=Knee(factor=2e-6, knee=2.0))
    true = rectified(Laws(electrodes=lambda v: beyond(v, 2.0, 2e-6)), DRIVES[0])
    found = values(prediction(law, count=len(true["force"])))
    without = values(prediction(count=len(true["force"])))
    for channel in ("displacement", "voltage"):
        off = np.abs(found[channel] - true[channel]).max()
        assert off < 2e-3 * np.abs(without[channel] - true[channel]).max()  # the corner is rounded off


def test_time_goes_into_products_as_a_factor_alone():
    device = Transducer(**BEAM)
    terms = Terms(device, record=0.5)
    once, half = terms.product(terms.time, terms.x), terms.product(0.5 * terms.time + 2.0 * terms.one, terms.x)
    assert len({element.power for element in terms.elements}) == 2
    assert np.array_equal(half[terms.columns["smooth1"]], 0.5 * once[terms.columns["smooth1"]])
    with pytest.raises(ParameterError, match="time by itself"):
        Terms(put(device, ("effects",), (_bent_over_time(),)), record=0.5)


def _bent_over_time():
    return Law(place=OverTime("stiffness"), form=Corners(knots=(0.0, 0.5), kinks=(0.1, 0.1)))


def test_a_function_and_its_slope_share_their_corners():
    law = Law(place=Coupling(), form=Monomial(factor=1e-7, scale=1e-3, exponent=3))
    once = Terms(Transducer(**BEAM, effects=(law,)))
    twice = Terms(Transducer(**BEAM, effects=(law, replace(law, form=replace(law.form, factor=2e-7)))))
    assert len(twice.elements) == len(once.elements) + 1  # the product with the voltage is its own


@single_threaded
def found_in(campaign, places=PLACES):
    """What a search among some places finds from the nominal values."""
    problem = Problem(prepared(campaign, "fit"), campaign.transducer, ())
    model = Model(campaign.transducer, tuple(parameters_of(campaign.transducer, {"force"})), ())
    return search(
        problem, growing_fit(problem, model), lambda text: None,
        lambda problem, visited: [place for place in places if place.input in visited],
    )  # fmt: skip


HIDDEN = {
    "spring": (Laws(spring=lambda x: beyond(x, 7e-4, 60.0)), lambda x: beyond(x, 7e-4, 60.0)),
    "electrodes": (Laws(electrodes=lambda v: beyond(v, 8.0, 2e-6)), lambda v: beyond(v, 8.0, 2e-6)),
    "reading.displacement": (
        Laws(reading={"displacement": lambda true: 40.0 * true["displacement"] ** 2}), lambda x: 40.0 * x**2,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow) for name in HIDDEN])
def test_a_law_in_no_library_is_found_behind_a_rectifier(name, tmp_path):
    laws, true = HIDDEN[name]
    found = found_in(rectified_campaign(tmp_path, laws))
    law = discovery(found.best, 1.0, 0.0, ())
    assert law.place == name
    assert name not in {rival.place.name for rival in found.close}
    wanted = true(law.input)
    assert np.mean(np.abs(law.value - wanted) < 3.0 * law.std + 0.02 * np.abs(wanted).max()) > 0.95
