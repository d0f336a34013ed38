"""Laws without a name in specimen files and studies: what comes back, what is refused, and their uncertainty."""

from typing import Any

import numpy as np
import pytest

from piezoharvest.description.effects import Stiffening
from piezoharvest.description.effects.nameless.circuit_places import DcLoad, Diode, SwitchLoop
from piezoharvest.description.effects.nameless.forms import (
    Bends,
    Corners,
    DeadZone,
    Hertz,
    Knee,
    Line,
    Monomial,
    Polynomial,
    Power,
    TwoKnees,
)
from piezoharvest.description.effects.nameless.kinds import PARTS, kind_of, kinds_of
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Delay, LateBy, Play, Relaxation, Resonance
from piezoharvest.description.effects.nameless.places import (
    Capacitor,
    Coupling,
    Damper,
    Electrodes,
    GainOverTime,
    Load,
    LoadCurrent,
    OverTime,
    Reading,
    Spring,
)
from piezoharvest.description.effects.nameless.shapes import Bump, Coulomb, Shape, Shockley, StepChange, Stribeck
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.shunts import Resistor
from piezoharvest.description.transducer import Transducer
from piezoharvest.specimen import Specimen, intervals, load_specimen, write_specimen
from piezoharvest.study import StudyError, load_study

VALUES: dict[str, Any] = {"mass": 0.01, "damping": 0.0628, "stiffness": 986.96, "coupling": 1e-3, "capacitance": 40e-9}
LAWS = [
    Law(place=Load(), form=Knee(factor=5e-5, knee=2.19, sides=1)),
    Law(place=Damper(), form=Power(factor=np.float64(2e-3), exponent=1.7, scale=0.2)),
    Law(place=Spring(), form=Monomial(factor=0.05, scale=np.float64(1e-3), exponent=3)),
    Law(place=Spring(), form=Polynomial(factor=0.05, second=0.1, scale=1e-3, exponents=(2, 5))),
    Law(place=Coupling(), form=Bends(knots=(0.0, -0.0), kinks=(np.float64(0.5), 0.5))),
    Law(place=Reading("voltage", "displacement_rate"), form=Corners(knots=(1e-4,), kinks=(3.0,))),
    Law(place=Spring(), form=Shape(factor=1e-3, scale=8e-4, curve="log", bent=True, knots=(0.0, 1e-3))),
    Law(place=Spring(), form=Hertz(factor=1e-3, scale=8e-4, odd=False, side=-1)),
    Law(place=Damper(), form=Stribeck(factor=1e-3, excess=0.5, speed=0.1, width=1e-3, knots=(0.0, 0.1, 0.2))),
    Law(place=Damper(), form=Coulomb(factor=1e-3, width=1e-3, knots=(0.0, 0.1, 0.2))),
    Law(
        place=Reading("voltage", "time"), form=StepChange(factor=-0.3, at=np.float64(0.6), width=0.01, knots=(0.0, 0.1))
    ),
    Law(place=Spring(), form=TwoKnees(factor=300.0, second=80.0, upper=np.float64(1e-4), lower=-2e-4)),
    Law(place=GainOverTime("force", "campaign_time"), form=StepChange(factor=0.1, at=20.7, width=1e-3, finest=1e-4)),
    Law(place=Reading("displacement", "campaign_time"), form=Line(factor=1e-9)),
    Law(place=OverTime("capacitance", "campaign_time"), form=Bump(factor=-0.06, at=6.5, width=np.float64(3.0))),
    Law(place=LoadCurrent(), form=Line(factor=1.0), memory=LateBy(delay=1e-3)),
    Law(place=Reading("displacement", "voltage"), form=Line(factor=1e-7), memory=LateBy(delay=1e-3, whole=True)),
    Law(place=Electrodes(), form=DeadZone(factor=1e-6, zone=0.1)),
    Law(place=OverTime("stiffness", "amplitude"), form=Line(factor=0.3)),
    Law(place=OverTime("damping", "campaign_time"), form=Line(factor=0.01)),
    Law(place=OverTime("coupling", "displacement_amplitude"), form=Line(factor=100.0)),
    Law(place=Diode(reach=1e-3), form=Shockley(factor=0.05, scale=1e-8, resistance=3.0, knots=(0.0, 1e-3))),
    Law(place=Reading("displacement", "displacement"), form=Line(factor=-1.0), memory=Play(threshold=1e-6)),
    Law(place=Spring(), form=Line(factor=-3.0), memory=Resonance(frequency=70.0, damping_ratio=0.1)),
    Law(place=Capacitor(), form=Line(factor=1e-9), memory=Relaxation(time_constant=0.1)),
    Law(place=Reading("voltage", "voltage"), form=Line(factor=1.0), memory=Delay(delay=1e-4)),
    Law(place=Diode(reach=1e-4), form=Power(factor=0.1, exponent=0.4, scale=1e-4, odd=False)),
    Law(place=DcLoad(reach=10.0), form=Knee(factor=1e-6, knee=4.0, sides=1)),
    Law(place=SwitchLoop(reach=np.float64(1e-2)), form=Knee(factor=50.0, knee=1e-3, sides=1)),
]


def saved(law, folder, values=None, covariance=None, scaling=()):
    """File of a specimen that has a law, or was measured by a sensor with it."""
    inside = (law,) if law.of_specimen else ()
    device = Transducer(**VALUES, effects=inside)
    scatter = np.zeros((0, 0)) if covariance is None else np.asarray(covariance)
    specimen = Specimen(values or {}, scatter, scaling, device, measurement=() if inside else (law,))
    write_specimen(specimen, folder / "specimen.toml")
    return folder / "specimen.toml"


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_law_comes_back_as_it_was(law, tmp_path):
    found = load_specimen(saved(law, tmp_path))
    assert found.transducer is not None
    assert (*found.transducer.effects, *found.measurement) == (law,)
    (read,) = (*found.transducer.effects, *found.measurement)
    knots = [np.signbit(getattr(each.form, "knots", ())).tolist() for each in (read, law)]
    assert knots[0] == knots[1]  # -0.0 begins a piece below zero


def test_every_part_of_a_law_is_above():
    for part in PARTS:
        tried = {kind_of(type(getattr(law, part))) for law in LAWS}
        assert tried - {"none_type"} == set(kinds_of(part))


def test_uncertainty_of_a_cubic_law_is_that_of_the_stiffening_that_it_is(tmp_path):
    """Two ways through the engine, with the same draws: a law one by one, the effect in a batch."""
    drive, shunt, size, cubic = SineForce(amplitude=0.02, frequency=49.0), Resistor(resistance=1e5), 3e-4, 5e7
    factor, error = cubic * size**3, 0.3 * cubic
    law = Law(place=Spring(), form=Monomial(factor=factor, scale=size, exponent=3))
    name = "effects.spring polynomial.form.factor"
    path = saved(law, tmp_path, {name: factor}, [[(error * size**3) ** 2]], ("linear",))
    device = Transducer(**VALUES, effects=(Stiffening(cubic_stiffness=cubic),))
    known = Specimen({"effects.stiffening.cubic_stiffness": cubic}, np.array([[error**2]]), ("linear",), device)
    of_law, of_effect = (intervals(each, shunt, drive, 3) for each in (load_specimen(path), known))
    for figure in ("harvested_power", "displacement_amplitude"):
        assert of_law[figure]["std"] > 1e-3 * of_law[figure]["mean"]
        assert of_law[figure] == pytest.approx(of_effect[figure], rel=1e-6)


STUDY = """
[transducer]
mass = 0.01
damping = 0.0628
stiffness = 986.96
coupling = 1e-3
capacitance = 40e-9
[transducer.effects."NAME"]
{}
[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 49.0
[[shunts]]
kind = "resistor"
resistance = 8e4
"""
PLACE, FORM = 'place = {kind = "load"}\n', 'form = {kind = "knee", factor = 1e-5, knee = 2.0}\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('place = {kind = "lode"}\n' + FORM, "load knee.place.kind: found 'lode'"),
        ("place = {}\n" + FORM, "load knee.place.kind: missing key, allowed are capacitor"),
        (PLACE, "load knee.form: missing key, a law has a place and a form"),
        (PLACE + FORM + "memories = 1\n", "load knee.memories: unknown key"),
        (PLACE + FORM.replace("knee = 2.0", "sides = 2"), "load knee.form.knee: missing key"),
        (PLACE + FORM.replace("knee = 2.0", "knee = 2.0, sides = 3"), "load knee.form.sides: found 3"),
        (PLACE + 'form = {kind = "corners", knots = [1.0], kinks = [1.0, 2.0]}\n', "form.kinks: found 2 for 1 knot"),
        (PLACE + 'form = {kind = "corners", knots = [], kinks = []}\n', "form.knots: found (), allowed are finite"),
        (
            'place = {kind = "capacitor"}\nmemory = {kind = "play", threshold = 0.5}\n' + FORM,
            "form: found knee with a play of the capacitor, must be linear",
        ),
        (PLACE + 'form = {kind = "monomial", factor = 1.0, scale = 0.0}\n', "form.scale: found 0.0, must be a"),
        (PLACE + 'form = {kind = "monomial", factor = 1.0, scale = 1.0, exponent = 1}\n', "form.exponent: found 1"),
        (PLACE + FORM + 'memory = {kind = "play", threshold = -1.0}\n', "load knee.memory.threshold: found -1"),
        ('place = {kind = "spring"}\n' + FORM, "found the law 'spring knee' under this name, must have its own"),
        ("factor = 1.0\n", "transducer.effects.load knee: unknown effect"),
    ],
)
def test_what_is_wrong_with_a_law_is_said_in_a_sentence(text, message, tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace("NAME", "load knee").format(text))
    with pytest.raises(StudyError, match=r"study\.toml") as error:
        load_study(path)
    assert message in str(error.value)


def test_a_study_takes_a_law_by_its_place_and_form(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace("NAME", "load knee").format(PLACE + FORM))
    assert load_study(path).transducer.effects == (Law(place=Load(), form=Knee(factor=1e-5, knee=2.0)),)
