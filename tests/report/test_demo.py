"""The story of the demo, in a short form: what it claims is so, and its page says it."""

import dataclasses
import html
import re
from functools import partial
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from piezoharvest.cli import main
from piezoharvest.demo import story as story_module
from piezoharvest.demo.page import write_story
from piezoharvest.demo.story import STEPS, tell
from piezoharvest.description.effects import DielectricRelaxation, OnTimeOffset
from piezoharvest.design import design
from piezoharvest.diagnose import diagnose
from piezoharvest.engine import simulate
from piezoharvest.report.units import engineering
from piezoharvest.specimen import load_specimen
from piezoharvest.study import load_study, read_toml

SHIPPED = resources.files("piezoharvest").joinpath("demo")
RIVALS = (OnTimeOffset, DielectricRelaxation)  # the cause, and what is most like it


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """The story with few effects to look for, and its page."""
    folder = tmp_path_factory.mktemp("demo")
    study = folder / "study.toml"
    study.write_text(SHIPPED.joinpath("study.toml").read_text(encoding="utf-8"), encoding="utf-8")
    bench = read_toml(Path(str(SHIPPED.joinpath("bench.toml"))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(story_module, "diagnose", partial(diagnose, library=RIVALS))
        story = tell(study, bench, design(load_study(study)), folder, lambda text: None)
    return story, write_story(story, folder)


def check(story):
    """What the story claims."""
    assert story.converged
    assert [named.effect.name for named in story.found.effects] == ["on_time_offset"]
    assert story.found.effects[0].effect.on_time_error == pytest.approx(0.25, abs=0.005)
    assert story.found.effects[0].gain > 0.9
    before, after = story.found.validation_before, story.found.validation_after
    assert all(after.rms[channel] < 1.1 * noise for channel, noise in after.noise.items())
    assert before.rms["voltage"] > 5 * before.noise["voltage"]
    # The extended model predicts the first measurement, which the design and the model as it was do not.
    models = (story.designed, story.fitted, story.extended)
    errors = [abs(model.harvested_power / story.first.power - 1) for model in models]
    assert errors[0] > 0.2 and errors[1] > 2 * errors[2]
    assert story.second.power > 1.15 * story.first.power


def test_the_first_design_says_that_switching_pays(told):
    result = told[0].design
    assert result.converged
    assert all(candidate.feasible for candidate in result.candidates)
    by_kind = {candidate.shunt.kind: candidate.harvested_power for candidate in result.candidates}
    # What the demo is there to show: with weak coupling switching pays.
    assert by_kind["parallel_sshi"] > 2 * by_kind["rectifier"]
    assert by_kind["parallel_sshi"] > 1.5 * by_kind["resistor"]


def test_what_it_claims(told):
    story, _ = told
    check(story)
    # Looks of 1.4 s end within 0.3 % of the steady state.
    assert story.extended.harvested_power == pytest.approx(story.first.power, rel=0.01)
    assert story.redesigned.harvested_power == pytest.approx(story.second.power, rel=0.01)


def test_the_second_design_shortens_the_pulse_by_what_was_found(told):
    story, _ = told
    offset = story.found.effects[0].effect.on_time_error
    assert story.second.shunt.on_time_error == pytest.approx(-offset, abs=0.02)
    assert story.first.shunt.on_time_error == 0.0


def test_a_time_lag_in_the_place_of_the_angle_changes_nothing(told):
    story, _ = told
    with_angle, with_time = story.designed.shunt, story.first.shunt
    assert with_angle.phase_lag != 0 == with_time.phase_lag
    powers = [
        simulate(dataclasses.replace(story.study.systems[0], shunt=shunt), story.study.excitation).harvested_power
        for shunt in (with_angle, with_time)
    ]
    assert powers[1] == pytest.approx(powers[0], rel=1e-9)


def test_both_specimens_can_be_drawn_from(told):
    """Mass and stiffness are determined by their ratio only: rounding must not spoil their covariance."""
    for name in ("identified", "specimen"):
        specimen = load_specimen(told[1].parent / f"{name}.toml")
        assert np.all(np.linalg.eigvalsh(specimen.covariance / np.outer(*2 * [list(specimen.errors.values())])) > -1e-9)


def test_power_is_that_of_the_load(told):
    story, _ = told
    (file,) = Path(told[1]).parent.joinpath("measured").glob("*.csv")
    dc = np.genfromtxt(file, delimiter=",", names=True)["dc_voltage_V"]
    count = round(10 / 50.15 * 2000.0)
    assert story.first.power == pytest.approx(np.mean(dc[-count:] ** 2) / story.first.shunt.load_resistance)


def test_the_page_tells_it(told):
    story, page = told
    text = html.unescape(page.read_text(encoding="utf-8"))
    for section in ("design", "wrong", "cause", "extension", "redesign", "gain", "steps"):
        assert f'<section id="{section}">' in text
    powers = (story.designed, story.fitted, story.extended, story.redesigned)
    for watts in (*(one.harvested_power for one in powers), story.first.power, story.second.power):
        assert engineering(watts, "W") in text
    assert "on time offset" in text
    assert all(command in text for _, command in STEPS)
    assert all((page.parent / name).is_file() for name in re.findall(r'class="file">([^<]*)<', text))


def test_the_files_of_every_command_are_there(told):
    folder = told[1].parent
    for _, command in STEPS:
        file = command.split()[2]
        assert (folder / file).is_file(), command


def test_a_command_of_the_page_repeats_its_step(told, capsys, monkeypatch):
    story, page = told
    monkeypatch.chdir(page.parent)
    assert main(["simulate", "specimen_prediction.toml", "--json"]) == 0
    assert f'"harvested_power": {story.extended.harvested_power!r}'[:30] in capsys.readouterr().out


@pytest.mark.browser
@pytest.mark.parametrize("width", [500, 1280])
def test_the_page_in_a_browser(told, measured, width):
    found = measured(told[1], width)
    assert found["title"].endswith("from design to measurement and back")
    assert len(found["drawn"]) == 2
    assert all(w > 450 and h > 100 for w, h in found["drawn"])
    assert found["fetched"] == []
    assert found["wide"] <= 0


@pytest.mark.browser
def test_the_page_prints(told, browse, tmp_path):
    browse(told[1], "--no-pdf-header-footer", f"--print-to-pdf={tmp_path / 'page.pdf'}")
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "page.pdf").read_bytes())) <= 6


@pytest.mark.slow
def test_the_whole_demo(tmp_path, capsys):
    """As `piezoharvest demo` tells it: all candidates, all effects."""
    assert main(["demo", "--out", str(tmp_path / "demo")]) == 0
    page = tmp_path / "demo" / "report.html"
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == str(page)
    assert "The cause is on time offset." in lines[-2]
    for link in re.findall(r'href="([^"#:]*)"', page.read_text(encoding="utf-8")):
        assert (page.parent / link).is_file()
