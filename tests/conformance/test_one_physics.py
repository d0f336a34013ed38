"""The realisations of the one physics against each other: prediction of records, linear view and engine."""

import dataclasses

import numpy as np
import pytest
from conformance.examples import examples, plain_examples
from studies import BENCH, STOPS

from piezoharvest import SineForce, System, Transducer, frequency_response, simulate
from piezoharvest.description import effects, shunts
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt
from piezoharvest.predict.discrete_model import MAGNIFIED, DiscreteModel, setting_of
from piezoharvest.predict.parameters import STEP, parameter_of, parameters_of, stepped, value_at
from piezoharvest.predict.propagation.element_kinds import STOP
from piezoharvest.predict.record_model import LEADS, VARYING, RecordModel

DEVICE = Transducer(**BENCH, hysteresis=Hysteresis(**STOPS))
LINEAR = {name: s for name, s in examples(shunts.registered()).items() if isinstance(s, LinearShunt)}
EFFECTS = effects.registered()
FREQUENCIES = np.array([3.0, 30.0, 49.0, 50.3, 51.0, 80.0])
SAMPLE_TIME = 1e-4


def predicted(device, shunt):
    """Displacement and voltage by a force in the equations that predict records, operators sticking; (f, 2)."""
    m = RecordModel(device, shunt, "force", SAMPLE_TIME).matrices()
    n, w = len(m.A), len(m.kinds)
    inputs = [
        m.O[place, :n] if kind == STOP else np.zeros(n) for kind, place in zip(m.kinds, m.places[:, 0], strict=True)
    ]
    stick = np.array(inputs).reshape(w, n)
    rows = [len(m.O) - len(m.channels) + m.channels.index(name) for name in ("displacement", "voltage")]
    c, d = m.O[rows, :n] + m.O[rows, n : n + w] @ stick, m.O[rows, n + w]
    a = m.A + m.W @ stick
    return np.array([c @ np.linalg.solve(2j * np.pi * f * np.eye(n) - a, m.B[:, 0]) + d for f in FREQUENCIES])


@pytest.mark.parametrize("shunt", LINEAR)
@pytest.mark.parametrize("effect", ["none", *EFFECTS])
def test_prediction_and_linear_view_are_of_the_same_equations(effect, shunt):
    added = () if effect == "none" else (plain_examples(EFFECTS[effect], {})[0],)
    if effect in ("displacement_lag", "contact_compliance"):
        pytest.skip("what a sensor makes of the motion is no part of the linear view")
    device = dataclasses.replace(DEVICE, effects=added)
    try:
        found = predicted(device, LINEAR[shunt])
    except ParameterError as error:
        assert "without a capacitor across the leads" in error.message
        return
    wanted = frequency_response(System(device, LINEAR[shunt]), FREQUENCIES)
    # A short is one through leads with a time constant of `LEADS` of a sample.
    tolerance = 10 * LEADS if LINEAR[shunt].kind == "short" else 1e-9
    np.testing.assert_allclose(found[:, 0], wanted.displacement, rtol=tolerance)
    if LINEAR[shunt].kind != "short":
        np.testing.assert_allclose(found[:, 1], wanted.voltage, rtol=tolerance)


@pytest.mark.parametrize("shunt", [name for name, s in LINEAR.items() if s.kind != "open"])
def test_engine_and_linear_view_are_of_the_same_equations(shunt):
    """Small motions, in which the operators stick."""
    wanted = frequency_response(System(DEVICE, LINEAR[shunt]), np.array([50.3]))
    small = 1e-3 * min(STOPS["thresholds"]) / abs(wanted.charge[0])
    found = simulate(System(DEVICE, LINEAR[shunt]), SineForce(amplitude=small, frequency=50.3))
    assert found.converged, found.message
    assert found.displacement_amplitude == pytest.approx(small * abs(wanted.displacement[0]), rel=1e-8)


@pytest.mark.parametrize("effect", EFFECTS)
def test_derivatives_of_equations_written_at_once_are_those_of_each_parameter_alone(effect):
    example = plain_examples(EFFECTS[effect], {})[0]
    device = dataclasses.replace(DEVICE, effects=(example,))
    fields = [f for f in dataclasses.fields(example) if f.metadata.get("unit") and getattr(example, f.name) is not None]
    parameters = parameters_of(dataclasses.replace(device, effects=()), {"force"})
    parameters += [parameter_of(example, field, ("effects", 0, field.name)) for field in fields]
    load = LINEAR["resistor"]
    setting = setting_of("force", load, SAMPLE_TIME, np.sin(np.arange(50)))
    together = DiscreteModel(device, setting, parameters).tangents
    for k, parameter in enumerate(parameters):
        varied = stepped(device, parameter, parameter.inner(value_at(device, parameter.path)))
        alone = RecordModel(varied, load, "force", SAMPLE_TIME, setting.size).matrices()
        for name in VARYING:
            slopes = np.imag(getattr(alone, name)) / STEP
            found = np.imag(getattr(together, name)[k]) / MAGNIFIED
            np.testing.assert_allclose(found, slopes, rtol=1e-12, atol=1e-14 * np.abs(slopes).max(initial=0.0))
