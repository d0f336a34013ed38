"""`python -m reports.identification [--specimens N] [--workers N] [--long]`: coverage of the standard errors.

What is done stands in specimens.jsonl beside this file, a line for each specimen: the same command goes on from there.
"""

import argparse
import os
from pathlib import Path

from reports.kept import rows_of, run

HERE = Path(__file__).parent
KEPT = HERE / "specimens.jsonl"


def kept() -> dict[int, dict]:
    """Specimens that are done, by seed."""
    return {row["seed"]: row for row in rows_of(KEPT)}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m reports.identification", description=__doc__)
    parser.add_argument("--specimens", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--long", action="store_true", help="ten minutes at 10 kHz too")
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from reports.identification.pages import write
    from reports.identification.specimens import identified

    wanted = [seed for seed in range(options.specimens) if seed not in kept()]
    for _ in run(KEPT, identified, wanted, options.workers) if wanted else ():
        pass
    rows = [row for seed, row in sorted(kept().items()) if seed < options.specimens]
    write(rows, HERE, _long() if options.long else None)


def _long() -> dict:
    import tempfile

    from reports.identification.memory import peak_of, write_long_record

    with tempfile.TemporaryDirectory() as folder:
        return peak_of(write_long_record(Path(folder)))._asdict()


if __name__ == "__main__":
    main()
