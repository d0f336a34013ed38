"""`python -m reports.optima [--designs N] [--simulated N] [--workers N]`: random designs beside tuned ones.

What is done stands in cases.jsonl beside this file, a line for each study: the same command goes on from there.
"""

import argparse
import os
from functools import partial
from pathlib import Path

from reports.kept import rows_of, run

HERE = Path(__file__).parent
KEPT = HERE / "cases.jsonl"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m reports.optima", description=__doc__)
    parser.add_argument("--designs", type=int, default=100_000, help="random designs of each kind on the two-port")
    parser.add_argument("--simulated", type=int, default=100_000, help="random designs of each kind to be simulated")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from reports.optima.page import write
    from reports.optima.plants import cases
    from reports.optima.trial import attempt

    done = {
        row["name"]
        for row in rows_of(KEPT)
        if row["designs"] >= options.designs and row["simulated"] >= options.simulated
    }
    wanted = [case for case in cases() if case.name not in done]
    attempting = partial(attempt, designs=options.designs, simulated=options.simulated)
    for _ in run(KEPT, attempting, wanted, options.workers) if wanted else ():
        pass
    write(rows_of(KEPT), HERE / "optima.md")


if __name__ == "__main__":
    main()
