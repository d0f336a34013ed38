"""An imposed displacement behind diodes and switches: the structure's equation drops out, its motion is the drive."""

import re
from pathlib import Path

import numpy as np
import pytest
from records_bench.bench_runs import waves
from selection import with_slow
from studies import BENCH, DRIVE, STOPS, bench, objects

from piezoharvest.bench import measure, write_campaign
from piezoharvest.identify import identify
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.setting import circuit_setting
from piezoharvest.predict.parameters import parameters_of, put, value_at
from piezoharvest.records import CampaignError, load_campaign
from piezoharvest.records.gate import Edges
from piezoharvest.study import study_from

DC = {"smoothing_capacitance": 1e-7, "load_resistance": 3e5, "diode_drop": 0.3}
COIL = {"inductance": 0.1, "quality": 5.0}
CIRCUITS = {
    "rectifier": {"kind": "rectifier", **DC},
    "parallel_sshi": {"kind": "parallel_sshi", **COIL, **DC},
    "sece": {"kind": "sece"},
    "ssdi": {"kind": "ssdi", **COIL},
}
NAMES = ("voltage", "current", "force")


@pytest.mark.parametrize("hysteresis", [{}, {"hysteresis": STOPS}], ids=["plain", "hysteresis"])
@pytest.mark.parametrize("circuit", with_slow(CIRCUITS, slow=lambda name: name in ("sece", "ssdi")))
def test_against_the_bench(circuit, hysteresis):
    """Radau IIA under a force; what it moves is imposed on the engine. Derivatives against central differences."""
    wanted = waves(DRIVE, CIRCUITS[circuit], {**BENCH, **hysteresis}, length=0.1, rate=10000.0)
    system, _ = objects(bench(CIRCUITS[circuit], **hysteresis))
    device = system.transducer
    gate = None if wanted.pulses is None else Edges(np.array([closed for closed, _ in wanted.pulses]), 0.0)
    setting = circuit_setting("displacement", system.shunt, 1e-4, wanted.displacement, device, gate=gate)
    parameters = [p for p in parameters_of(device, {"displacement"}) if p.name != "mass"]
    start = 0.1 * np.ones(len(setting.free) + len(hysteresis and STOPS["weights"]))

    def values(device=device, start=None, parameters=()):
        (block,) = CircuitPrediction(device, setting, parameters, start).blocks(bool(parameters), channels=NAMES)
        return block.values, block.derivatives

    force = wanted.drive - device.mass * wanted.acceleration
    for column, true in zip(values()[0].T, (wanted.voltage, wanted.current, force), strict=True):
        assert np.mean(np.abs(column - true) <= 1e-6 * np.abs(true).max()) > 0.97
    base, slopes = values(start=start, parameters=parameters)
    for k, parameter in enumerate(parameters):
        inner = parameter.inner(value_at(device, parameter.path))
        step = 1e-6 * (1.0 if parameter.scaling == "log" else abs(inner))
        upper, lower = (
            values(put(device, parameter.path, float(np.real(parameter.outer(inner + sign * step)))), start)[0]
            for sign in (1.0, -1.0)
        )
        difference = (upper - lower) / (2.0 * step)
        # Rounding, 1e-13 of the values, over the step is 1e-7 of them.
        size = np.abs(difference).max(axis=0) + 1e-2 * np.abs(base).max(axis=0) * 1e-6 / step
        close = np.abs(slopes[:, :, k] - difference) <= 5e-5 * size
        assert np.all(close.mean(axis=0) > 0.93), (parameter.name, close.mean(axis=0))


def campaign(folder, shunt, channels=()):
    """The force is no channel here: on this bench it has to accelerate the mass, too."""
    sensors = {
        "load_cell": {"sensitivity": 30.0, "noise": 2e-5}, "buffer": {"gain": 0.2, "noise": 0.02},
        "laser": {"sensitivity": 5e3, "resolution": 0.0, "noise": 3e-7},
    }  # fmt: skip
    settings = {
        "sample_rate": 4000.0, "duration": 0.15, "seed": 1, "nominal_error": 0.03,
        "channels": ["displacement", "voltage", *channels], **sensors, "records": [{}],
    }  # fmt: skip
    drive = {"kind": "sine_force", "amplitude": 0.03, "frequency": 50.6}
    tables = {"transducer": BENCH, "excitation": drive, "shunts": [shunt], "bench": settings}
    path = write_campaign(measure(study_from(tables, Path("study.toml"))), Path(folder) / "campaign")
    text = re.sub(r"\[channels\.force\]\n(?:[^\[\n]+\n)*|force = \{[^\n]*\n", "", path.read_text())
    path.write_text(text.replace('drive = "force"', 'drive = "displacement"'))
    for file in path.parent.glob("*.csv"):
        file.write_text(file.read_text().replace("force_N", "other"))
    return load_campaign(path)


@pytest.mark.parametrize(
    ("circuit", "channels"), [("rectifier", ()), pytest.param("parallel_sshi", ("gate",), marks=pytest.mark.slow)]
)
def test_values(tmp_path, circuit, channels):
    found = identify(campaign(tmp_path, CIRCUITS[circuit], channels))
    known = {e.parameter.name: (e.value - BENCH[e.parameter.name]) / e.std for e in found.estimates if e.std}
    assert found.converged and set(known) == {"coupling", "capacitance"}
    assert max(map(abs, known.values())) < 3.0, known


def test_a_switch_needs_a_gate(tmp_path):
    read = campaign(tmp_path, CIRCUITS["ssdi"])
    message = r"records\.0\.drive: found an imposed displacement behind ssdi, .* it needs a channel gate"
    with pytest.raises(CampaignError, match=message):
        identify(read)
