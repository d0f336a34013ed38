"""Functions of what a memory makes of an input: as SciPy integrates them, closing their energy, and found as such."""

import subprocess
import sys

import numpy as np
import pytest
from nameless import BEAM, Drive, campaign_of
from remembering import device_with, fitted_without_law, searched, spring_behind_play

from piezoharvest import Resistor, SineForce, System, Transducer, simulate
from piezoharvest.description.effects.nameless.forms import Corners, DeadZone, Knee, Line, Monomial
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import LaggingFunction, Play, Relaxation
from piezoharvest.description.effects.nameless.places import Capacitor, Coupling, Damper, Electrodes, Reading, Spring
from piezoharvest.description.effects.nameless.shapes import Shape
from piezoharvest.description.parameters import ParameterError
from piezoharvest.diagnose.discovery.effect_file import save_effect
from piezoharvest.diagnose.discovery.law_fits import best_of, fitted, without_effect
from piezoharvest.diagnose.discovery.memories.functions import functions_of_memories
from piezoharvest.diagnose.discovery.result import as_json, discovery
from piezoharvest.diagnose.discovery.search import search
from piezoharvest.diagnose.discovery.tables.knots import table_for
from piezoharvest.diagnose.discovery.tables.visited import visited_inputs
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.prediction import Prediction

LOAD, SAMPLES = 1e5, 8000.0
SPAN = 0.5  # s: of longer records a search takes in proportion
LAG, AHEAD = Relaxation(time_constant=3e-3), Relaxation(time_constant=3e-3, behind=True)
LATE = LaggingFunction(time_constant=3e-3)


def tanh(factor, scale):
    return Shape(factor=factor, scale=scale, curve="tanh", bent=False)


LAWS = [
    Law(place=Spring(), form=tanh(-0.004, 5e-5), memory=AHEAD),
    Law(place=Spring(), form=DeadZone(factor=-60.0, zone=1e-4), memory=AHEAD),
    Law(place=Spring(), form=Line(factor=-60.0), memory=AHEAD),
    Law(place=Spring(), form=Monomial(factor=0.002, scale=3e-5, exponent=3), memory=Play(threshold=3e-5)),
    Law(place=Damper(), form=tanh(0.002, 0.01), memory=LAG),
    Law(place=Capacitor(), form=tanh(1e-8, 1.0), memory=LAG),
    Law(place=Electrodes(), form=Knee(factor=1e-5, knee=1.0), memory=LAG),
    Law(place=Spring(), form=tanh(-0.004, 5e-5), memory=LATE),
    Law(place=Capacitor(), form=tanh(1e-8, 1.0), memory=LATE),
    Law(place=Capacitor(), form=DeadZone(factor=1e-8, zone=1.0), memory=LATE),
    Law(place=Damper(), form=Line(factor=0.02), memory=LATE),
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_the_energy_of_a_function_of_a_memory_closes_and_it_takes_some(law):
    system = System(Transducer(**BEAM, effects=(law,)), Resistor(resistance=LOAD))
    run = simulate(system, SineForce(amplitude=0.02, frequency=50.0))
    assert run.converged
    assert abs(run.energy["closure"]) < 1e-9
    assert run.energy[law.name] > 1e-3 * run.energy["mechanical_in"]


def saturating_maxwell(force, scale, time_constant):
    """A spring that saturates, in series with a damper whose rate is linear."""
    return lambda t, x, u, v, own: (force * np.tanh((x - own[0]) / scale), 0.0, [(x - own[0]) / time_constant])


def saturating_polarisation(charge, scale, time_constant):
    """A charge that follows a lagging voltage and saturates: its current is its rate."""

    def memory(t, x, u, v, own):
        rate = (v - own[0]) / time_constant
        return 0.0, charge / scale / np.cosh(own[0] / scale) ** 2 * rate, [rate]

    return memory


def lagging_force(force, scale, time_constant):
    """A force that follows late what is a function of the displacement."""
    return lambda t, x, u, v, own: (own[0], 0.0, [(-force * np.tanh(x / scale) - own[0]) / time_constant])


def lagging_polarisation(charge, scale, time_constant):
    """A charge that follows late what is a function of the voltage: its current is its rate."""

    def memory(t, x, u, v, own):
        rate = (charge * np.tanh(v / scale) - own[0]) / time_constant
        return 0.0, rate, [rate]

    return memory


TRUE = {
    "spring": (saturating_maxwell(0.004, 5e-5, 3e-3), Law(place=Spring(), form=tanh(-0.004, 5e-5), memory=AHEAD)),
    "capacitor": (
        saturating_polarisation(2e-8, 1.5, 3e-3), Law(place=Capacitor(), form=tanh(2e-8, 1.5), memory=LAG),
    ),
    "force that lags": (lagging_force(0.004, 5e-5, 3e-3), Law(place=Spring(), form=tanh(-0.004, 5e-5), memory=LATE)),
    "charge that lags": (
        lagging_polarisation(2e-8, 1.5, 3e-3), Law(place=Capacitor(), form=tanh(2e-8, 1.5), memory=LATE),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TRUE)
def test_a_function_of_a_memory_moves_as_an_independent_integration(name):
    memory, law = TRUE[name]
    drive = Drive((0.02, 0.01), (48.0, 53.0))
    true = device_with(memory, 1, drive, LOAD, 0.06, SAMPLES)
    setting = setting_of("force", Resistor(resistance=LOAD), 1.0 / SAMPLES, true["force"])
    for effects, closest in (((law,), True), ((), False)):
        run = Prediction(Transducer(**BEAM, effects=effects), setting, relaxed=True)
        (block,) = run.blocks(False, channels=["displacement", "voltage"])
        for channel, values in zip(("displacement", "voltage"), block.values.T, strict=True):
            error = np.abs(values - true[channel]).max() / np.ptp(true[channel])
            assert error < 1e-3 if closest else error > 1e-3, channel


def searched_in(folder, memory, records):
    read = lambda drive, load: device_with(memory, 1, drive, load, SPAN, 2000.0)  # noqa: E731
    return searched(campaign_of(folder, "beam", read, records))


RECORDS = [
    (Drive((0.02, 0.01), (48.0, 33.0)), 1e5), (Drive((0.005, 0.03), (52.0, 21.0)), 5e5),
    (Drive((0.012,), (50.0,)), 2e4), (Drive((0.015, 0.02), (47.0, 27.0)), 1e5),
]  # fmt: skip


@pytest.mark.recovery_long
def test_a_saturating_maxwell_element_is_found_with_its_formula(tmp_path):
    read = lambda drive, load: device_with(TRUE["spring"][0], 1, drive, load, SPAN, 2000.0)  # noqa: E731
    problem, before = fitted_without_law(campaign_of(tmp_path, "beam", read, RECORDS[:3]))
    found = search(problem, before, lambda text: None)
    law = found.best.law
    assert (law.place.name, law.form.word) == ("spring", "tanh")
    less = without_effect(problem, found.final, 0)  # of such a law no factor is a static part of the stiffness
    assert less is None or less.cost > found.final.cost + 100.0
    assert law.form.factor == pytest.approx(-0.004, rel=0.02)
    assert law.form.scale == pytest.approx(5e-5, rel=0.02)
    assert law.memory.time_constant == pytest.approx(3e-3, rel=0.02)
    assert not found.close
    table = as_json(discovery(found.best, 1.0, 0.0, (), found.forms))
    assert table["memory"]["kind"] == "lag" and "tanh" in table["formula"] and "lag(x" in table["formula"]


LOADED = """
import ast, sys
from piezoharvest import Resistor, SineForce, System, Transducer, simulate
from piezoharvest.description.effects import registered
from piezoharvest.effect_files import load_effects
(name,) = load_effects(sys.argv[1])
device = Transducer(**ast.literal_eval(sys.argv[2]), effects=(registered()[name](),))
shunt = Resistor(resistance=float(sys.argv[3]))
print(simulate(System(device, shunt), SineForce(amplitude=0.02, frequency=50.0)).harvested_power)
"""


def test_a_polarisation_that_lags_and_saturates_is_found_and_becomes_an_effect(tmp_path):
    found = searched_in(tmp_path, TRUE["capacitor"][0], RECORDS[:3])
    law = found.best.law
    assert (law.place.name, law.form.word, law.memory.kind) == ("capacitor", "tanh", "relaxation")
    assert law.form.factor == pytest.approx(2e-8, rel=0.03)
    assert law.memory.time_constant == pytest.approx(3e-3, rel=0.03)
    save_effect(discovery(found.best, 1.0, 0.0, ()), "campaign.toml", tmp_path / "law.py")
    # In a process of its own, as an effect that is loaded is in the library of all tests that follow.
    loaded = subprocess.run(
        [sys.executable, "-c", LOADED, str(tmp_path / "law.py"), repr(BEAM), str(LOAD)],
        check=True, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    results = [float(loaded.stdout)] + [
        simulate(System(device, Resistor(resistance=LOAD)), SineForce(amplitude=0.02, frequency=50.0)).harvested_power
        for device in (Transducer(**BEAM, effects=(law,)), Transducer(**BEAM))
    ]
    assert results[0] == pytest.approx(results[1], rel=1e-6)
    assert abs(results[2] / results[1] - 1.0) > 0.01


def with_memories(folder, read, place):
    """What is left of a table at a place with each memory of its input."""
    problem, before = fitted_without_law(campaign_of(folder, "beam", read, RECORDS[:3]))
    visited = visited_inputs(problem, before)[place.input]
    without = fitted(problem, before, Law(place=place, form=table_for(place, visited)), visited)
    return functions_of_memories(problem, before, [without], lambda text: None)


def test_a_force_that_lags_behind_by_play_gives_energy_and_is_no_law_of_the_spring(tmp_path):
    """Lost motion before a spring that does not fall back with it: over a period it gives energy to the beam."""
    read = lambda drive, load: spring_behind_play(40.0, 4e-5, drive, load, SPAN, 2000.0)  # noqa: E731
    plays = [each for each in with_memories(tmp_path, read, Spring()) if isinstance(each.law.memory, Play)]
    assert plays
    for each in plays:
        assert np.real(each.form.values(np.array([each.law.memory.threshold])))[0] > 0.0


def behind_play(drive, load):
    """What a sensor shows: the motion, and a power of what follows it with play of 20 um on each side."""
    fine = spring_behind_play(0.0, 1.0, drive, load, SPAN, 16_000.0)  # a plain beam, between whose samples it turns
    at, play = 0.0, np.empty(len(fine["displacement"]))
    for n, x in enumerate(fine["displacement"].tolist()):
        at = play[n] = min(max(at, x - 2e-5), x + 2e-5)
    fine["displacement"] = fine["displacement"] + 10.0 * np.sign(play) * np.abs(play) ** 1.5
    return {name: values[::8] for name, values in fine.items()}


def test_a_function_of_what_follows_with_play_is_fitted_from_that_of_the_motion(tmp_path):
    found = with_memories(tmp_path, behind_play, Reading("displacement", "displacement"))[-1]
    memory = as_json(discovery(found, 1.0, 0.0, ()))["memory"]
    assert memory == {"kind": "play", "threshold": pytest.approx(2e-5, rel=0.05), "follows": True}


def test_a_charge_that_relaxes_towards_a_function_is_told_from_a_function_of_a_lag(tmp_path):
    read = lambda drive, load: device_with(TRUE["charge that lags"][0], 1, drive, load, SPAN, 2000.0)  # noqa: E731
    memory = best_of(with_memories(tmp_path, read, Capacitor()))[0].law.memory
    assert isinstance(memory, LaggingFunction)
    assert memory.time_constant == pytest.approx(3e-3, rel=0.05)


@pytest.mark.slow
def test_a_charge_that_relaxes_towards_a_function_of_the_voltage_is_found(tmp_path):
    found = searched_in(tmp_path, TRUE["charge that lags"][0], RECORDS)
    law = found.best.law
    assert (law.place.name, law.form.word, law.memory.kind) == ("capacitor", "tanh", "lagging_function")
    assert law.form.factor == pytest.approx(2e-8, rel=0.02)
    assert law.form.scale == pytest.approx(1.5, rel=0.02)
    assert law.memory.time_constant == pytest.approx(3e-3, rel=0.02)
    told = as_json(discovery(found.best, 1.0, 0.0, (), found.forms))
    assert told["memory"] == {"kind": "lagging_function", "time_constant": pytest.approx(3e-3, rel=0.02)}
    assert told["formula"].startswith("lag(") and told["formula"].endswith(" s)")


def test_a_function_lags_where_power_is_known_and_in_readings():
    assert (
        Law(place=Reading("voltage", "voltage"), form=Line(factor=1.0), memory=LATE).name
        == "reading.voltage lagging function"
    )
    with pytest.raises(ParameterError, match="found a function that lags at the coupling"):
        Law(place=Coupling(), form=tanh(1e-8, 1e-5), memory=LATE)


@pytest.mark.slow
def test_a_sensor_that_follows_with_play_and_bends_is_found(tmp_path):
    law = searched(campaign_of(tmp_path, "beam", behind_play, RECORDS)).best.law
    assert (law.place.name, law.memory.kind, law.memory.follows) == ("reading.displacement", "play", True)
    assert law.memory.threshold == pytest.approx(2e-5, rel=0.05)
    assert law.form.word == "power" and law.form.exponent == pytest.approx(1.5, abs=0.02)


def test_what_follows_with_play_is_shown_only_as_a_force_of_it_would_give_energy():
    follows = Play(threshold=1.0, follows=True)
    assert follows.made_of(np.array([0.0, 3.0, 2.0, -1.0, 0.5]), 1.0) == pytest.approx([0.0, 2.0, 2.0, 0.0, 0.0])
    with pytest.raises(ParameterError, match="found true at the spring, allowed in a reading only"):
        Law(place=Spring(), form=Line(factor=1.0), memory=follows)


def test_a_table_of_a_memory_has_its_memory_as_values():
    form = Corners(knots=(0.0, -0.0), kinks=(1.0, -1.0))
    assert Law(place=Spring(), form=form, memory=AHEAD).bends_memory
    assert not Law(place=Spring(), form=form, memory=AHEAD).bent
