"""A load cell whose noise is larger than that of all other sensors: what it says of the drive is not what drove it."""

from pathlib import Path

import pytest

from piezoharvest.diagnose import diagnose
from piezoharvest.effects import registered
from piezoharvest.records import load_campaign
from piezoharvest.records.bench import measure, write_campaign
from piezoharvest.study import study_from

STACK = {
    "mass": 0.0158, "damping": 1250.0, "stiffness": 3.125e8, "coupling": 7.822, "capacitance": 3.2e-6,
    "hysteresis": {"thresholds": [0.1e-6, 0.3e-6, 0.7e-6], "weights": [0.5e6, 1.5e6, 0.5e6]},
}  # fmt: skip
STEP = {"kind": "step_force", "amplitude": 900.0, "offset": 100.0, "duration": 1.0, "rise_time": 0.001}
SLOW = {**STEP, "rise_time": 0.05}
RECORDS = [
    {"load_resistance": 10e3, "excitation": STEP},
    {"load_resistance": 97.78e3, "excitation": SLOW},
    {"load_resistance": 51.43e3, "excitation": {"frequency": 3.0}},
    {"load_resistance": 143.8e3, "excitation": {"amplitude": 200.0, "offset": 300.0}},
    {"load_resistance": 97.78e3, "role": "validate"},
]
# Noise of the load cell moves the stack by 16 nm, five times what the sensor of displacement has.
NOISY = {"load_cell": {"noise": 5.0}, "laser": {"noise": 3e-9, "resolution": 0.0, "sensitivity": 1e6}}


def noisy(folder, seed, effects=None):
    tables = {
        "transducer": STACK, "shunts": [{"kind": "resistor", "resistance": 97.78e3}],
        "excitation": {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 4.0},
        "bench": {
            "duration": 4.0, "seed": seed, "nominal_error": 0.1, "records": RECORDS, "effects": effects or {}, **NOISY,
        },
    }  # fmt: skip
    return load_campaign(write_campaign(measure(study_from(tables, Path("study.toml"))), Path(folder) / "campaign"))


@pytest.mark.parametrize("effects", [{}, {"leakage": {"resistance": 1e6}}], ids=["healthy", "leakage"])
def test_noise_of_the_drive_is_no_effect_and_hides_none(tmp_path, effects):
    found = diagnose(noisy(tmp_path, 3, effects))
    assert [named.effect.name for named in found.effects] == list(effects)
    assert found.verdict == ("effect" if effects else "adequate")
