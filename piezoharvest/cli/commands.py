"""The commands, once their arguments are parsed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from piezoharvest.cli import tables
from piezoharvest.cli.notes import Tell, note, telling
from piezoharvest.counting import counted
from piezoharvest.description.parameters import ParameterError
from piezoharvest.input import InputError
from piezoharvest.output import (
    TABLE_SUFFIXES,
    OutputError,
    check_file,
    check_new_directory,
    waveform_table,
    write_table,
)
from piezoharvest.progress import Stage
from piezoharvest.study import DesignOptions, Study, StudyError, load_driven_study, load_study

if TYPE_CHECKING:
    from piezoharvest.design import DesignResult
    from piezoharvest.engine.response import Response
    from piezoharvest.specimen import Specimen

BAD_INPUT = (StudyError, ParameterError, OutputError, InputError)
_LARGE_FILE = 5e7  # bytes: what takes seconds to write, and an editor or a spreadsheet does not open


def driven_study(path: Path) -> Study:
    """Study of a file whose excitation has a frequency; what its transducer's values assume is told."""
    return _told(load_driven_study(path))


def _told(study: Study) -> Study:
    """The study, having told what its transducer's values assume."""
    for text in study.transducer.assumptions:
        note(f"assumed: {text}")
    return study


def simulate(
    path: Path, *, as_json: bool, transient: float | None, out: Path | None, uncertainty: int | None = None
) -> int:
    """Simulate every shunt of a study, print the results and write the waveforms."""
    if out is not None:
        check_file(out, TABLE_SUFFIXES)
    study = with_shunts(driven_study(path))
    specimen = None if uncertainty is None else _specimen(study)
    count = len(study.shunts)
    spread: list[dict[str, Any] | None] = [None] * count
    with telling() as tell:
        shunts = Stage(tell, "simulating", "shunts").over(range(count))
        responses = [_respond(study, n, transient, tell, waveforms=out is not None) for n in shunts]
        if specimen is not None and uncertainty is not None:
            spread = [_spread(study, n, specimen, uncertainty, transient, tell) for n in range(count)]
    if as_json:
        results = [
            tables.response_json(response) | ({} if found is None else {"uncertainty": found})
            for response, found in zip(responses, spread, strict=True)
        ]
        tables.print_json({"title": study.title, "results": results})
    else:
        tables.print_responses(study.title, responses)
        if specimen is not None:
            tables.print_intervals([response.shunt for response in responses], spread)
    if out is not None:
        table = waveform_table(responses)
        write_table(table, out)
        note(f"waveforms: {out}{_size(out, len(table['time_s']))}")
    every = all(found is None or found["converged"] == found["samples"] for found in spread)
    return 0 if every and all(response.converged for response in responses) else 1


def _size(file: Path, rows: int) -> str:
    """Size of a large file in words, with what is smaller where it is text."""
    size = file.stat().st_size
    if size < _LARGE_FILE:
        return ""
    smaller = "; .parquet, .npz and .h5 take less" if file.suffix.lower() == ".csv" else ""
    return f" ({size / 1e6:.0f} MB, {rows:,} rows{smaller})"


def _specimen(study: Study) -> Specimen:
    """The identified specimen of a study."""
    from piezoharvest.specimen import load_specimen

    if study.specimen is None:
        needed = "--uncertainty needs the name of a specimen file, as identify --save writes it"
        raise StudyError(study.path, "transducer", f"found a table, but {needed}")
    return load_specimen(study.specimen)


def _spread(
    study: Study, n: int, specimen: Specimen, samples: int, transient: float | None, tell: Tell
) -> dict[str, Any]:
    """Distribution of the figures of one shunt over draws of the specimen."""
    from piezoharvest.specimen import intervals

    where = f"shunts.{n} ({study.shunts[n].kind})"
    try:
        found = intervals(specimen, study.shunts[n], study.excitation, samples, transient, tell)
    except ParameterError as error:
        raise StudyError(study.path, where, f"--uncertainty: {error}") from None
    if found["converged"] < samples:
        note(f"warning: {where}: no trustworthy result in {samples - found['converged']} of {counted(samples, 'draw')}")
    return found


def _respond(study: Study, n: int, transient: float | None, tell: Tell, *, waveforms: bool) -> Response:
    """Simulate one shunt, with remarks on the result; with waveforms, which take memory, only if wanted."""
    from piezoharvest.engine import simulate as run

    try:
        response = run(study.systems[n], study.excitation, transient=transient, progress=tell)
    except ParameterError as error:
        raise StudyError(study.path, f"shunts.{n} ({study.shunts[n].kind})", str(error)) from None
    where = f"shunts.{n} ({response.shunt})"
    if not response.converged:
        note(f"warning: {where}: not to be trusted: {response.message or 'did not converge'}")
    elif response.message:
        note(f"warning: {where}: {response.message}")
    if transient is not None and response.wakes_per_hour and round(response.wakes_per_hour * transient / 3600) == 1:
        once = f"the supply turns on once in {transient:g} s, which the figures per hour are extrapolated from"
        note(f"{where}: {once}: a longer --transient shows how often it does")
    return response if waveforms else replace(response, waveforms=None)


def design(path: Path, *, as_json: bool, report: Path | None) -> int:
    """Tune the candidates of a study and print them, best first; 1 if the best is unreliable or breaks a limit."""
    result = run_design(_told(load_study(path)), as_json=as_json, report=report)
    return 0 if result.converged and result.feasible else 1


def run_design(study: Study, *, as_json: bool, report: Path | None) -> DesignResult:
    """Design a study, print the candidates, write the report, and return the result."""
    study = replace(study, design=study.design or DesignOptions())
    if report is not None:
        check_new_directory(report)
    from piezoharvest.design import design as run

    try:
        with telling() as tell:
            result = run(study, progress=tell)
    except ParameterError as error:
        raise StudyError(study.path, error.key, error.message) from None
    for text in result.notes:
        note(f"warning: {text}")
    if not result.converged and not result.notes:
        note("warning: not to be trusted: the design did not converge")
    if as_json:
        tables.print_json(result.as_json())
    else:
        damping = study.design is not None and study.design.objective == "damping"
        tables.print_design(study.title, result.as_json(), damping=damping)
    if report is not None:
        from piezoharvest.report import write_report

        tables.print_report(partial(write_report, study, result, report), as_json=as_json)
    return result


def with_shunts(study: Study) -> Study:
    """The study, which must have shunts."""
    if not study.shunts:
        raise StudyError(study.path, "shunts", "missing tables [[shunts]], at least one is needed")
    return study


def measure(path: Path, out: Path) -> int:
    """Measure a study on the virtual bench and print the path of the campaign."""
    from piezoharvest.bench import SolverError, write_campaign
    from piezoharvest.bench import measure as run
    from piezoharvest.bench.writing import check_folder

    study = driven_study(path)
    check_folder(out)
    try:
        with telling() as tell:
            campaign = run(study, progress=tell)
    except SolverError as error:
        note(f"piezoharvest: error: {path}: {error}; nothing was written")
        return 1
    for record in campaign.records:
        for warning in record.warnings:
            note(f"warning: {record.name}: {warning}")
    print(write_campaign(campaign, out))
    return 0
