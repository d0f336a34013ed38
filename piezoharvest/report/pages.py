"""The page of a design: a self-contained HTML file, with its figures as PNG files beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from piezoharvest.output import write_text
from piezoharvest.report import tables
from piezoharvest.report.answer import answer
from piezoharvest.report.figures import style
from piezoharvest.report.figures.bode import best_linear
from piezoharvest.report.figures.bound_lines import BoundLines
from piezoharvest.report.figures.pictures import place_pictures
from piezoharvest.report.frame.rendering import page
from piezoharvest.report.frame.report_folder import NAME, report_folder
from piezoharvest.report.gallery import Gallery
from piezoharvest.report.limits import power_limit
from piezoharvest.report.spans import at_best_frequency, design_band, frequency_range
from piezoharvest.report.subjects import subjects_of
from piezoharvest.report.tolerance.worst_cases import worst_case_text, worst_cases
from piezoharvest.report.units import decibel, engineering
from piezoharvest.study import Study

if TYPE_CHECKING:
    from piezoharvest.design.result import DesignResult

_SECTIONS = ("answer", "trade-off", "power", "damping", "waveforms", "two-port")


def write_report(study: Study, design_result: DesignResult, directory: str | Path) -> Path:
    """Write the report of a design: a self-contained HTML page, and its figures as PNG files.

    Parameters
    ----------
    study : Study
    design_result : DesignResult
        Result of `piezoharvest.design.design` for the study.
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
    asked, study = study, at_best_frequency(study, design_result)
    subjects = subjects_of(design_result.candidates)
    limit = power_limit(study.transducer, study.excitation)
    bound = BoundLines(study, design_result.bound, best_linear(subjects))
    damping = study.design is not None and study.design.objective == "damping"
    headings, rows = tables.ranking(subjects, limit, damping)
    gallery = Gallery(study, subjects, limit, bound, design_result)
    with report_folder(directory) as folder:
        figures = place_pictures(gallery.pictures(), _SECTIONS, folder)
        text = page(
            "report.html.j2",
            title=study.title,
            answer=answer(study, subjects, limit),
            headings=headings,
            ranking=rows,
            parts=tables.bought_parts(subjects),
            restrictions=tables.restrictions(subjects),
            front=tables.best_front(design_result),
            fronts=tables.kind_fronts(subjects, design_result),
            series=tables.series_text(subjects),
            worst_cases=worst_cases(subjects),
            worst_case=worst_case_text(study, subjects),
            damping=damping,
            tuning=[(s.label, s.candidate.method, s.candidate.start, s.candidate.iterations) for s in subjects],
            limit=limit and engineering(limit.power, "W"),
            near_limit=tables.near_limit(subjects, limit),
            bound=_bound(design_result),
            band=(band := design_band(study)) and frequency_range(band),
            figures=figures,
            energies=tables.energies(subjects),
            two_port=tables.two_port(study, limit),
            transducer=list(tables.transducer_tables(study.transducer)),
            conditions=[tables.excitation_table(asked), ("Objectives and limits", tables.goal_table(asked))],
            sought=asked.free_frequency and asked.design and asked.design.band and frequency_range(asked.design.band),
            notes=[*design_result.notes, *gallery.remarks],
            colours=len(style.PALETTE),
            file=study.path.name,
        )
        write_text(text, folder / NAME)
    return Path(directory) / NAME


def _bound(result: DesignResult) -> list[str]:
    """Sentences on the bound of passive linear shunts; none without one."""
    bound = result.bound
    power, attenuation = bound.harvested_power, bound.attenuation_db
    found = [engineering(power, "W")] if power is not None else []
    found += [decibel(attenuation)] if attenuation is not None else []
    if not found:
        return []
    sentences = [f"No passive linear shunt can do better than {' or '.join(found)}."]
    show = decibel if power is None else lambda value: engineering(value, "W")
    if bound.reached is not None:
        sentences.append(f"A passive one-port that reaches {show(bound.reached)} is known.")
    if bound.frequency_wise is not None and bound.frequency_wise != (attenuation if power is None else power):
        sentences.append(
            f"With a different one-port at every frequency the limit would be {show(bound.frequency_wise)}."
        )
    if bound.linearised:
        sentences.append("The hysteresis is linearised at the amplitude found.")
    return sentences
