"""A harvest of nothing comes with its reason; what harvests, or has no load, comes without."""

import math

import pytest
from messages import is_sentence
from studies import BENCH

from piezoharvest import simulate
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.study import build_shunt

DRIVE = SineForce(amplitude=0.02, frequency=50.6)
SIDE = {"smoothing_capacitance": 1e-6, "load_resistance": 1e5}
COIL = {"inductance": 1.0, "quality": 6.0}
STORE = {"turn_on": 50.0, "turn_off": 3.0, "power": 1e-3}
BREAKER = {**COIL, "envelope_capacitance": 1e-9, "threshold": 0.6}


def remark(table):
    response = simulate(System(Transducer(**BENCH), build_shunt(table)), DRIVE)
    assert response.converged, response.message
    return response.message


@pytest.mark.parametrize(
    ("table", "reason"),
    [
        ({"kind": "rectifier", "dc_voltage": 50.0}, "enough for dc_voltage = 50 V, so that no diode conducts"),
        ({"kind": "rectifier", "dc_voltage": 50.0, "diode": "BAT54"}, "dc_voltage = 50 V and the drops of the diodes"),
        ({"kind": "parallel_sshi", "dc_voltage": 500.0, **COIL}, "enough for dc_voltage = 500 V"),
        ({"kind": "rectifier", **SIDE, "diode_drop": 20.0}, "enough for the drops of the diodes"),
        ({"kind": "sece", "diode_drop": 20.0}, "enough for the drops of the diodes (20 V each)"),
        ({"kind": "rectifier", "dc_voltage": 0.0}, "dc_voltage is 0 V"),
        ({"kind": "rectifier", "smoothing_capacitance": 1e-6, "storage": STORE}, "turn_on is 50 V"),
    ],
)
def test_the_reason(table, reason):
    said = remark(table)
    assert said.startswith("nothing is harvested: ") and reason in said
    assert is_sentence(said)


def test_a_supply_that_stays_off_beside_a_load_is_told():
    said = remark({"kind": "rectifier", **SIDE, "storage": STORE | {"turn_off": 40.0}})
    assert said.startswith("the supply is not on, whose turn_on is 50 V: the dc voltage is ") and is_sentence(said)
    assert remark({"kind": "rectifier", **SIDE, "storage": {"turn_on": 2.0, "turn_off": 1.0, "power": 1e-9}}) == ""


@pytest.mark.parametrize(
    "table",
    [
        {"kind": "rectifier", **SIDE},
        {"kind": "sece", "diode_drop": 0.2},
        {"kind": "short"},
        {"kind": "ssdi", **COIL},
        {"kind": "self_powered_ssdi", **BREAKER, "diode_drop": 40.0},
    ],
)
def test_no_reason_is_needed(table):
    assert "nothing is harvested" not in remark(table)


def test_the_amplitude_is_that_of_the_electrodes():
    """Open electrodes: v = T x/C behind the stiffness that the clamped capacitance adds."""
    m, b, k, t, c = (BENCH[key] for key in ("mass", "damping", "stiffness", "coupling", "capacitance"))
    w = 2 * math.pi * DRIVE.frequency
    opened = t / c * DRIVE.amplitude / abs(k + t * t / c - m * w * w + 1j * w * b)
    assert f"an amplitude of {opened:.4g} V" in remark({"kind": "rectifier", "dc_voltage": 50.0})
