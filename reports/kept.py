"""Trials in processes of this machine, kept line by line: a run that is killed loses none, and goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from piezoharvest.output import write_text
from piezoharvest.workers.processes import begin_worker

DIGITS = 8  # of what is kept: standard errors are known to two, and are far above one in 10^8 of their values


def rows_of(path: Path) -> list[dict[str, Any]]:
    """Rows of a file of JSON lines; a last one that was cut off is taken away."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    if lines and not lines[-1].endswith("\n"):
        write_text("".join(lines[:-1]), path)
        lines.pop()
    return [json.loads(line) for line in lines]


def line_of(row: dict[str, Any]) -> str:
    """Line of a row, its floating-point numbers with as many digits as say something."""
    exact = json.dumps(row, allow_nan=False, default=float)
    return json.dumps(json.loads(exact, parse_float=lambda text: float(f"{float(text):.{DIGITS}g}"))) + "\n"


def run(path: Path, attempt: Callable[[Any], dict[str, Any]], trials: Iterable[Any], workers: int) -> Iterator[dict]:
    """Results of trials as they come, each added to a file; what is under way ends with this process."""
    context = get_context("spawn")
    lifeline, held = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(workers, context, begin_worker, (lifeline,))
    try:
        with path.open("a", encoding="utf-8") as file:
            for job in as_completed([pool.submit(attempt, trial) for trial in trials]):
                file.write(line_of(job.result()))
                file.flush()
                yield job.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        held.close()
