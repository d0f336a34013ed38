"""States of effects that a record finds under way: their motion, derivatives and priors; what nothing is known of."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from piezoharvest.description.effects import Creep, DielectricRelaxation
from piezoharvest.description.shunts import Resistor
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.output_error import UNKNOWN_VARIANCE, posterior
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.parameters import Parameter, put, value_at
from piezoharvest.predict.prediction import Prediction

m, b, k, T, C, R = 0.010, 0.0628, 986.96, 1.0e-3, 40e-9, 3e6
RATIO, RETARDATION, BRANCH, RELAXATION = 0.05, 0.3, 6e-9, 0.2
CREEP = Creep(compliance_ratio=RATIO, time_constant=RETARDATION)
SLOW = DielectricRelaxation(capacitance=BRANCH, time_constant=RELAXATION)
DEVICE = Transducer(mass=m, damping=b, stiffness=k, coupling=T, capacitance=C, effects=(CREEP, SLOW))
STEP, COUNT = 1e-3, 400
BEGUN = {"x1": 2e-6, "u1": 0.0, "q": 3e-9, "start creep": 1e-6, "start relaxation": -2e-9}


def setting():
    return setting_of("force", Resistor(resistance=R), STEP, np.zeros(COUNT), DEVICE)


def predicted(device, nuisance, parameters=(), derivatives=False):
    prediction = Prediction(device, setting(), parameters, nuisance, at_rest=False)
    (block,) = prediction.blocks(derivatives, channels=("displacement", "voltage", "current"))
    return prediction, block


def test_a_free_decay_is_the_matrix_exponential_of_equations_written_by_hand():
    """In the order x, u, q, creep strain y, charge p of the branch: v = (q - T x - p)/C, load current v/R."""
    voltage = np.array([-T, 0.0, 1.0, 0.0, -1.0]) / C
    A = np.array([
        [0.0, 1.0, 0.0, 0.0, 0.0],
        (np.array([-k, -b, 0.0, k, 0.0]) + T * voltage) / m,
        -voltage / R,
        np.array([RATIO, 0.0, 0.0, -1.0 - RATIO, 0.0]) / RETARDATION,
        (BRANCH * voltage - np.array([0.0, 0.0, 0.0, 0.0, 1.0])) / RELAXATION,
    ])  # fmt: skip
    z, states = np.array(list(BEGUN.values())), []
    step = expm(STEP * A)
    for _ in range(COUNT):
        states.append(z)
        z = step @ z
    prediction, block = predicted(DEVICE, np.array(list(BEGUN.values())))
    assert prediction.nuisance_names == tuple(BEGUN)
    by_hand = np.array(states) @ np.column_stack([[1.0, 0.0, 0.0, 0.0, 0.0], voltage, voltage / R])
    size = np.abs(by_hand).max(axis=0)
    np.testing.assert_allclose(block.values / size, by_hand / size, rtol=0, atol=1e-10)


@pytest.mark.parametrize("path", [("stiffness",), ("capacitance",), ("effects", 0, "time_constant")])
def test_derivatives_where_effects_are_under_way(path):
    parameter = Parameter(path, "", "log", -np.inf, np.inf)
    nuisance = np.array(list(BEGUN.values()))
    _, block = predicted(DEVICE, nuisance, (parameter,), derivatives=True)
    inner, step = parameter.inner(value_at(DEVICE, path)), 1e-5
    low, high = (
        predicted(put(DEVICE, path, float(parameter.outer(inner + side))), nuisance)[1].values for side in (-step, step)
    )
    slope = (high - low) / (2.0 * step)
    np.testing.assert_allclose(block.derivatives[:, :, 0], slope, rtol=0, atol=1e-6 * np.abs(slope).max())


def test_a_state_of_an_effect_begins_at_rest_unless_it_is_freed():
    still = Prediction(DEVICE, setting())
    assert still.nuisance_names == ("x1", "u1", "q") and still.begun == ()
    freed = Prediction(DEVICE, setting(), at_rest=False)
    assert freed.begun == (0, 1)


def test_what_an_effect_could_reach_is_in_units_of_its_state():
    """As much energy as the spring at 5 um has: 5 um of creep."""
    far = replace(setting(), reach=float(np.sqrt(k) * 5e-6))
    np.testing.assert_allclose(Prediction(DEVICE, far, at_rest=False).reach[0], 5e-6)


def test_what_nothing_is_known_of_has_a_variance_that_is_a_number():
    """A time constant of an effect that is absent: neither the records nor a prior say anything of it."""
    known, nothing = np.diag([4.0, 0.0]), np.zeros((2, 2))
    with np.errstate(all="raise"):
        found = posterior(known, nothing)
        assert np.all(np.isfinite(found @ known @ found))
    assert found[0, 0] == pytest.approx(0.25)
    assert found[1, 1] == pytest.approx(UNKNOWN_VARIANCE)
