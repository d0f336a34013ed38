"""Standard errors of averages under noise: against the scatter of other realisations, and where there are none."""

import json
from dataclasses import replace

import numpy as np
import pytest

from piezoharvest.cli import main
from piezoharvest.description.excitation import RandomForce, Record, SineForce, StepForce
from piezoharvest.description.shunts import SECE, Resistor
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine import simulate

BENCH = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
NOISE = RandomForce(psd=1e-6, band=(30.0, 80.0), duration=20.0, seed=1)


@pytest.mark.parametrize(
    ("shunt", "count"), [(Resistor(resistance=8e4), 40), pytest.param(SECE(), 100, marks=pytest.mark.slow)]
)
def test_scatter_of_realisations(shunt, count):
    """Within four errors of a standard deviation from so many."""
    found = [simulate(System(BENCH, shunt), replace(NOISE, seed=n), attenuation=False) for n in range(count)]
    for name in ("harvested_power", "displacement_rms"):
        values, told = np.array([(getattr(r, name), r.standard_error[name]) for r in found]).T
        scatter = np.std(values, ddof=1) / np.sqrt(np.mean(told**2))
        assert scatter == pytest.approx(1.0, abs=4 / np.sqrt(2 * (count - 1)))


def test_averages_are_those_of_one_run():
    """Running from edge to edge changes nothing; the rms is that of the waveform."""
    response = simulate(System(BENCH, SECE()), NOISE, attenuation=False)
    w = response.waveforms
    assert response.displacement_rms == pytest.approx(np.std(w.displacement), rel=1e-12)
    assert response.energy["harvested"] / response.period == pytest.approx(response.harvested_power, rel=1e-12)
    assert response.energy["closure"] < 1e-10


def test_a_longer_run_is_surer():
    short, long = (
        simulate(System(BENCH, Resistor(resistance=8e4)), replace(NOISE, duration=d), attenuation=False)
        for d in (20.0, 160.0)
    )
    assert long.standard_error["harvested_power"] < 0.5 * short.standard_error["harvested_power"]


def test_a_record_has_them_too(tmp_path):
    path = tmp_path / "force.csv"
    values = NOISE.signal().at(np.arange(20_000) / 1000.0)
    np.savetxt(path, values, header="force_N", comments="")
    record = Record(file=str(path), column="force_N", sample_rate=1000.0)
    found = simulate(System(BENCH, Resistor(resistance=8e4)), record, attenuation=False)
    assert 0 < found.standard_error["harvested_power"] < found.harvested_power


def test_none_where_nothing_is_random_or_too_short():
    system = System(BENCH, Resistor(resistance=8e4))
    for excitation in (SineForce(amplitude=0.02, frequency=50.0), StepForce(amplitude=1.0, duration=0.5)):
        response = simulate(system, excitation, attenuation=False)
        assert response.standard_error is None and response.displacement_rms is None
    brief = simulate(system, replace(NOISE, duration=1.0), attenuation=False)
    assert np.isnan(brief.standard_error["harvested_power"]) and brief.displacement_rms > 0


def test_command_line(tmp_path, capsys):
    path = tmp_path / "study.toml"
    path.write_text("""
transducer = { mass = 0.01, damping = 0.0628, stiffness = 986.96, coupling = 1e-3, capacitance = 40e-9 }
excitation = { kind = "random_force", psd = 1e-6, band = [30, 80], duration = 20, seed = 1 }
shunts = [{ kind = "resistor", resistance = 8e4 }]
""")
    assert main(["simulate", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["results"][0]
    assert 0 < found["standard_error"]["displacement_rms"] < found["displacement_rms"]
    assert main(["simulate", str(path)]) == 0
    assert "standard" in capsys.readouterr().out
