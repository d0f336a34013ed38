"""`python -m reports.reliability [--first N] [--workers N]`: random studies of every shunt and effect, simulated.

What is done stands in trials.jsonl beside this file, a line for each study: the same command goes on from there.
"""

import argparse
from pathlib import Path

from reports.kept import rows_of, run

HERE = Path(__file__).parent
KEPT = HERE / "trials.jsonl"
ALL = 50_000


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m reports.reliability", description=__doc__)
    parser.add_argument("--first", type=int, default=ALL, metavar="N", help="the first N studies")
    parser.add_argument("--begin", type=int, default=0, metavar="SEED", help="the seed of the first")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    from reports.reliability.page import write
    from reports.reliability.trial import attempt

    done = {row["seed"] for row in rows_of(KEPT)}
    wanted = [seed for seed in range(options.begin, options.begin + options.first) if seed not in done]
    for row in run(KEPT, attempt, wanted, options.workers) if wanted else ():
        if row["outcome"] in ("impossible", "internal error", "slow"):
            print(row["seed"], row["kind"], row["outcome"], row["what"])
    write(rows_of(KEPT), HERE / "reliability.md")


if __name__ == "__main__":
    main()
