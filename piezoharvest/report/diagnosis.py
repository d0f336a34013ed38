"""The page of a diagnosis: verdict, cause, residuals, all effects, biased parameters, remaining structure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from piezoharvest.description.effects import registered
from piezoharvest.diagnose import Diagnosis
from piezoharvest.diagnose.residual_structure.residual_tests import ResidualTest, run_tests
from piezoharvest.diagnose.residuals import Residuals, residuals, responses
from piezoharvest.diagnose.selection.effect_change import names_apart
from piezoharvest.diagnose.summary import NOT_HERE, Scored, cosines, judged_error, scored, sentence, values
from piezoharvest.output import write_text
from piezoharvest.progress import Stage, follower
from piezoharvest.report.figures import diagnosed
from piezoharvest.report.figures.identified import response_figure
from piezoharvest.report.figures.pictures import Picture, place_pictures
from piezoharvest.report.frame.rendering import page
from piezoharvest.report.frame.report_folder import NAME, report_folder
from piezoharvest.report.units import NONE, engineering, number, percent, response_unit, with_error

MAX_TEST_ROWS = 12  # rows in the table of failed residual tests
MIN_SIMILAR_COSINE = 0.7  # cosine above which two effects are hard to distinguish
MAX_P_VALUE = 1e-4  # p-value below which an effect's score is marked


def write_diagnosis(found: Diagnosis, directory: str | Path) -> Path:
    """Write the report of a diagnosis: a self-contained HTML page, and its figures as PNG files.

    Parameters
    ----------
    found : Diagnosis
    directory : str or Path
        Created if it does not exist.

    Returns
    -------
    Path
        The HTML file. An earlier report there is replaced as a whole: where a page is, it is complete.

    Raises
    ------
    OutputError
        The directory or a file in it cannot be written.
    """
    rows = scored(found, list(registered()))
    with report_folder(directory) as folder:
        figures = place_pictures(_pictures(found, rows), ("cause", "effects", "structure", "records"), folder)
        text = page(
            "diagnosis.html.j2",
            title=found.campaign.title,
            verdict=found.verdict,
            sentence=sentence(found),
            warning="" if found.search.final.converged else f"Not to be trusted: {found.search.final.message}.",
            experiment=found.experiment,
            told_by=found.told_by if found.plan is not None else None,
            named=list(_named(found)),
            laws=list(_laws(found)),
            residuals=list(_residuals(found)),
            validated=bool(found.campaign.of_role("validate")),
            unexplained=percent(found.unexplained),
            judged=judged_error(found),
            extended=found.extended,
            scores=[_score(row, found) for row in rows if row.candidate is not None],
            silent=[row.name for row in rows if row.candidate is None and row.label != NOT_HERE],
            elsewhere=[row.name for row in rows if row.candidate is None and row.label == NOT_HERE],
            parameters=list(_parameters(found)),
            alike=list(_similar_effects(rows)),
            alternatives=list(_alternatives(found)),
            left=[_test_row(place) for place in found.left[:MAX_TEST_ROWS]],
            hints=list(_hints(found)),
            warnings=[str(finding) for finding in found.campaign.warnings],
            figures=figures,
            file=found.campaign.path.name,
        )
        write_text(text, folder / NAME)
    return Path(directory) / NAME


def _pictures(found: Diagnosis, rows: Sequence[Scored]) -> Iterator[Picture]:
    changed, records = found.extended, list(residuals(found))
    for n, law in enumerate(found.discovery, 1):
        caption = "The law, with a band of three standard errors, over the range that the records cover."
        yield Picture(f"law_{n}", "cause", f"The law at the {law.place}", caption, diagnosed.law_figure(law))
    if records:
        yield from _causes(records, changed)
        caption = "Mean of the whitened residual of all records, in bins; noise alone lies within ±2."
        for channel in dict.fromkeys(channel for each in records for channel in each.data.channels):
            figure = diagnosed.where_figure(records, channel, changed)
            yield Picture(
                f"where_{channel}",
                "structure",
                f"Residual of the {channel} against time, level, rate and phase",
                caption,
                figure,
            )
        yield _structure(found)
    names, table = cosines(rows)
    if len(names) > 1:
        caption = (
            "Cosine between the changes that two effects make in the predictions, with the fitted parameters free: "
            "at 1, the records cannot distinguish the two; at 0, they have nothing in common. Each effect has the "
            "start value with the highest score."
        )
        yield Picture(
            "cosines",
            "effects",
            "How alike the effects look in these records",
            caption,
            diagnosed.cosine_figure(names, table),
        )
    for n, (record, before, after) in enumerate(responses(found), 1):
        predicted = {"without effects": before, "with effects": after} if changed else {"predicted": before}
        caption = "Measured and predicted response; residual in per cent of the measured magnitude."
        heading = f"{record.name} ({'fitted' if record.role == 'fit' else 'validation'})"
        yield Picture(f"response_{n}", "records", heading, caption, response_figure(record, predicted))
    for n, each in enumerate(Stage(follower(), "drawing", "records").over(records), 1):
        role = "fitted" if each.data.role == "fit" else "validation"
        caption = (
            "Left: measured minus predicted, averaged over short intervals. Right: its spectrum; the line is white "
            "noise of the same power."
        )
        yield Picture(
            f"record_{n}", "records", f"{each.data.name} ({role})", caption, diagnosed.record_figure(each, changed)
        )


def _causes(records: Sequence[Residuals], changed: bool) -> Iterator[Picture]:
    """The channel with the largest gain (without effects: farthest from noise), in the record where it is largest."""
    places = [(each, c) for each in records for c in range(len(each.data.channels))]
    squares = [each.gain(c) if changed else float((each.white_after[:, c] ** 2).sum()) for each, c in places]
    each, c = places[squares.index(max(squares))]
    channel = each.data.channels[c]
    heading = f"Where it shows: {channel} in {each.data.name}"
    caption = (
        "Left: the measured loop. Middle: mean residual along it, solid on the rising and dashed on the falling "
        "branch, "
        "or over time if the drive is not a sine. Right: spectrum of the residual."
    )
    yield Picture("cause", "cause", heading, caption, diagnosed.cause_figure(each, c, changed))


def _structure(found: Diagnosis) -> Picture:
    problem = found.problem
    sides = [("without effects", run_tests(problem, found.before.found))]
    if found.extended:
        sides.append(("with effects", run_tests(problem, found.search.final)))
    caption = (
        "Sum of the squared whitened residuals in each frequency band (Hz): its excess over the expectation for noise, "
        "in standard deviations. From each channel, what the channels before it predict is subtracted. White fields "
        "are no more than noise."
    )
    return Picture("structure", "structure", "Residuals against noise by record, channel and frequency", caption,
                   diagnosed.structure_figure(sides))  # fmt: skip


def _named(found: Diagnosis) -> Iterator[dict[str, Any]]:
    for named in found.effects:
        yield {
            "name": named.effect.name.replace("_", " "), "p_value": _p(named.p_value), "gain": percent(named.gain),
            "looks": named.effect.looks, "told_by": named.effect.told_by, "source": named.effect.source,
            "doc": (type(named.effect).__doc__ or "").split("\n")[0],
            "values": [
                (name.replace("_", " "), value if isinstance(value, str) else with_error(value, std, unit))
                for name, (value, std, unit) in values(named).items()
            ],
        }  # fmt: skip


def _laws(found: Diagnosis) -> Iterator[dict[str, Any]]:
    """Laws without a name, with the places that they were told from."""
    for law in found.discovery:
        yield {
            "place": law.place, "of": law.law.place.input.replace("_", " "), "formula": law.formula,
            "gain": percent(law.gain), "p_value": _p(law.p_value),
            "doc": (type(law.law.place).__doc__ or "").split("\n")[0],
            "values": [(name, with_error(value, std, unit)) for name, (value, std, unit) in law.parameters.items()],
            "rivals": [
                (f"{rival.place} of {rival.input.replace('_', ' ')}", number(rival.log_odds, 3)) for rival in law.rivals
            ],
        }  # fmt: skip


def _p(value: float) -> str:
    return "< 10⁻³⁰⁰" if value < 1e-300 else number(value, 2)


def _residuals(found: Diagnosis) -> Iterator[dict[str, Any]]:
    before, after = found.validation_before, found.validation_after
    for channel, noise in after.noise.items():
        unit = response_unit(channel)
        yield {
            "channel": channel, "before": engineering(before.rms[channel], unit),
            "after": engineering(after.rms[channel], unit), "noise": engineering(noise, unit),
            "ratio": number(after.ratio(channel), 3) if noise else NONE,
        }  # fmt: skip


def _score(row: Scored, found: Diagnosis) -> dict[str, Any]:
    candidate = row.candidate
    assert candidate is not None
    return {
        "name": row.name, "label": row.label, "present": any(named.effect.name == row.name for named in found.effects),
        "score": number(candidate.score, 3), "sigma": number(math.sqrt(max(candidate.score, 0.0)), 2),
        "p_value": _p(row.p_value), "sure": row.p_value < MAX_P_VALUE,
        "gain": NONE if row.gain is None else number(row.gain, 3), "looks": registered()[row.name].looks,
    }  # fmt: skip


def _parameters(found: Diagnosis) -> Iterator[dict[str, Any]]:
    for before, after in zip(found.before.estimates, found.estimates, strict=True):
        unit = after.parameter.unit
        shift, errors = before.value - after.value, NONE
        if before.identifiable and after.std and found.extended:
            errors = number(shift / after.std, 2) if shift else "0"
        told = after.value and found.extended
        change = f"{100 * shift / after.value:+z.3f}\u202f%".replace("-", "\u2212") if told else NONE
        yield {
            "name": after.parameter.name, "before": with_error(before.value, before.std, unit),
            "after": with_error(after.value, after.std, unit), "errors": errors, "change": change,
            "identifiable": after.identifiable, "assumes": " and ".join(after.assumes),
            "large": bool(after.std) and abs(shift) > 3 * (after.std or 0.0),
        }  # fmt: skip


def _similar_effects(rows: Sequence[Scored]) -> Iterator[str]:
    names, table = cosines(rows)
    pairs = [
        (abs(table[i, j]), i, j) for i in range(len(names)) for j in range(i) if abs(table[i, j]) > MIN_SIMILAR_COSINE
    ]
    remedies: dict[str, list[str]] = {}
    for size, i, j in sorted(pairs, reverse=True):
        remedy = registered()[names[i]].told_by or registered()[names[j]].told_by
        pair = f"{names[j].replace('_', ' ')} and {names[i].replace('_', ' ')} ({number(size, 2)})"
        remedies.setdefault(remedy, []).append(pair)
    yield from (f"{'; '.join(alike)}. To tell them apart: {remedy}." for remedy, alike in remedies.items())


def _alternatives(found: Diagnosis) -> Iterator[tuple[str, str]]:
    for step, more in found.search.alternatives:
        names = names_apart(step.found.model.transducer.effects, found.search.final.model.transducer.effects)
        yield " + ".join(names).replace("_", " "), number(more, 2)


def _test_row(place: ResidualTest) -> dict[str, str]:
    return {
        "where": place.where, "record": place.record, "channel": place.channel,
        "ratio": number(place.squares / place.count, 3), "p_value": _p(place.p_value),
    }  # fmt: skip


def _hints(found: Diagnosis) -> Iterator[dict[str, str]]:
    for hint in found.hints:
        yield {
            "channel": hint.channel, "term": hint.term, "size": engineering(hint.size, response_unit(hint.channel)),
            "gain": number(hint.gain, 3),
        }  # fmt: skip
