"""The Python scripts that come with the project: they run in a short form, and say what their READMEs say."""

import runpy
from pathlib import Path

import numpy as np
import pytest

DESIGNS = Path(__file__).parents[2] / "designs"
SCRIPTS = sorted(DESIGNS.glob("*/*.py"))


def run(name, out):
    return runpy.run_path(str(DESIGNS / name))["main"](out, short=True)


def test_every_script_has_a_page_that_says_how_to_run_it():
    assert len(SCRIPTS) >= 3
    for script in SCRIPTS:
        text = (script.parent / "README.md").read_text(encoding="utf-8")
        assert f"python designs/{script.parent.name}/{script.name}" in text


@pytest.mark.slow
def test_hysteresis_that_is_ignored_costs_most_at_small_forces(tmp_path):
    found = run("hysteresis-map/hysteresis_map.py", tmp_path)
    assert (tmp_path / "hysteresis_map.png").stat().st_size > 10_000
    for circuit in ("resistor", "rectifier"):
        lost = found[f"{circuit}: lost"]
        assert 0.5 < lost[0] < 0.9
        assert 0 <= lost[-1] < 0.02
        assert found[f"{circuit}: overestimated"][-1] == pytest.approx(1.32, abs=0.02)


@pytest.mark.slow
def test_timing_counts_with_weak_coupling_and_hardly_with_strong(tmp_path):
    found = run("sshi-timing/timing.py", tmp_path)
    assert (tmp_path / "timing.png").stat().st_size > 10_000
    assert found["weak quality 20"] > 1.2 > 1.01 > found["strong quality 20"]
    assert found["weak lag +0.6"] < 0.85 < 0.95 < found["strong lag +0.6"]
    assert found["weak jitter 0.2"] == pytest.approx(0.98, abs=0.015)


def test_which_harvester_a_recorded_vibration_wants(tmp_path):
    script = runpy.run_path(str(DESIGNS / "recorded-vibration/which_harvester.py"))
    kept = np.loadtxt(script["FILE"], delimiter=",", skiprows=1)[:, 1]
    assert kept == pytest.approx(script["machine"](), abs=6e-6)
    found = script["main"](tmp_path, short=True)
    assert (tmp_path / "which_harvester.png").stat().st_size > 10_000
    best = {name: max(powers.values()) for name, powers in found.items()}
    assert max(best, key=best.get) == "well coupled, 48 Hz"


def test_loads_of_the_stack_are_those_of_the_readme(tmp_path):
    found = run("stack-load/choose_load.py", tmp_path)
    assert (tmp_path / "choose_load.png").stat().st_size > 10_000
    for frequency, (load, _) in found.items():
        assert load * frequency == pytest.approx(37.6e3, rel=2e-3)


def test_bode_diagram_of_python_control_is_that_of_the_simulation(tmp_path):
    found = run("bench-rectifier-or-sshi/bode_efficiency.py", tmp_path)
    assert (tmp_path / "bode_efficiency.png").stat().st_size > 10_000
    assert found["simulation against python-control"] < 1e-9
    assert found["series RL 241 H, 38.7 kΩ"] < 0.3 * found["shorted"]


@pytest.mark.slow
def test_a_branch_for_each_of_three_modes(tmp_path):
    found = runpy.run_path(str(DESIGNS / "three-modes/three_modes.py"))["main"](tmp_path)
    assert (tmp_path / "three_modes.png").stat().st_size > 10_000
    assert max(found["parallel_branches"]) == pytest.approx(-14.7, abs=0.1)
    assert max(found["series_rl"]) > -5


@pytest.mark.slow
def test_a_harvester_that_falls_short_is_designed_again(tmp_path):
    found = run("sshi-falls-short/falls_short.py", tmp_path)
    assert (tmp_path / "falls_short.png").stat().st_size > 10_000
    # A relaxation of 10 nF beside the film's capacitance, with 2 ms, by what it does to an inversion.
    assert list(found["effects"]) == ["voltage_reversion"]
    reversion = found["effects"]["voltage_reversion"]
    assert reversion["share"] == pytest.approx(1e-8 / (1e-8 + 39e-9), rel=0.02)
    assert reversion["time_constant"] == pytest.approx(2e-3 * (1.0 - reversion["share"]), rel=0.02)
    assert all(found["rms after"][channel] < 1.1 * noise for channel, noise in found["noise"].items())
    first, second = found["measured"]
    assert second > 1.15 * first
    assert found["predicted"]["fitted with the cause"] == pytest.approx(first, rel=0.01)
    assert found["predicted again"] == pytest.approx(second, rel=0.01)
    assert abs(found["predicted"]["fitted as it was"] / first - 1) > 0.3
    page = (DESIGNS / "sshi-falls-short/README.md").read_text(encoding="utf-8")
    for power in found["measured"]:
        assert f"{1e6 * power:.1f} µW" in page
    for load in found["loads"]:
        assert f"{1e-3 * load:.0f} kΩ" in page
