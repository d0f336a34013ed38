"""The studies that come with the project: they run, and their READMEs say what comes out."""

import dataclasses
from pathlib import Path

import pytest

from piezoharvest.design import Bound, design
from piezoharvest.report.units import SPACE, decibel, engineering
from piezoharvest.study import load_study

DESIGNS = Path(__file__).parents[2] / "designs"


def readme(name):
    return (DESIGNS / name / "README.md").read_text(encoding="utf-8")


def test_every_folder_has_a_study_and_says_how_to_run_it():
    names = {path.parent.name for path in DESIGNS.glob("*/study.toml")}
    assert names >= {"stack-load", "bench-rectifier-or-sshi", "beam-damping"}
    for name in names:
        assert load_study(DESIGNS / name / "study.toml").title
        commands = (f"piezoharvest {what} designs/{name}/study.toml" for what in ("design", "measure", "sweep"))
        assert any(command in readme(name) for command in commands)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "best"),
    [("stack-load", "parallel_sshi"), ("bench-rectifier-or-sshi", "series_rl"), ("beam-damping", "ssdi")],
)
def test_readme_says_what_comes_out(name, best):
    study = load_study(DESIGNS / name / "study.toml")
    found = design(study).best
    assert found.converged
    assert found.shunt.kind == best
    damping = study.design.objective == "damping"
    figure = decibel(found.attenuation_db) if damping else engineering(found.harvested_power, "W")
    assert figure.split(SPACE)[0] in readme(name)


@pytest.mark.slow
def test_cover_gives_the_power_and_damping_of_its_page(monkeypatch):
    monkeypatch.setattr("piezoharvest.design.search.bound_of", lambda view: Bound())  # has tests of its own
    study = load_study(DESIGNS / "machine-cover" / "study.toml")
    assert "synthesised" in study.design.candidates and study.design.tolerance
    short = dataclasses.replace(study.design, candidates=("series_rl",))
    result = design(dataclasses.replace(study, design=short))
    for power in (result.best.harvested_power, result.best.worst_case.figures.harvested_power):
        assert f"{1e3 * power:.3f} mW" in readme("machine-cover")
    # The design that the page decides for is on the front.
    (chosen,) = (point for point in result.trade_off if 3e-3 < point.harvested_power < 3.1e-3)
    assert f"{1e3 * chosen.harvested_power:.2f} mW | −{-chosen.attenuation_db:.1f} dB" in readme("machine-cover")
    assert f"{chosen.shunt.inductance:.1f} H" in readme("machine-cover")
