"""Effects that show by their squares: small ones are told without a sign, large ones with it."""

from dataclasses import replace
from pathlib import Path

import pytest

from piezoharvest.bench import measure, write_campaign
from piezoharvest.description.effects import OnTimeOffset
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.scanning.signs import OtherSign, better_signs, turned
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.parameters import Parameter, parameters_of
from piezoharvest.records import load_campaign
from piezoharvest.study import study_from

BEAM = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1e-3, "capacitance": 40e-9}
SHUNT = {"kind": "ssdi", "inductance": 0.5, "quality": 5.0, "hold_off": 4e-3}
SENSORS = {
    "load_cell": {"sensitivity": 100.0, "noise": 2e-5},
    "laser": {"sensitivity": 5e3, "resolution": 0.0, "noise": 3e-7},
    "buffer": {"gain": 0.05, "noise": 0.02},
}


def fitted(error, folder):
    """Records of the bench, whose solver is its own, and the fit that begins at the true sign of the offset."""
    tables = {
        "transducer": BEAM, "shunts": [SHUNT],
        "excitation": {"kind": "sine_force", "amplitude": 0.02, "frequency": 49.0},
        "bench": {
            "sample_rate": 4000.0, "duration": 0.2, "seed": 3, "channels": ["displacement", "voltage"], **SENSORS,
            "effects": {"on_time_offset": {"on_time_error": error}},
        },
    }  # fmt: skip
    path = write_campaign(measure(study_from(tables, Path("study.toml"))), folder)
    campaign = load_campaign(path)
    problem = Problem(prepared(campaign, "fit"), campaign.transducer, ("displacement",))
    device = replace(campaign.transducer, effects=(OnTimeOffset(on_time_error=error),))
    strength = Parameter(("effects", 0, "on_time_error"), "", "linear", -1.0, float("inf"))
    model = Model(device, (*parameters_of(campaign.transducer, {"force"}), strength), ("displacement",))
    return problem, fit(problem, model, rounds=2)


@pytest.mark.parametrize("error", [0.02, pytest.param(-0.3, marks=pytest.mark.slow)])
def test_the_sign_of_a_small_offset_is_open_and_that_of_a_large_one_told(error, tmp_path):
    """At 2 % records of a tenth of a second do not tell it, at 30 % the other sign is off by 3e5 in -2 ln L."""
    problem, found = fitted(error, tmp_path)
    other = turned(problem, found, 0)
    best, others = better_signs(problem, found)
    value = best.model.transducer.effects[0].on_time_error
    if abs(error) > 0.1:
        assert not others
        assert value == pytest.approx(error, rel=0.2)
        assert other is None or other.cost > found.cost + thresholds.CLOSE_COST
        return
    assert other is not None
    assert best.cost == min(found.cost, other.cost)
    (told,) = others.values()
    assert value * told.value < 0.0
    assert abs(best.cost - max(found.cost, other.cost)) < thresholds.CLOSE_COST
    assert abs(told.value) == pytest.approx(abs(value), rel=0.1)
    assert told.probability > 0.1  # 0.34 here: the wrong sign is the likelier one by chance
    spread = told.spread(value, 0.0)
    assert min(value, told.value) < 0.0 < value + 2.0 * spread
    assert value - 2.0 * spread < 0.0


def test_the_standard_error_of_two_values_that_are_as_likely_is_that_of_the_pair():
    assert OtherSign(-0.02, 0.5).spread(0.02, 0.0) == pytest.approx(0.04 / 2**0.5)
    assert OtherSign(-0.02, 0.0).spread(0.02, 0.003) == pytest.approx(0.003)
