"""What a design gives back: order, JSON, notes, what is left out and what is refused."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from piezoharvest.description.excitation import SineForce, StepForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import SSDV, Network, ParallelSSHI, Rectifier, Resistor
from piezoharvest.description.system import System
from piezoharvest.engine import simulate
from piezoharvest.study import build_shunt, load_study


@pytest.fixture(scope="module")
def bench():
    from piezoharvest.description.transducer import Transducer

    return Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)


def test_default_is_to_harvest_with_every_kind_that_can(bench, run):
    told = []
    result = run(bench, 50.6, progress=told.append)
    kinds = [c.shunt.kind for c in result.candidates]
    assert sorted(kinds) == sorted(
        ["resistor", "series_rl", "parallel_rl", "series_rlc", "parallel_rlc", "rectifier", "parallel_sshi",
         "series_sshi", "sece", "half_wave", "doubler", "sshc", "bias_flip", "sice", "sc_sece", "dssh", "essh",
         "mppt", "self_powered_sshi", "self_powered_series_sshi", "self_powered_sece"]
    )  # fmt: skip
    powers = [c.harvested_power for c in result.candidates]
    assert powers == sorted(powers, reverse=True)
    assert max(powers) <= 0.02**2 / (8 * bench.damping) * (1 + 1e-9)
    assert result.converged and result.best is result.candidates[0]
    assert all(isinstance(text, str) for text in told) and any("rectifier" in text for text in told)
    assert any("left out: network" in note for note in result.notes)


def test_damping_with_every_kind_that_fits(bench, run):
    template = SSDV(quality=6.0, flip_time=4e-4, source_voltage=0.5)
    result = run(bench, 50.6, objective="damping", shunts=[template])
    kinds = {c.shunt.kind for c in result.candidates}
    linear = {"resistor", "series_rl", "parallel_rl", "series_rlc", "parallel_rlc"}
    assert kinds == {*linear, "ssds", "ssdi", "ssdv", "self_powered_ssdi"}
    heights = [c.displacement_amplitude for c in result.candidates]
    assert heights == sorted(heights)


def test_json_is_the_interface(bench, run):
    result = run(bench, 50.6, candidates=("resistor", "parallel_sshi"))
    data = json.loads(json.dumps(result.as_json(), allow_nan=False))
    assert set(data) >= {"bound", "candidates", "best", "trade_off"}
    assert data["bound"]["harvested_power"] == pytest.approx(data["bound"]["any_interface"])
    assert data["bound"]["attenuation_db"] is None
    assert data["best"] == 0 and data["trade_off"] == []
    for entry, candidate in zip(data["candidates"], result.candidates, strict=True):
        assert set(entry) >= {"shunt", "harvested_power", "attenuation_db", "gap_to_bound", "converged", "violates"}
        assert 0 < entry["gap_to_bound"] < 1 and entry["violates"] == []
        # The shunt is a table that a study takes as it is, and simulates to the same figures.
        assert build_shunt(entry["shunt"]) == candidate.shunt
        again = simulate(System(bench, build_shunt(entry["shunt"])), SineForce(amplitude=0.02, frequency=50.6))
        assert entry["harvested_power"] == pytest.approx(again.harvested_power, rel=1e-6)
        assert entry["attenuation_db"] == pytest.approx(again.attenuation_db, abs=1e-6)


def test_network_and_its_table(bench, run):
    network = Network(netlist=["R1 1 2 100k load=true", "L1 2 0 200"])
    result = run(bench, 50.6, shunts=[network], candidates=("network", "resistor"))
    entry = next(c for c in result.as_json()["candidates"] if c["shunt"]["kind"] == "network")
    assert build_shunt(json.loads(json.dumps(entry["shunt"]))) == network
    assert any("200 H" in note and "synthetic" in note for note in result.notes)


def test_infeasible_candidates_come_after_feasible_ones(bench, run):
    kinds = ("sece", "rectifier", "resistor")
    result = run(bench, 50.6, candidates=kinds, max_voltage=10.0, phase_lag="fixed")
    assert [c.feasible for c in result.candidates] == [True, True, False]
    last = result.candidates[-1]
    assert last.shunt.kind == "sece" and last.violates == ("max_voltage",)
    assert last.harvested_power > result.best.harvested_power
    assert result.as_json()["candidates"][-1]["violates"] == ["max_voltage"]
    assert any("sece: does not meet max_voltage" in note for note in result.notes)


def test_template_beyond_the_largest_inductance(bench, run):
    template = ParallelSSHI(load_resistance=1e5, smoothing_capacitance=1e-5, quality=5.0, inductance=0.5)
    best = run(bench, 50.6, shunts=[template], candidates=("parallel_sshi",), max_inductance=0.1).best
    assert best.violates == ("max_inductance",) and best.shunt.inductance == 0.5


def test_templates_of_one_kind(bench, run):
    """One candidate for each that differs in what is kept."""
    shunts = [
        Rectifier(load_resistance=1e5, smoothing_capacitance=1e-5, diode_drop=drop) for drop in (0.0, 0.5, 0.5)
    ] + [dataclasses.replace(Rectifier(load_resistance=2e5, smoothing_capacitance=1e-5)), Resistor(resistance=1.0)]
    result = run(bench, 50.6, shunts=shunts, candidates=("rectifier", "resistor"))
    assert [c.shunt.kind for c in result.candidates].count("rectifier") == 2
    assert {c.shunt.diode_drop for c in result.candidates if c.shunt.kind == "rectifier"} == {0.0, 0.5}


def test_kinds_that_cannot_be_assumed(bench, run):
    result = run(bench, 50.6, candidates=("network", "resistor"))
    assert [c.shunt.kind for c in result.candidates] == ["resistor"]
    assert any(note.startswith("left out: network") for note in result.notes)
    with pytest.raises(ParameterError, match=r"no candidate can be designed \(network, whose netlist"):
        run(bench, 50.6, candidates=("network",))


def test_nothing_drives_it(bench, run):
    with pytest.raises(ParameterError, match="excitation"):
        run(bench, 50.6, amplitude=0.0, candidates=("resistor",))


def test_step(bench, run):
    """Without a period the objective is the mean over a transient."""
    step = StepForce(amplitude=0.2, duration=1.0, rise_time=1e-3)
    result = run(bench, excitation=step, candidates=("resistor", "rectifier", "sece"))
    assert all(c.converged and c.harvested_power > 0 for c in result.candidates)
    best = next(c for c in result.candidates if c.shunt.kind == "resistor")
    loads = best.shunt.resistance * np.array([0.5, 0.8, 1.25, 2.0])
    for load in loads:
        assert simulate(System(bench, Resistor(resistance=load)), step).harvested_power < best.harvested_power


def test_from_a_file(tmp_path):
    from piezoharvest.design import design

    path = tmp_path / "study.toml"
    path.write_text(
        '[transducer]\ncatalogue = "NAC2125-H10"\n[excitation]\nkind = "sine_force"\namplitude = 1000\nfrequency = 50\n'
        '[design]\ncandidates = ["resistor", "rectifier", "series_rl"]\nmax_inductance = 1.0\n'
    )
    result = design(load_study(Path(path)))
    assert result.converged and all(c.feasible for c in result.candidates)
