"""The command `sweep`, once its arguments are parsed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from piezoharvest.cli import tables
from piezoharvest.cli.commands import driven_study
from piezoharvest.cli.notes import note, progress_of
from piezoharvest.counting import counted
from piezoharvest.output import check_file

if TYPE_CHECKING:
    from piezoharvest.sweep import SweepResult


def sweep(path: Path, out: Path, *, workers: int, scheduler: str | None, as_json: bool) -> int:
    """Sweep a study, write its table and print a summary."""
    from piezoharvest.sweep import SUFFIXES
    from piezoharvest.sweep import sweep as run
    from piezoharvest.workers.processes import start_early

    check_file(out, SUFFIXES)
    if workers > 1:
        start_early("piezoharvest.sweep.evaluate", "piezoharvest.engine.batch")
    study = driven_study(path)
    try:
        with progress_of("designs") as progress:
            result = run(study, out, workers=workers, scheduler=scheduler, progress=progress, notify=note)
    except (KeyboardInterrupt, SystemExit):
        note("finished designs are kept: the same command resumes the sweep")
        raise
    if as_json:
        tables.print_json(result.as_json())
    else:
        tables.print_sweep(study.title, result.best, *result.units)
    return _report_outcome(result)


def _report_outcome(result: SweepResult) -> int:
    """Report the outcome on stderr; returns the exit status."""
    new = result.designs - result.resumed
    rate = f"{result.designs_per_second:.0f} per second"
    note(f"{counted(new, 'design')} in {result.seconds:.1f} s ({rate}): {result.out}")
    if not result.failed and not result.incomplete:
        return 0
    said = [
        f"{count} of {counted(result.rows, 'row')} {what}"
        for count, what in (
            (result.failed, "did not converge (converged is false)"),
            (result.incomplete, "converged, but have no value for some output (null)"),
        )
        if count
    ]
    note(f"warning: {' and '.join(said)}")
    return 1
