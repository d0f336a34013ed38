"""Run the trials that are not done yet, and make the page: `python -m reports.diagnosis [--small | --page]`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track

from reports.diagnosis.plan import plan
from reports.diagnosis.trials import Trial, attempt

HERE = Path(__file__).parent
FILE = HERE / "trials.jsonl"


def results() -> list[dict[str, Any]]:
    """Trials that are done."""
    return [json.loads(line) for line in FILE.read_text().splitlines()] if FILE.exists() else []


def _run(trials: list[Trial], workers: int) -> Iterator[dict[str, Any]]:
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        for job in as_completed([pool.submit(attempt, trial) for trial in trials]):
            yield job.result()


def main() -> int:
    """Run, write and draw; 1 where a trial has failed with an error."""
    parser = argparse.ArgumentParser(prog="python -m reports.diagnosis", description=__doc__)
    parser.add_argument("--small", action="store_true", help="a few trials of each kind")
    parser.add_argument("--page", action="store_true", help="only make the page of what is done")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    console = Console(stderr=True)
    done = {result["key"] for result in results()}
    todo = [] if options.page else [trial for trial in plan(small=options.small) if trial.key not in done]
    with FILE.open("a") as file:
        runs = _run(todo, options.workers) if todo else ()
        for result in track(runs, "diagnosing", total=len(todo), console=console):
            file.write(json.dumps(result, allow_nan=False, default=float) + "\n")
            file.flush()
    from reports.diagnosis.page import write_page

    print(write_page(results(), HERE))
    return 1 if any(result["verdict"] == "failed" for result in results()) else 0


if __name__ == "__main__":
    sys.exit(main())
