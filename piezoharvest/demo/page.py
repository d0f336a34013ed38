"""The page of the story: a self-contained HTML file, with its figures as PNG files beside it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from piezoharvest.demo.figures import pictures
from piezoharvest.demo.story import STEPS, Story
from piezoharvest.diagnose.summary import sentence, values
from piezoharvest.output import write_text
from piezoharvest.report.figures.pictures import place_pictures
from piezoharvest.report.frame.rendering import page
from piezoharvest.report.frame.report_folder import NAME, report_folder
from piezoharvest.report.subjects import subjects_of
from piezoharvest.report.units import NONE, engineering, kind_name, percent, response_unit, with_error

SECTIONS = ("wrong", "gain")
_DOUBT = "Not to be trusted: a simulation or the fit behind this did not converge."


def write_story(story: Story, directory: Path) -> Path:
    """Write the page, last of all files in the directory, and return its path; raises `OutputError`."""
    with report_folder(directory) as folder:
        figures = place_pictures(pictures(story), SECTIONS, folder)
        text = page(
            "story.html.j2",
            title=story.study.title,
            answer=answer(story),
            warning="" if story.converged else _DOUBT,
            cards=list(_cards(story)),
            ranking=list(_ranking(story)),
            circuit=kind_name(story.designed.shunt.kind),
            designed=engineering(story.designed.harvested_power, "W"),
            measured=engineering(story.first.power, "W"),
            missing=percent(-_change(story.first.power, story.designed.harvested_power)),
            sentence=sentence(story.found),
            causes=list(_causes(story)),
            parameters=list(_parameters(story)),
            predictions=list(_predictions(story)),
            residuals=list(_residuals(story)),
            changes=list(_changes(story)),
            powers=list(_powers(story)),
            steps=STEPS,
            figures=figures,
        )
        write_text(text, folder / NAME)
    return Path(directory) / NAME


def _change(new: float, old: float) -> float:
    return new / old - 1.0


def _signed(share: float) -> str:
    """Relative change with its sign; a small one to its first digit."""
    size = abs(share)
    sign = "" if size < 1e-4 else "+" if share > 0.0 else "\u2212"  # of less only its size is told
    return sign + percent(size, 3 if size >= 0.1 else 2 if size >= 0.01 else 1)


def _named(story: Story) -> str:
    return " and ".join(named.effect.name.replace("_", " ") for named in story.found.effects) or "no known effect"


def answer(story: Story) -> str:
    """The story in a few sentences."""
    gained = _change(story.second.power, story.first.power)
    return (
        f"Designed for {engineering(story.designed.harvested_power, 'W')}, the {kind_name(story.designed.shunt.kind)} "
        f"gave {engineering(story.first.power, 'W')} on the virtual bench. The cause is {_named(story)}. Designed "
        f"again with this cause, the circuit gives {engineering(story.second.power, 'W')}, measured: {_signed(gained)}."
    )


def _cards(story: Story) -> Iterator[tuple[str, str, str]]:
    first, second = story.first.power, story.second.power
    missing = _change(first, story.designed.harvested_power)
    yield "first design, measured", engineering(first, "W"), f"{_signed(missing)} relative to its simulation"
    for named in story.found.effects:
        remark = f"removes {percent(named.gain)} of the error of a record that was not fitted"
        yield "cause", named.effect.name.replace("_", " "), remark
    predicted = story.extended.harvested_power
    remark = f"{_signed(_change(predicted, first))} relative to the measurement"
    yield "predicted with the cause", engineering(predicted, "W"), remark
    gained = _change(second, first)
    yield "second design, measured", engineering(second, "W"), f"{_signed(gained)} relative to the first"


def _ranking(story: Story) -> Iterator[tuple[str, ...]]:
    """Candidates of the first design, best first: label, power, and what of the bound of linear shunts it is."""
    bound = story.design.bound.harvested_power
    for subject in subjects_of(story.design.candidates):
        power = subject.candidate.harvested_power
        yield subject.label, engineering(power, "W"), percent(power / bound) if bound else NONE


def _causes(story: Story) -> Iterator[dict[str, Any]]:
    for named in story.found.effects:
        yield {
            "name": named.effect.name.replace("_", " "),
            "doc": (type(named.effect).__doc__ or "").split("\n")[0].replace("`", ""),
            "looks": named.effect.looks, "told_by": named.effect.told_by, "gain": percent(named.gain),
            "values": [
                (name.replace("_", " "), value if isinstance(value, str) else with_error(value, std, unit))
                for name, (value, std, unit) in values(named).items()
            ],
        }  # fmt: skip


def _parameters(story: Story) -> Iterator[tuple[str, ...]]:
    """Name, value of the data sheet, and identified values without the cause and with it."""
    for before, after in zip(story.found.before.estimates, story.found.estimates, strict=True):
        name, unit = after.parameter.name, after.parameter.unit
        given = engineering(getattr(story.study.transducer, name, None), unit)
        yield name, given, *(with_error(one.value, one.std, unit) for one in (before, after))


def _predictions(story: Story) -> Iterator[tuple[str, ...]]:
    """What predicts the first measurement, its power, and the error."""
    for name, power in (
        ("the design, from the data sheet", story.designed.harvested_power),
        ("the original model, fitted to the campaign", story.fitted.harvested_power),
        ("the model with the cause, fitted to the campaign", story.extended.harvested_power),
    ):
        yield name, engineering(power, "W", 4), _signed(_change(power, story.first.power))


def _residuals(story: Story) -> Iterator[tuple[str, ...]]:
    """Of the record that was not fitted: channel, residual without and with the cause, and its noise."""
    before, after = story.found.validation_before, story.found.validation_after
    for channel, noise in after.noise.items():
        sizes = (before.rms[channel], after.rms[channel], noise)
        yield channel.replace("_", " "), *(engineering(size, response_unit(channel)) for size in sizes)


def _changes(story: Story) -> Iterator[tuple[str, ...]]:
    """What is set otherwise in the second circuit: name, before and after."""
    shunts: list[Any] = [story.first.shunt, story.second.shunt]
    capacitance = story.study.transducer.capacitance
    yield "load", *(engineering(shunt.load_resistance, "ohm") for shunt in shunts)
    yield "switch acts after the extremum by", *(engineering(shunt.time_lag, "s") for shunt in shunts)
    yield "switch is commanded to stay closed for", *(engineering(shunt.on_time(capacitance), "s") for shunt in shunts)


def _powers(story: Story) -> Iterator[tuple[str, ...]]:
    for name, simulated, look in (
        ("first", story.designed.harvested_power, story.first),
        ("second", story.redesigned.harvested_power, story.second),
    ):
        off = _signed(_change(look.power, simulated))
        yield name, engineering(simulated, "W", 4), engineering(look.power, "W", 4), off
