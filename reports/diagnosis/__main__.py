"""Run the trials that are not done yet, make the page.

`python -m reports.diagnosis [--small | --page | --alone N | --held-out | --others | --circuits]`
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import track

from reports.diagnosis import circuits, sensitivity, trials
from reports.diagnosis.plan import circuits as plan_of_circuits
from reports.diagnosis.plan import held_out, plan
from reports.diagnosis.trials import Trial, attempt
from reports.kept import rows_of, run

HERE = Path(__file__).parent
FILE, ALONE, HELD_OUT = HERE / "trials.jsonl", HERE / "alone.jsonl", HERE / "held_out.jsonl"
CIRCUITS, OTHERS = HERE / "circuits.jsonl", HERE / "others.jsonl"
ADDED = 6_000_000  # to the seeds of the held-out campaigns, for those of `--others`


def main() -> int:
    """Run, write and draw; 1 where a trial has failed with an error."""
    parser = argparse.ArgumentParser(prog="python -m reports.diagnosis", description=__doc__)
    parser.add_argument("--small", action="store_true", help="a few trials of each kind")
    parser.add_argument("--page", action="store_true", help="only make the page of what is done")
    parser.add_argument("--alone", type=int, default=0, help="diagnose those again that took longest, one at a time")
    parser.add_argument("--held-out", action="store_true", help="held-out campaigns, with every threshold varied")
    parser.add_argument("--others", action="store_true", help="the same with other seeds, thresholds as they are")
    parser.add_argument("--circuits", action="store_true", help="held-out campaigns behind diodes and switches")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    console = Console(stderr=True)
    runs, todo = iter(()), list[Trial]()
    if options.alone:
        todo = _slowest(options.alone)
        ALONE.unlink(missing_ok=True)
        runs = run(ALONE, attempt, todo, 1)
    elif options.held_out:
        done = {result["key"] for result in rows_of(HELD_OUT)}
        todo = [trial for trial in held_out() if trial.key not in done]
        runs = run(HELD_OUT, sensitivity.attempt, todo, options.workers)
    elif options.others:
        done = {result["key"] for result in rows_of(OTHERS)}
        todo = [trial for trial in held_out(ADDED) if trial.key not in done]
        runs = run(OTHERS, trials.held_out, todo, options.workers)
    elif options.circuits:
        done = {result["key"] for result in rows_of(CIRCUITS)}
        todo = [trial for trial in plan_of_circuits(held_out=True) if trial.key not in done]
        runs = run(CIRCUITS, circuits.held_out, todo, options.workers)
    elif not options.page:
        done = {result["key"] for result in rows_of(FILE)}
        todo = [trial for trial in plan(small=options.small) if trial.key not in done]
        runs = run(FILE, attempt, todo, options.workers)
    for _ in track(runs, "diagnosing", total=len(todo), console=console):
        pass
    from reports.diagnosis.page import write_page

    results = rows_of(FILE)
    kept = {"alone": ALONE, "held_out": HELD_OUT, "others": OTHERS, "circuits": CIRCUITS}
    print(write_page(results, HERE, **{name: rows_of(path) for name, path in kept.items()}))
    return 1 if any(result["verdict"] == "failed" for result in results) else 0


def _slowest(count: int) -> list[Trial]:
    """So many trials of those that took most processor time."""
    trials = {trial.key: trial for trial in plan(small=False)}
    done = sorted(rows_of(FILE), key=lambda row: row.get("cpu", 0.0), reverse=True)
    return [trials[row["key"]] for row in done[:count]]


if __name__ == "__main__":
    sys.exit(main())
