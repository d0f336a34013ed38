"""`python -m reports.speed.beside [COMMIT]` times the old circuits beside an earlier version.

Times periods of the circuits that both versions have, in turn: one process of the version of a commit, one of this one,
again and again, so that both have the same moments of a shared machine. Prints the least time of each and their ratio,
and writes them to beside.md. The default is the last commit before switched capacitors, breakers and storage came.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path

from piezoharvest.output import write_text

BEFORE = "d5bb9f0a^"
ROOT = Path(__file__).parents[2]
ROUNDS = 12
LIMIT = 1.05  # of the time before
# Runs in either version, with what both have.
SCRIPT = """
import json, tempfile, time
from pathlib import Path
from reports.speed import engine, studies
def least(case, end, count):
    run = engine.Simulation(case)
    times = []
    for _ in range(40):
        run.restart()
        begin = time.perf_counter()
        run.run(end)
        times.append((time.perf_counter() - begin) / count)
    return min(times)
found = {}
for stops in (False, True):
    case = studies.sshi(stops=stops)
    found[case.title] = least(case, 500 * studies.PERIOD, 500)
with tempfile.TemporaryDirectory() as folder:
    case = studies.record(Path(folder), 2000)
    found[case.title + ", a sample"] = least(case, 1999 / studies.SAMPLE_RATE, 2000)
print(json.dumps(found))
"""


def times(root: Path) -> dict[str, float]:
    """Seconds of the version in a folder, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(root), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def measured(commit: str) -> dict[str, tuple[float, float]]:
    """Least seconds before and now, by case."""
    with tempfile.TemporaryDirectory() as folder:
        old = Path(folder) / "before"
        subprocess.run(["git", "worktree", "add", "--quiet", "--detach", old, commit], cwd=ROOT, check=True)
        try:
            pairs = [(times(old), times(ROOT)) for _ in range(ROUNDS)]
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", old], cwd=ROOT, check=True)
    return {name: (min(a[name] for a, _ in pairs), min(b[name] for _, b in pairs)) for name in pairs[0][0]}


def main() -> None:
    """Measure and write the page."""
    commit = sys.argv[1] if len(sys.argv) > 1 else BEFORE
    name = subprocess.run(["git", "rev-parse", "--short", commit], cwd=ROOT, capture_output=True, text=True, check=True)
    found = measured(commit)
    lines = ["# The old circuits beside an earlier version", "",
             f"Least of {ROUNDS} processes of each version in turn, commit {name.stdout.strip()} and this one, "
             f"{date.today().isoformat()}; wanted: at most {LIMIT:g} times as long. `python -m reports.speed.beside` "
             "makes this page.", "",
             "| | before, us | now, us | ratio |", "|---|---:|---:|---:|"]  # fmt: skip
    lines += [f"| {case} | {1e6 * a:.3g} | {1e6 * b:.3g} | {b / a:.3f} |" for case, (a, b) in found.items()]
    write_text("\n".join(lines) + "\n", Path(__file__).parent / "beside.md")
    for case, (a, b) in found.items():
        verdict = "slower" if b > LIMIT * a else "as fast"
        print(f"{verdict}: {case}: {1e6 * b:.3g} us, {b / a:.3f} of {1e6 * a:.3g} us at {name.stdout.strip()}")


if __name__ == "__main__":
    main()
