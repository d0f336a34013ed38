"""A parameter that changes with the amplitude or the frequency of the drive: predicted, simulated, found."""

import numpy as np
import pytest
from nameless import BEAM, Drive, Laws, nameless_campaign, record
from remembering import searched

from piezoharvest import Resistor, SineForce, System, Transducer, simulate
from piezoharvest.description.effects.nameless.forms import Line
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import OverTime
from piezoharvest.diagnose.discovery.result import as_json, discovery
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.drive import size_of
from piezoharvest.predict.prediction import Prediction

LOAD, RATE = 1e5, 2000.0


def softer(drive, per_newton=-2.0):
    """A spring that is softer by 2 % for each 0.01 N of the drive's amplitude."""
    change = per_newton * drive.amplitudes[0]
    return Laws(spring=lambda x: BEAM["stiffness"] * change * x)


def slower(drive, per_hertz=0.005):
    """A spring that is stiffer by half a per cent for each hertz of the drive above 48 Hz."""
    change = per_hertz * (drive.frequencies[0] - 48.0)
    return Laws(spring=lambda x: BEAM["stiffness"] * change * x)


def test_amplitude_and_frequency_of_a_drive_are_those_of_its_sine():
    t = np.arange(1200) / RATE
    amplitude, frequency = size_of(0.5 + 0.02 * np.sin(2 * np.pi * 50.6 * t), 1.0 / RATE)[:2]
    assert amplitude == pytest.approx(0.02, rel=1e-3)
    assert frequency == pytest.approx(50.6, rel=2e-3)
    assert size_of(np.ones(50), 1.0 / RATE)[:2] == (0.0, 0.0)


@pytest.mark.parametrize(
    ("of", "laws", "form"),
    [("amplitude", softer, Line(factor=-2.0)), ("frequency", slower, Line(factor=0.005, start=48.0))],
)
def test_two_records_have_their_own_value_of_it(of, laws, form):
    law = Law(place=OverTime("stiffness", of), form=form)
    for drive in (Drive((0.01,), (48.0,)), Drive((0.02,), (53.0,))):
        true = record(BEAM, laws(drive), drive, LOAD, 0.4, RATE)
        setting = setting_of("force", Resistor(resistance=LOAD), 1.0 / RATE, true["force"])
        (block,) = Prediction(Transducer(**BEAM, effects=(law,)), setting).blocks(False, channels=["displacement"])
        # Amplitude and frequency are read from samples: to a part in a thousand of a change of some per cent.
        assert np.abs(block.values[:, 0] - true["displacement"]).max() < 2e-3 * np.ptp(true["displacement"])


def test_the_engine_takes_amplitude_and_frequency_of_its_sine():
    law = Law(place=OverTime("stiffness", "amplitude"), form=Line(factor=-2.0))
    sine = SineForce(amplitude=0.02, frequency=50.0)
    found = simulate(System(Transducer(**BEAM, effects=(law,)), Resistor(resistance=LOAD)), sine)
    plain = Transducer(**(BEAM | {"stiffness": 0.96 * BEAM["stiffness"]}))
    wanted = simulate(System(plain, Resistor(resistance=LOAD)), sine)
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of", "laws", "factor"),
    [("amplitude", softer, -2.0), ("frequency", slower, 0.005)],
    ids=["amplitude", "frequency"],
)
def test_a_stiffness_that_changes_with_the_drive_is_found(of, laws, factor, tmp_path):
    drives = [(0.01, 48.0), (0.02, 50.6), (0.03, 53.0), (0.02, 49.0)] if of == "frequency" else [
        (0.01, 50.6), (0.02, 48.0), (0.03, 50.0), (0.015, 52.0)
    ]  # fmt: skip
    records = [(Drive((a,), (f,)), LOAD) for a, f in drives]
    found = searched(nameless_campaign(tmp_path, "beam", laws, records, rate=RATE, duration=0.5))
    table = as_json(discovery(found.best, 1.0, 0.0, ()))
    assert (table["place"], table["input"], table["form"]) == ("parameter.stiffness", of, "linear")
    # The stiffness is that at the least amplitude, or frequency; the slope is relative to it.
    slope, base = table["parameters"]["slope"], found.best.found.model.transducer.stiffness
    assert slope["value"] * base == pytest.approx(factor * BEAM["stiffness"], rel=0.05)


@pytest.mark.parametrize("transient", [None, 5 / 45.0])
@pytest.mark.parametrize("parameter", ["stiffness", "damping", "coupling", "capacitance"])
def test_a_parameter_that_depends_on_the_drive_acts_and_takes_energy_as_one_of_that_value(parameter, transient):
    """Six per cent more at this amplitude: as a device that has six per cent more, whose energy is known."""
    drive, load = SineForce(amplitude=0.02, frequency=45.0), Resistor(resistance=1e5)
    law = Law(place=OverTime(parameter, "amplitude"), form=Line(factor=3.0))
    found = simulate(System(Transducer(**BEAM, effects=(law,)), load), drive, transient=transient)
    more = simulate(System(Transducer(**{**BEAM, parameter: 1.06 * BEAM[parameter]}), load), drive, transient=transient)
    assert found.converged and abs(found.energy["closure"]) < 1e-12
    for name in ("harvested_power", "mechanical_power", "displacement_amplitude"):
        assert getattr(found, name) == pytest.approx(getattr(more, name), rel=1e-9), name
