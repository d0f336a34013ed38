"""Table of the comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from piezoharvest.output import write_text
from reports.optima.comparison import PROMISE


def write(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Write the page of the last row of each study."""
    last = {row["name"]: row for row in rows}
    found = [(name, kind) for name, row in last.items() for kind in row["kinds"]]
    beaten = [(name, kind) for name, kind in found if kind["gain"] > PROMISE]
    drawn, counted = (sum(kind[key] for _, kind in found) for key in ("drawn", "designs"))
    lines = [
        "# Tuned designs beside random ones\n",
        f"{len(last)} studies with random plants, {len(found)} tuned designs, {drawn:,} random ones of their kinds, of "
        f"which {counted:,} were found to move periodically (ten times the usual work is allowed). "
        "Half of them are spread over all of the region of the tuning "
        "in logarithms, half lie 1e-4 to 0.5 e-folds from the optimum. The best 40 of each (12 where they "
        "have to be simulated) are judged as the tuned design is. `python -m reports.optima` makes this page.\n",
        f"Better than the tuned design by more than {PROMISE:g}: {len(beaten)}.\n",
        "| study | kind | random designs | best of them is better by |", "|---|---|---:|---:|",
    ]  # fmt: skip
    lines += [f"| {name} | {kind['kind']} | {kind['designs']:,} | {kind['gain']:.1e} |" for name, kind in found]
    write_text("\n".join(lines) + "\n", path)
