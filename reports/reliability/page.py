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


Rows = Sequence[dict[str, Any]]


def write(studies: Rows, compared: Rows, inputs: Rows, kills: Rows, path: Path) -> None:
    """Write the page as Markdown."""
    parts = ((_of_studies, studies), (_of_distances, compared), (_of_inputs, inputs), (_of_kills, kills))
    lines = [line for part, rows in parts if rows for line in part(rows)]
    write_text("\n".join(["# How hard the toolbox is to break", "", *lines]) + "\n", path)


def _of_inputs(rows: Rows) -> list[str]:
    """What became of wrong files and tables."""
    kinds, outcomes = sorted({row["kind"] for row in rows}), sorted({row["outcome"] for row in rows})
    counts = Counter((row["kind"], row["outcome"]) for row in rows)
    seconds = max(row["seconds"] for row in rows)
    lines = [
        "", "## Wrong files and tables", "",
        f"{len(rows)} inputs, valid ones made wrong where their structure is (`python -m reports.reliability --inputs`;"
        f" seeds {min(row['seed'] for row in rows)} and above), read as files or given to a command. Refused means: in "
        f"one sentence, with status 2. Processor time of one: at most {seconds:.1f} s.", "",
        f"| input | {' | '.join(outcomes)} |", "|---|" + "---|" * len(outcomes),
    ]  # fmt: skip
    lines += [f"| {kind} | {' | '.join(str(counts[kind, each]) for each in outcomes)} |" for kind in kinds]
    bad = [row for row in rows if row["outcome"] in ("internal error", "impossible", "slow")]
    return [*lines, "", *(f"- {row['seed']} ({row['kind']}) {row['outcome']}: {row['what']}" for row in bad)]


def _of_kills(rows: Rows) -> list[str]:
    """What became of commands that were killed."""
    counts = Counter((row["kind"], row["outcome"]) for row in rows)
    lines = [
        "", "## Killed and given again", "",
        f"{len(rows)} commands, killed at a random moment by SIGKILL, SIGTERM or SIGINT and given again (`python -m "
        "reports.reliability --kills`): resumed means that what was left under its own name was whole, and that the "
        "second run left the same files with the same bytes as an undisturbed one; of pages and figures, which bear "
        "dates, that they are there, all or none. After SIGKILL, which no program can answer, a hidden file may stay "
        "(`.name.part`), and a hidden folder until the next run.", "",
        "| command | resumed | not |", "|---|---|---|",
    ]  # fmt: skip
    lines += [
        f"| {kind} | {counts[kind, 'resumed']} | {counts[kind, 'impossible']} |"
        for kind in sorted({k for k, _ in counts})
    ]
    return [
        *lines,
        "",
        *(f"- {row['seed']} ({row['kind']}): {row['what']}" for row in rows if row["outcome"] != "resumed"),
    ]


def _of_distances(rows: Rows) -> list[str]:
    """How far the engine is from the bench's solver."""
    counts = Counter(row["outcome"] for row in rows)
    lines = [
        "## Beside another solver", "",
        f"{len(rows)} of such studies (seeds {min(row['seed'] for row in rows)} and above; `python -m "
        "reports.reliability --oracle`), drawn from three strata, run from rest over eight "
        "periods by the engine and by the bench's solver, with equations and a method of its own (Radau IIA). The "
        "distance is the root mean square of the difference over that of the signal, the largest of displacement and "
        "voltages.", "",
        "; ".join(f"{name}: {count}" for name, count in sorted(counts.items())) + ".", "",
        "| studies | number | median | 90 % | 99 % | most |", "|---|---|---|---|---|---|",
    ]  # fmt: skip
    done = [row for row in rows if row["distance"] is not None]
    for name in ("hysteretic", "stiff", "other"):
        found = [row["distance"] for row in done if row["stratum"] == name]
        if found:
            lines.append(f"| {name} | {len(found)} | " + " | ".join(_quantiles(found)) + " |")
    lines += ["", "The most distant:", "", "| seed | shunt | studies | distance |", "|---|---|---|---|"]
    worst = sorted(done, key=lambda row: -row["distance"])[:WORST]
    lines += [f"| {r['seed']} | {r['kind']} | {r['stratum']} | {r['distance']:.1e} |" for r in worst]
    missed = [row for row in rows if row["outcome"] == "not followed"]
    return [*lines, "", *(f"- {row['seed']} ({row['kind']}) not followed: {row['what']}" for row in missed)]


def _quantiles(values: Sequence[float]) -> list[str]:
    return [f"{np.quantile(values, q):.1e}" for q in (0.5, 0.9, 0.99, 1.0)]


def _of_studies(rows: Rows) -> list[str]:
    counts = Counter(row["outcome"] for row in rows)
    closures = np.array([row["closure"] for row in rows if row["outcome"] == "converged"])
    seconds, seeds = np.array([row["seconds"] for row in rows]), [row["seed"] for row in rows]
    lines = [
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
    return [*lines, *(f"| {r['seed']} | {r['kind']} | {r['closure']:.1e} |" for r in worst), ""]
