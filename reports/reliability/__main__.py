"""`python -m reports.reliability [--first N] [--oracle | --inputs | --kills]`: random studies, wrong inputs, kills.

Studies of every shunt and effect are simulated; with `--oracle` some are run by the bench's solver, too; with
`--inputs` wrong files and tables are given to the program; with `--kills` commands are killed and given again. What is
done stands beside this file, a line for each: the same command goes on from there.
"""

import argparse
from pathlib import Path

from reports.kept import rows_of, run

HERE = Path(__file__).parent
KEPT, COMPARED, INPUTS, KILLED = (HERE / f"{name}.jsonl" for name in ("trials", "oracle", "inputs", "kills"))
ALL = 50_000
WRONG = ("impossible", "internal error", "slow", "not followed")


def main() -> None:
    """Run the studies that are not done yet, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m reports.reliability", description=__doc__)
    parser.add_argument("--first", type=int, default=ALL, metavar="N", help="the first N studies")
    parser.add_argument("--begin", type=int, default=0, metavar="SEED", help="the seed of the first")
    parser.add_argument("--oracle", action="store_true", help="compare a stratified sample with the bench's solver")
    parser.add_argument("--inputs", action="store_true", help="wrong files and tables instead of studies")
    parser.add_argument("--kills", action="store_true", help="kill commands at random moments, and give them again")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    from reports.reliability.inputs import attempt_input
    from reports.reliability.oracle import compare, sample
    from reports.reliability.page import write
    from reports.reliability.trial import attempt

    seeds = sample(options.begin) if options.oracle else range(options.begin, options.begin + options.first)
    path, trial = (
        (COMPARED, compare) if options.oracle else (INPUTS, attempt_input) if options.inputs else (KEPT, attempt)
    )
    done = {row["seed"] for row in rows_of(path)}
    wanted = [seed for seed in seeds if seed not in done]
    for row in run(path, trial, wanted, options.workers) if wanted else ():
        if row["outcome"] in WRONG:
            print(row["seed"], row["kind"], row["outcome"], row["what"])
    write(rows_of(KEPT), rows_of(COMPARED), rows_of(INPUTS), rows_of(KILLED), HERE / "reliability.md")


if __name__ == "__main__":
    main()
