"""Diagnose all campaigns in a folder, and keep the verdict of each as it comes."""

from __future__ import annotations

import csv
import json
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path
from time import perf_counter
from typing import TextIO

from piezoharvest.counting import counted
from piezoharvest.fleet.campaigns import campaigns_in, fingerprint
from piezoharvest.fleet.row import COLUMNS, Row, diagnosed
from piezoharvest.output import check_file, write_text
from piezoharvest.workers.lock import locked
from piezoharvest.workers.run import done
from piezoharvest.workers.stream import Item

SUFFIXES = (".csv", ".jsonl")
FINGERPRINT = "fingerprint"  # column that tells whether a row is of the same campaign, data and version


@dataclass(frozen=True)
class FleetResult:
    """Verdicts on all campaigns of a folder.

    Attributes
    ----------
    rows : tuple of dict
        One for each campaign, in the order of their paths: `campaign`, `title`, `verdict`, `effects`, `law`, `gain`,
        `unexplained`, `converged`, `warnings` (their number), `seconds`, `error`, and each parameter with `NAME_std`.
    resumed : int
        Rows of an earlier run whose campaigns have not changed.
    seconds : float
    """

    rows: tuple[Row, ...]
    resumed: int
    seconds: float

    @property
    def verdicts(self) -> Counter[str]:
        """Number of campaigns with each verdict; those with an error have none."""
        return Counter(row["verdict"] for row in self.rows if row["verdict"])

    @property
    def failed(self) -> tuple[Row, ...]:
        """Rows of campaigns without a verdict, or whose fit did not converge."""
        return tuple(row for row in self.rows if row["error"] or not row["converged"])


def diagnose_fleet(
    folder: str | Path,
    out: str | Path,
    *,
    effects: Sequence[str | Path] = (),
    workers: int = 1,
    scheduler: str | None = None,
    progress: Callable[[int, int], object] | None = None,
    notify: Callable[[str], object] | None = None,
) -> FleetResult:
    """Diagnose every campaign in a folder and in those inside of it, and write one table of verdicts.

    Parameters
    ----------
    folder : str or Path
    out : str or Path
        .csv or .jsonl, with a row for each campaign. Numbers are in SI units; what is not known is empty.
    effects : sequence of str or Path
        Your own effect files.
    workers : int
        Number of processes; one is this process itself.
    scheduler : str, optional
        Address of a running Dask cluster that does the work instead; its workers read the files at the same paths.
    progress : callable, optional
        Called with the number of campaigns done and the number of all.
    notify : callable, optional
        Called with remarks during the run, in sentences.

    Raises
    ------
    StudyError
        There is no such folder, or no campaign in it.
    OutputError
        The table cannot be written, or another process is writing it.
    ParameterError
        There is no such scheduler.
    OSError
        The disk is full; a worker process died; the cluster was lost.

    Notes
    -----
    Verdicts are kept one by one in FILE.partial. The same command goes on where a run was killed, and diagnoses only
    what is new or has changed where a table is complete: a campaign counts as the same with the same files (by their
    contents) and the same version of the package.
    """
    begun, folder = perf_counter(), Path(folder)
    progress, notify = progress or _ignore, notify or _ignore
    out = check_file(out, SUFFIXES)
    files, own = campaigns_in(folder), [Path(each).resolve() for each in effects]
    partly = out.with_name(f"{out.name}.partial")
    with locked(partly, f"{out}: another process is writing the same table"), _not_left_empty(partly):
        marks = {str(path.relative_to(folder)): fingerprint(path, own) for path in files}
        complete = _rows(out)
        if out.exists() and not any(FINGERPRINT in row for row in complete):
            notify(f"{out} holds no table of verdicts, and will be replaced by one")
        known = _same([*complete, *_lines(partly)], marks)
        if known:
            notify(f"verdicts of {len(known)} of {counted(len(files), 'campaign')} are there already")
        count, paths = len(known), {str(path.relative_to(folder)): path for path in files}
        progress(count, len(files))
        names = [name for name in marks if name not in known]
        items = (Item(n, paths[name].resolve()) for n, name in enumerate(names))
        work = partial(diagnosed, own)
        with _added_to(partly) as kept, closing(done(work, items, workers, scheduler, notify)) as results:
            for item, row in results:
                name = names[item.number]
                known[name] = {"campaign": name, **row, FINGERPRINT: marks[name]}
                kept.write(json.dumps(known[name], allow_nan=False) + "\n")
                kept.flush()
                os.fsync(kept.fileno())
                count += 1
                progress(count, len(files))
        rows = [known[name] for name in marks]
        write_text(_table(rows, out.suffix.lower()), out)
        partly.unlink()
    return FleetResult(tuple(rows), len(files) - len(names), perf_counter() - begun)


@contextmanager
def _not_left_empty(partly: Path) -> Iterator[None]:
    """Remove the file of verdicts that are done in the end if there are none."""
    try:
        yield
    finally:
        if partly.exists() and not partly.stat().st_size:
            partly.unlink()


def _ignore(*what: object) -> None:
    pass


@contextmanager
def _added_to(partly: Path) -> Iterator[TextIO]:
    """The file of verdicts that are done, to add lines to it: what is there stays, and a line that was cut off ends."""
    partly.touch()
    whole = not partly.stat().st_size or partly.read_bytes().endswith(b"\n")
    with partly.open("a", encoding="utf-8") as file:
        file.write("" if whole else "\n")
        yield file


def _same(rows: Iterable[Row], marks: dict[str, str]) -> dict[str, Row]:
    """Rows of earlier runs that are of these campaigns as they are now, by campaign."""
    of_fleet = (row for row in rows if isinstance(row.get("campaign"), str) and row.get(FINGERPRINT))
    return {row["campaign"]: row for row in of_fleet if marks.get(row["campaign"]) == row[FINGERPRINT]}


def _rows(out: Path) -> list[Row]:
    """Rows of a complete table; none of a file that is another one."""
    try:
        if out.suffix.lower() == ".jsonl":
            return _lines(out)
        with out.open(encoding="utf-8", newline="") as file:
            return [{name: _value(name, text) for name, text in row.items() if name} for row in csv.DictReader(file)]
    except (OSError, ValueError, csv.Error):
        return []


def _value(name: str, text: str | None) -> object:
    """Value of a cell of a CSV table."""
    if not text:
        return None
    if name in ("campaign", "title", "verdict", "effects", "law", "error", FINGERPRINT):
        return text
    return text == "true" if text in ("true", "false") else json.loads(text)


def _lines(path: Path) -> list[Row]:
    """Rows of a file of JSON lines; one that was cut off is none."""
    try:
        rows = [_line(text) for text in path.read_text(encoding="utf-8", errors="replace").splitlines()]
    except OSError:
        return []
    return [row for row in rows if isinstance(row, dict)]


def _line(text: str) -> object:
    """What a line holds; None if it is no JSON."""
    try:
        return json.loads(text)
    except ValueError:
        return None


def _table(rows: list[Row], suffix: str) -> str:
    """Text of the table."""
    if suffix == ".jsonl":
        return "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows)
    names = dict.fromkeys([*COLUMNS, *(name for row in rows for name in row if name != FINGERPRINT), FINGERPRINT])
    text = StringIO(newline="")
    writer = csv.DictWriter(text, list(names), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in rows)
    return text.getvalue()


def _cell(value: object) -> str | None:
    """Cell of a CSV table: numbers and truth values as JSON has them, so that they are read again as they were."""
    return value if isinstance(value, str) or value is None else json.dumps(value)
