"""The page: what became of the studies, how well energy closes, and the worst of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.output import write_text

WORST = 10
MEANING = {
    "converged": "said to be right, and possible: finite, energy closed to 1e-6, no more harvested than comes in",
    "said": "a result said not to be right, with the reason",
    "refused": "refused in a sentence, as values do not go together",
    "impossible": "**a result that cannot be**",
    "internal error": "**an error that is none of the interface's**",
    "slow": "**more than 60 s of processor time**",
}


def write(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Write the page as Markdown."""
    write_text("\n".join(_lines(rows)) + "\n", path)


def _lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    counts = Counter(row["outcome"] for row in rows)
    closures = np.array([row["closure"] for row in rows if row["outcome"] == "converged"])
    seconds, seeds = np.array([row["seconds"] for row in rows]), [row["seed"] for row in rows]
    lines = [
        "# How hard the engine is to break", "",
        f"{len(rows)} random studies of every shunt and effect (`make torture`; seeds {min(seeds)} to "
        f"{max(seeds)}): values over twelve decades, on bounds, at resonance, at zero.", "",
        "| outcome | studies | what it is |", "|---|---|---|",
        *(f"| {name} | {counts[name]} | {words} |" for name, words in MEANING.items()), "",
    ]  # fmt: skip
    if len(closures):
        shares = ", ".join(f"{100 * q:g} %: {np.quantile(closures, q):.1e}" for q in (0.5, 0.9, 0.99, 1.0))
        lines += [f"Closure of energy, quantiles of the converged: {shares}.", ""]
    lines += [f"Processor time of one: median {np.median(seconds):.3f} s, most {seconds.max():.1f} s.", ""]
    bad = [row for row in rows if row["outcome"] in ("impossible", "internal error", "slow")]
    if bad:
        lines += ["| seed | shunt | outcome | what |", "|---|---|---|---|"]
        lines += [f"| {r['seed']} | {r['kind']} | {r['outcome']} | {r['what']} |" for r in bad]
        lines += [""]
    worst = sorted((r for r in rows if r["closure"] is not None), key=lambda r: -r["closure"])[:WORST]
    lines += ["The worst closures:", "", "| seed | shunt | closure |", "|---|---|---|"]
    return [*lines, *(f"| {r['seed']} | {r['kind']} | {r['closure']:.1e} |" for r in worst)]
