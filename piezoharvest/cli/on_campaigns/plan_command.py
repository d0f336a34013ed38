"""The command `plan`, once its arguments are parsed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import tomli_w

from piezoharvest.cli import tables
from piezoharvest.cli.notes import note, telling
from piezoharvest.cli.on_campaigns.diagnose_command import plan_json
from piezoharvest.cli.on_campaigns.running import on_campaign
from piezoharvest.description.parameters import ParameterError
from piezoharvest.output import check_file, write_text
from piezoharvest.study import StudyError

if TYPE_CHECKING:
    from piezoharvest.diagnose.experiments.planning import PlannedRecord


def plan(path: Path, *, out: Path | None, parameter: str | None, as_json: bool) -> int:
    """Plan the record that would tell most beside those of a campaign, and print or write it as a study."""
    from piezoharvest.diagnose import diagnose as run

    if out is not None:
        check_file(out, (".toml",))
    found = on_campaign(path, None, None, run)
    if found is None:
        return 1
    try:
        with telling():
            best = found.plan_for(parameter)
    except ParameterError as error:
        raise StudyError(path, error.key, error.message) from None
    if best is None:
        wider = "a table [experiment] in the campaign can allow other measurements"
        note(f"piezoharvest: {path}: no possible record would be more informative ({wider}); nothing was written")
        return 1
    text = study_text(best, path)
    if as_json:
        tables.print_json(plan_json(best))
    else:
        print(f"{best.sentence}." if out is not None else text)
    if out is not None:
        write_text(text, out)
        note(f"study: {out}")
    return 0


def study_text(best: PlannedRecord, path: Path) -> str:
    """The study as TOML, with what it is for in its head."""
    head = f"Planned by piezoharvest from {path.name}: {best.sentence}."
    safe = "".join(c if c.isprintable() else " " for c in head)
    return f"# {safe}\n{tomli_w.dumps(dict(best.tables))}"
