"""A cantilever with hysteresis whose records come near its resonance: twenty samples a period."""

from __future__ import annotations

import pytest

from piezoharvest.bench import measure, write_campaign
from piezoharvest.diagnose import diagnose
from piezoharvest.records import load_campaign
from piezoharvest.study import load_study

STUDY = """
[transducer]
catalogue = "Erturk-Inman-2008-unimorph"

[transducer.hysteresis]
thresholds = [2e-9, 8e-9, 3e-8]
weights = [6e5, 4e5, 2e5]

[excitation]
kind = "sine_force"
amplitude = 0.1
frequency = 5.0

[[shunts]]
kind = "resistor"
resistance = 42e3

[bench]
sample_rate = 1000.0
duration = 2.0
seed = 3
nominal_error = 0.1
load_cell = { sensitivity = 40.0, noise = 2e-5 }
laser = { sensitivity = 3000.0, noise = 2e-7, resolution = 1e-8 }
buffer = { gain = 0.5 }
"""
RECORDS = """
[[bench.records]]
load_resistance = 20e3
excitation = { kind = "step_force", amplitude = 0.1, duration = 1.0, rise_time = 0.05 }

[[bench.records]]
excitation = { frequency = 44.0, amplitude = 0.03 }
role = "validate"

[[bench.records]]
load_resistance = 100e3
excitation = { frequency = 48.0, amplitude = 0.02 }

# It comes upon a specimen at rest.
[[bench.records]]
load_resistance = 100e3
[bench.records.excitation]
kind = "multisine"
amplitudes = [0.02, 0.02, 0.015, 0.01, 0.01, 0.02]
frequencies = [0.7, 3.1, 12.3, 31.7, 46.3, 71.9]
phases = [0.3, 1.9, 4.1, 2.2, 5.6, 0.9]
duration = 2.0
"""


def found(folder, effects=""):
    """Diagnosis of a campaign."""
    study = folder / "study.toml"
    study.write_text(STUDY + effects + RECORDS)
    return diagnose(load_campaign(write_campaign(measure(load_study(study)), folder / "campaign")))


@pytest.mark.slow
def test_a_healthy_cantilever_raises_no_alarm(tmp_path):
    result = found(tmp_path)
    assert result.verdict == "adequate", [place.where for place in result.left]
    assert not result.effects


@pytest.mark.slow
def test_a_sensor_that_lags_by_a_thousandth_of_a_sample_is_named(tmp_path):
    """Fits with the lag began a record in motion by a leap of the reading: they ended far above those without it."""
    result = found(tmp_path, "effects = { displacement_lag = { time_constant = 1e-6 } }\n")
    assert result.verdict == "effect"
    (named,) = result.effects
    assert named.effect.name == "displacement_lag"
    value, std, _ = named.values["time_constant"]
    assert value == pytest.approx(1e-6, abs=4 * std)
