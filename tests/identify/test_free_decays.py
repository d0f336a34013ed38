"""Free decays of a beam on a resistor, in closed form: the specimen is identified, and begins without a damping."""

import numpy as np
import pytest
from scipy.linalg import expm

from piezoharvest.diagnose import diagnose
from piezoharvest.identify import identify
from piezoharvest.records import Campaign

TRUE = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
NOMINAL = {"mass": 0.011, "stiffness": 900.0, "coupling": 1.1e-3, "capacitance": 38e-9}
RATE, COUNT = 2000.0, 1500
NOISE = {"force": 1e-5, "displacement": 1e-8, "voltage": 1e-4}  # N, m, V: of a drive at rest, 1e-4 of the responses


def decays(damping, opened=False):
    """Campaign of a beam that is let go, by its state matrix; its sensor of force shows noise alone.

    With `opened` electrodes the second record has a current of exactly nothing.
    """
    rng, records = np.random.default_rng(1), []
    mass, stiffness, coupling, capacitance = (TRUE[name] for name in ("mass", "stiffness", "coupling", "capacitance"))
    for resistance in (5e4, np.inf if opened else 1e6):
        first = [0.0, 1.0, 0.0]
        second = [-stiffness / mass, -TRUE["damping"] / mass, coupling / mass]
        third = [0.0, -coupling / capacitance, -1.0 / (resistance * capacitance)]
        step, states = expm(np.array([first, second, third]) / RATE), [np.array([1e-4, 0.0, 0.0])]
        for _ in range(COUNT - 1):
            states.append(step @ states[-1])
        shift, _, voltage = np.transpose(states)
        clean = {"force": np.zeros(COUNT), "displacement": shift, "voltage": voltage}
        columns = {"force": "force_N", "displacement": "displacement_m", "voltage": "voltage_V"}
        data = {columns[name]: clean[name] + NOISE[name] * rng.standard_normal(COUNT) for name in clean}
        load = {"load_resistance": resistance}
        if resistance == np.inf:
            data["current_A"], load = np.zeros(COUNT), {"shunt": {"kind": "open"}}
        records.append({"data": data, "sample_rate": RATE, **load})
    return Campaign.from_arrays({**NOMINAL, "damping": damping}, records)


@pytest.mark.parametrize("damping", [0.08, 0.0])
def test_a_beam_is_identified_by_its_decays_whether_its_damping_is_known_or_said_to_be_zero(damping):
    found = identify(decays(damping))
    for estimate in found.estimates:
        value = TRUE[estimate.parameter.name]
        assert estimate.identifiable
        assert abs(estimate.value - value) < 4.0 * estimate.std < 0.02 * value
    assert found.doubts == ()


def test_a_current_of_exactly_nothing_behind_open_electrodes_says_nothing():
    found = identify(decays(0.08, opened=True))
    for estimate in found.estimates:
        assert abs(estimate.value - TRUE[estimate.parameter.name]) < 4.0 * estimate.std
    assert "current" not in found.fit.rms


def test_nothing_is_missing_in_decays():
    assert diagnose(decays(0.0)).verdict == "adequate"
