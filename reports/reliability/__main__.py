"""`python -m reports.reliability [--first N] [--oracle | ... | --mutants N]`: how hard it is to break.

Studies of every shunt and effect are simulated; with `--oracle` some are run by the bench's solver, too; with
`--inputs` wrong files and tables are given to the program, with `--campaigns` damaged campaigns; with `--kills`
commands are killed and given again; with `--faults` they meet a full disk and the like; with `--mutants` the code
itself is made wrong, and tests have to see it.
What is done stands beside this file, a line for each: the same command goes on from there.
"""

import argparse
from pathlib import Path

from reports.kept import rows_of, run

HERE = Path(__file__).parent
NAMES = ("trials", "oracle", "inputs", "campaigns", "kills", "faults", "mutants")
STUDIES, ORACLE, INPUTS, CAMPAIGNS, KILLS, FAULTS, MUTANTS = PATHS = tuple(HERE / f"{name}.jsonl" for name in NAMES)
ALL = 50_000
WRONG = ("impossible", "internal error", "slow", "not followed", "survived")


def main() -> None:
    """Run the trials that are not done yet, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m reports.reliability", description=__doc__)
    parser.add_argument("--first", type=int, default=ALL, metavar="N", help="the first N trials")
    parser.add_argument("--begin", type=int, default=0, metavar="SEED", help="the seed of the first")
    parser.add_argument("--workers", type=int, default=2)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--oracle", action="store_true", help="compare a stratified sample with the bench's solver")
    which.add_argument("--inputs", action="store_true", help="wrong files and tables instead of studies")
    which.add_argument("--campaigns", action="store_true", help="measured campaigns, damaged, for what reads campaigns")
    which.add_argument("--kills", action="store_true", help="kill commands at random moments, and give them again")
    which.add_argument("--faults", action="store_true", help="give commands a full disk, a closed folder and others")
    which.add_argument("--mutants", type=int, metavar="N", help="the first N mutants (one process; extra `mutation`)")
    options = parser.parse_args()
    if options.mutants:
        options.first, options.workers = options.mutants, 1  # of which all stand in the same copy of the tree
    from reports.reliability.campaigns import attempt_campaign
    from reports.reliability.faults import PAIRS, attempt_fault
    from reports.reliability.inputs import attempt_input
    from reports.reliability.kills import attempt_kill
    from reports.reliability.oracle import compare, sample
    from reports.reliability.page import write
    from reports.reliability.trial import attempt

    jobs = ((options.oracle, ORACLE, compare), (options.inputs, INPUTS, attempt_input),
            (options.campaigns, CAMPAIGNS, attempt_campaign), (options.kills, KILLS, attempt_kill),
            (options.faults, FAULTS, attempt_fault), (True, STUDIES, attempt))  # fmt: skip
    path, trial = next((path, trial) for wanted, path, trial in jobs if wanted)
    if options.mutants:
        try:
            from reports.reliability.mutants import attempt_mutant
        except ModuleNotFoundError as error:
            parser.error(f"--mutants needs {error.name}, which the extra `mutation` installs")
        path, trial = MUTANTS, attempt_mutant
    if options.faults:
        options.first = min(options.first, len(PAIRS))  # each command with each fault; others from --begin on
    seeds = sample(options.begin) if options.oracle else range(options.begin, options.begin + options.first)
    done = {row["seed"] for row in rows_of(path)}
    todo = [seed for seed in seeds if seed not in done]
    for row in run(path, trial, todo, options.workers) if todo else ():
        if row["outcome"] in WRONG:
            print(row["seed"], row["kind"], row["outcome"], row["what"], flush=True)
    write(*map(rows_of, PATHS), HERE / "reliability.md")


if __name__ == "__main__":
    main()
