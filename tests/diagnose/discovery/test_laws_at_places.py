"""A law at a place, as predictions of records and the engine see it: against an independent integration."""

import numpy as np
import pytest
from nameless import BEAM, Drive, Laws, record
from selection import with_slow

from piezoharvest import Resistor, SineForce, System, Transducer, linearize, simulate
from piezoharvest.description.effects import registered
from piezoharvest.description.effects.nameless.forms import Bends, Corners, Knee, Monomial, Power
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import (
    Capacitor,
    Coupling,
    Damper,
    Electrodes,
    Load,
    Reading,
    Spring,
)
from piezoharvest.description.effects.nameless.shapes import Shape
from piezoharvest.diagnose.discovery.law_fits import law_parameters
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.parameters import put, value_at
from piezoharvest.predict.prediction import Prediction

DRIVE, LOAD, RATE = Drive((0.02, 0.01), (48.0, 53.0)), 1e5, 8000.0


def knee(v):
    return 5e-6 * np.sign(v) * np.maximum(np.abs(v) - 2.0, 0.0)


CASES = {
    "load": (Load(), Knee(factor=5e-6, knee=2.0), Laws(load=knee)),
    "electrodes": (Electrodes(), Corners(knots=(2.0, -2.0), kinks=(5e-6, -5e-6)), Laws(electrodes=knee)),
    "spring": (Spring(), Monomial(factor=0.05, scale=1e-3, exponent=3), Laws(spring=lambda x: 0.05 * (x / 1e-3) ** 3)),
    "damper": (
        Damper(),
        Power(factor=2e-3, exponent=1.7, scale=0.2),
        Laws(damper=lambda u: 2e-3 * np.sign(u) * np.abs(u / 0.2) ** 1.7),
    ),
    "capacitor": (
        Capacitor(),
        Bends(knots=(2.0, -2.0), kinks=(3e-9, -3e-9)),
        Laws(capacitance=lambda v: 3e-9 * np.maximum(np.abs(v) - 2.0, 0.0)),
    ),
    "coupling": (
        Coupling(),
        Monomial(factor=2.5e-7, scale=1e-3),
        Laws(coupling=lambda x: 5e-7 * x / 1e-6),
    ),
    "cubic coupling": (
        Coupling(),
        Monomial(factor=2e-6 / 3, scale=1e-3, exponent=3),
        Laws(coupling=lambda x: 2e-3 * (x / 1e-3) ** 2),
    ),
    "bent spring": (
        Spring(),
        Bends(knots=(2e-4, -2e-4), kinks=(2e6, -2e6)),
        Laws(spring=lambda x: 1e6 * np.sign(x) * np.maximum(np.abs(x) - 2e-4, 0.0) ** 2),
    ),
    "coupling table": (
        Coupling(),
        Bends(knots=(0.0, -0.0), kinks=(0.5, 0.5)),
        Laws(coupling=lambda x: 0.5 * x),
    ),
    "reading.voltage": (
        Reading("voltage", "displacement"),
        Power(factor=3.0, exponent=1.5, scale=1e-3, odd=False),
        Laws(reading={"voltage": lambda true: 3.0 * np.abs(true["displacement"] / 1e-3) ** 1.5}),
    ),
}  # fmt: skip


def predicted(place, form, drive, parameters=()):
    transducer = Transducer(**BEAM, effects=(Law(place=place, form=form),))
    setting = setting_of("force", Resistor(resistance=LOAD), 1.0 / RATE, drive)
    run = Prediction(transducer, setting, parameters)
    names = ["displacement", "voltage", "current"]
    (block,) = run.blocks(bool(parameters), channels=names)
    return dict(zip(names, block.values.T, strict=True)), block.derivatives


@pytest.mark.parametrize("name", CASES)
def test_a_record_is_predicted_as_an_independent_integration_has_it(name):
    place, form, laws = CASES[name]
    true = record(BEAM, laws, DRIVE, LOAD, 0.15, RATE)
    plain = record(BEAM, Laws(), DRIVE, LOAD, 0.15, RATE)
    found, _ = predicted(place, form, true["force"])
    for channel, values in found.items():
        wanted = true[channel] + laws.reading.get(channel, lambda true: 0.0)(true)
        # Corners within a sample leave an error of the order of its square, a hundredth of a radian.
        assert np.abs(values - wanted).max() < 2e-4 * np.ptp(wanted), channel
    changed = "voltage" if place.name != "spring" else "displacement"
    assert np.abs(found[changed] - plain[changed]).max() > 0.005 * np.ptp(plain[changed])  # it matters


@pytest.mark.parametrize("name", ["load", "damper", "coupling table"])
def test_derivatives_with_respect_to_a_law_are_those_of_its_predictions(name):
    place, form, _ = CASES[name]
    law = Law(place=place, form=form)
    parameters = law_parameters(law, 0)
    drive = DRIVE(np.arange(400) / RATE)
    _, slopes = predicted(place, form, drive, parameters)
    for k, parameter in enumerate(parameters):
        inner = parameter.inner(value_at(Transducer(**BEAM, effects=(law,)), parameter.path))
        both = []
        for step in (1e-5, -1e-5):
            moved = put(law, parameter.path[2:], parameter.outer(inner + step * abs(inner)))
            values, _ = predicted(place, moved.form, drive)
            both.append(np.column_stack(list(values.values())))
        wanted = (both[0] - both[1]) / (2e-5 * abs(inner))
        size = np.abs(wanted).max(axis=0)
        # A sample at a corner has a difference of its own.
        close = np.abs(slopes[:, :, k] - wanted) < 1e-3 * size
        assert close.mean() > 0.98, parameter.name


@pytest.mark.parametrize(
    "form",
    [Knee(factor=2.0, knee=0.3), Knee(factor=2.0, knee=-0.3, sides=-1), Power(factor=2.0, exponent=1.6, scale=1.0),
     Monomial(factor=1.0, scale=2.0, exponent=2),
     Shape(factor=1.0, scale=0.7, curve="tanh", bent=True, knots=(0.0, 0.5, -0.0, -0.5))],
)  # fmt: skip
def test_a_form_is_zero_at_zero_and_absent_without_strength(form):
    assert form.values(np.zeros(1))[0] == 0.0
    assert not form.absent
    assert put(form, (form.strengths[0],), 0.0).absent


def test_a_law_is_no_effect_of_the_library():
    assert all(isinstance(name, str) for name in registered())
    assert Law not in registered().values()


@pytest.mark.parametrize(
    "name",
    # Elements of elements: none may be out of scale, as if the law were not there.
    with_slow(
        ["load", "spring", "coupling", "cubic coupling", "bent spring", "coupling table"],
        slow=lambda name: name != "coupling table",
    ),
)
def test_the_engine_moves_as_an_independent_integration(name):
    place, form, laws = CASES[name]
    transducer = Transducer(**BEAM, effects=(Law(place=place, form=form),))
    run = simulate(System(transducer, Resistor(resistance=LOAD)), SineForce(amplitude=0.02, frequency=50.0))
    true = record(BEAM, laws, Drive((0.02,), (50.0,)), LOAD, 6.0, 12800.0)
    last = {channel: values[-512:] for channel, values in true.items()}
    # Its corners are rounded off.
    assert run.converged
    assert run.displacement_amplitude == pytest.approx(np.ptp(last["displacement"]) / 2, rel=1e-3)
    assert run.voltage_amplitude == pytest.approx(np.ptp(last["voltage"]) / 2, rel=1e-3)
    assert abs(run.energy["closure"]) < 1e-8


def test_small_motions_do_not_feel_a_knee():
    law = Law(place=Load(), form=Knee(factor=5e-6, knee=2.0))
    with_it, without = (linearize(Transducer(**BEAM, effects=effects)) for effects in ((law,), ()))
    assert np.allclose(with_it.A, without.A)
