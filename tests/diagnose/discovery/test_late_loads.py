"""A load whose current follows its voltage late: by a first-order lag, or by a delay."""

from functools import partial

import numpy as np
import pytest
from diagnose.late import LOAD, RATE, campaign, delayed, lagging
from diagnose.swept import TRUE

from piezoharvest import Resistor, SeriesRL, SineForce, System, Transducer, simulate
from piezoharvest.description.effects.nameless.forms import Line
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import LateBy, Relaxation
from piezoharvest.description.effects.nameless.places import LEAST_LEFT, LoadCurrent
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.discovery.result import as_json, discovery
from piezoharvest.diagnose.discovery.search import search
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.prediction import Prediction

LAG, DELAY = 3e-4, 6e-4  # s, at up to 160 Hz
CHANNELS = ["displacement", "voltage", "current"]
SINE = SineForce(amplitude=0.3, frequency=95.0)


def late(memory, factor=1.0):
    return Law(place=LoadCurrent(), form=Line(factor=factor), memory=memory)


@pytest.mark.parametrize(
    ("law", "make"),
    [
        (late(Relaxation(time_constant=LAG, behind=True)), partial(lagging, time_constant=LAG)),
        (late(Relaxation(time_constant=LAG, behind=True), 0.4), partial(lagging, time_constant=LAG, share=0.4)),
        (late(LateBy(delay=DELAY)), partial(delayed, delay=DELAY)),
    ],
    ids=["lag", "share", "delay"],
)
def test_a_record_of_a_late_load_is_predicted(law, make):
    _, true = make(0.3, (40.0, 160.0), duration=0.5)
    setting = setting_of("force", Resistor(resistance=LOAD), 1.0 / RATE, true["force_N"])
    wanted = np.column_stack([true["displacement_m"], true["voltage_V"], true["current_A"]])
    errors = []
    for effects in ((law,), ()):
        (block,) = Prediction(Transducer(**TRUE, effects=effects), setting).blocks(False, channels=CHANNELS)
        errors.append(np.abs(block.values - wanted).max(axis=0))
    # w d is 0.6 at most, where the approximation's phase is off by a ten-thousandth.
    assert np.all(errors[0] < 1e-3 * errors[1]), errors


def test_a_lagging_load_is_a_coil_in_series():
    law = late(Relaxation(time_constant=LAG, behind=True))
    found = simulate(System(Transducer(**TRUE, effects=(law,)), Resistor(resistance=LOAD)), SINE)
    wanted = simulate(System(Transducer(**TRUE), SeriesRL(inductance=LAG * LOAD, resistance=LOAD)), SINE)
    for name in ("displacement_amplitude", "voltage_amplitude", "mechanical_power"):
        assert getattr(found, name) == pytest.approx(getattr(wanted, name), rel=10.0 * LEAST_LEFT), name
    assert abs(found.energy["closure"]) < 1e-10


@pytest.mark.parametrize("transient", [None, 5 / 95.0])
def test_energy_closes_with_a_delay(transient):
    law = late(LateBy(delay=DELAY))
    found = simulate(System(Transducer(**TRUE, effects=(law,)), Resistor(resistance=LOAD)), SINE, transient=transient)
    assert abs(found.energy["closure"]) < 1e-10


def test_the_amplitude_of_what_is_late_is_that_of_what_is_not():
    """Mean power into the load: half the product of both amplitudes and the cosine of w d."""
    law = late(LateBy(delay=DELAY))
    found = simulate(System(Transducer(**TRUE, effects=(law,)), Resistor(resistance=LOAD)), SINE)
    angle = 2 * np.pi * SINE.frequency * DELAY
    mean = 0.5 * found.voltage_amplitude**2 / LOAD * np.cos(angle)
    lost = 0.5 * TRUE["damping"] * (2 * np.pi * SINE.frequency * found.displacement_amplitude) ** 2
    assert found.mechanical_power == pytest.approx(mean + lost, rel=1e-4)


@pytest.mark.parametrize(
    ("make", "kind", "name", "value"),
    [
        (partial(lagging, time_constant=LAG, duration=0.5), "lag", "time_constant", LAG),
        pytest.param(partial(delayed, delay=DELAY, duration=0.5), "delay", "delay", DELAY, marks=pytest.mark.slow),
    ],
    ids=["lag", "delay"],
)
def test_how_late_a_load_is_is_found(make, kind, name, value):
    before = identify(campaign(1, make), offsets=("displacement",))
    problem = Problem(prepared(before.campaign, "fit"), before.campaign.transducer, before.offsets)
    best = search(problem, before.found, lambda text: None, lambda problem, visited: [LoadCurrent()]).best
    found = as_json(discovery(best, 1.0, 0.0, ()))
    assert (found["place"], found["input"], found["memory"]["kind"]) == ("load", "current", kind)
    assert found["memory"][name] == pytest.approx(value, rel=0.02)
    assert found["parameters"]["slope"]["value"] == pytest.approx(1.0, abs=0.02)
    assert found["parameters"]["slope"]["unit"] == ""


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("make", "kind"),
    [(partial(lagging, time_constant=LAG), "lag"), (partial(delayed, delay=DELAY), "delay")],
    ids=["lag", "delay"],
)
def test_a_load_that_conducts_late_is_told(make, kind, seed):
    found = diagnose(campaign(seed, make))
    assert found.verdict == "new_effect", (found.verdict, found.effects)
    (law,) = found.discovery
    assert (law.place, law.law.memory.kind) == ("load", kind)
    assert law.law.form.factor == pytest.approx(1.0, abs=0.02)
    assert law.gain > 0.95
