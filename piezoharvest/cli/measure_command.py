"""The command `measure`, once its arguments are parsed."""

from __future__ import annotations

from pathlib import Path

from piezoharvest.cli.commands import driven_study
from piezoharvest.cli.notes import note


def measure(path: Path, out: Path) -> int:
    """Measure a study on the virtual bench and print the path of the campaign."""
    from piezoharvest.bench import SolverError, write_campaign
    from piezoharvest.bench import measure as run
    from piezoharvest.bench.writing import check_folder

    study = driven_study(path)
    check_folder(out)
    try:
        campaign = run(study, progress=note)
    except SolverError as error:
        note(f"piezoharvest: error: {path}: {error}; nothing was written")
        return 1
    for record in campaign.records:
        for warning in record.warnings:
            note(f"warning: {record.name}: {warning}")
    print(write_campaign(campaign, out))
    return 0
