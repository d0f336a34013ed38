"""The command `diagnose --batch`, once its arguments are parsed."""

from __future__ import annotations

from pathlib import Path

from piezoharvest.cli import tables
from piezoharvest.cli.notes import note, progress_of
from piezoharvest.counting import counted

MAX_ERRORS = 10  # printed one by one; all are in the table


def diagnose_fleet(
    folder: Path, out: Path, *, effects: list[Path], workers: int, scheduler: str | None, as_json: bool
) -> int:
    """Diagnose all campaigns of a folder, write the table of verdicts and print how many there are of each."""
    from piezoharvest.workers.processes import start_early

    if workers > 1:
        start_early("piezoharvest.fleet.row", "piezoharvest.diagnose")
    from piezoharvest.fleet import diagnose_fleet as run

    try:
        with progress_of("campaigns") as progress:
            found = run(
                folder, out, effects=effects, workers=workers, scheduler=scheduler, progress=progress, notify=note
            )
    except (KeyboardInterrupt, SystemExit):
        if Path(f"{out}.partial").exists():
            note(f"verdicts so far are in {out}.partial: the same command goes on from there")
        raise
    if as_json:
        tables.print_json({"verdicts": dict(found.verdicts), "rows": list(found.rows)})
    else:
        rows = [[verdict, str(count)] for verdict, count in found.verdicts.most_common()]
        tables.print_rows(str(folder), ["verdict", "campaigns"], rows)
    note(f"{counted(len(found.rows) - found.resumed, 'campaign')} in {found.seconds:.1f} s: {out}")
    for row in found.failed[:MAX_ERRORS]:
        note(f"warning: {row['campaign']}: {row['error'] or 'the fit has not converged, it is not to be trusted'}")
    if len(found.failed) > MAX_ERRORS:
        note(f"warning: {len(found.failed) - MAX_ERRORS} more are not shown, all are in the table")
    return 1 if found.failed else 0
