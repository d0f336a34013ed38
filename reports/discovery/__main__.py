"""Run the trials that are not done yet, make the page.

`python -m reports.discovery [--development | --page | --real] [--first N]`
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import track

from reports.discovery import real
from reports.discovery.plan import plan
from reports.discovery.trials import attempt, held_out
from reports.kept import rows_of, run

HERE = Path(__file__).parent
DEVELOPMENT, HELD_OUT = HERE / "development.jsonl", HERE / "held_out.jsonl"


def main() -> int:
    """Run and write; 1 where a trial has failed with an error."""
    parser = argparse.ArgumentParser(prog="python -m reports.discovery", description=__doc__)
    parser.add_argument("--development", action="store_true", help="trials that code may be changed for")
    parser.add_argument("--first", type=int, default=None, help="so many trials of the plan, in its fixed order")
    parser.add_argument("--page", action="store_true", help="only make the page of what is done")
    parser.add_argument("--real", action="store_true", help="the measured data of ../shared/data, if they are there")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    file, trial_of = (DEVELOPMENT, attempt) if options.development else (HELD_OUT, held_out)
    done = {row["key"] for row in rows_of(file)}
    chosen = [] if options.page or options.real else plan(held_out=not options.development)[: options.first]
    todo = [trial for trial in chosen if trial.key not in done]
    runs = run(file, trial_of, todo, options.workers)
    for _ in track(runs, "diagnosing", total=len(todo), console=Console(stderr=True)):
        pass
    if options.real:
        if not real.there():
            print("not run: ../shared/data is absent", file=sys.stderr)
            return 2
        real.write_real(HERE / "real.json")
    from reports.discovery.page import write_page

    print(write_page(rows_of(DEVELOPMENT), rows_of(HELD_OUT), HERE))
    return 1 if any(row["outcome"] == "failed" for row in rows_of(file)) else 0


if __name__ == "__main__":
    sys.exit(main())
