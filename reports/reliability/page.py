"""The page: what became of the trials of every kind, and the worst of them."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from piezoharvest.output import write_text

TITLES = (
    "How hard the toolbox is to break", "Beside another solver", "Wrong files and tables", "Damaged campaigns",
    "Killed and given again", "Where something is not as it should be", "Made wrong on purpose",
)  # fmt: skip
# What was found of studies that failed and of the most distant, by the seed and the commit that drew them.
FINDINGS = Path(__file__).parent / "findings.toml"
SURVIVORS = Path(__file__).parent / "survivors.toml"  # what was found when they were read, by the line before and after
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


def write(
    studies: Rows, compared: Rows, inputs: Rows, campaigns: Rows, kills: Rows, faults: Rows, mutants: Rows, path: Path
) -> None:
    """Write the page as Markdown; a section whose rows are not on this machine stays as it is."""
    parts = ((_of_studies, studies), (_of_distances, compared), (_of_inputs, inputs), (_of_campaigns, campaigns),
             (_of_kills, kills), (_of_faults, faults), (_of_mutants, mutants))  # fmt: skip
    sections = dict(zip(TITLES, ("\n".join(part(rows)).strip() if rows else "" for part, rows in parts), strict=True))
    for text in re.split(r"^(?=## )", path.read_text(encoding="utf-8"), flags=re.MULTILINE) if path.exists() else ():
        title = text.partition("\n")[0].removeprefix("## ")
        known = title if title in sections else TITLES[0]
        sections[known] = sections[known] or text.partition("\n")[2].strip()
    found = (f"{'## ' if n else '# '}{title}\n\n{sections[title]}" for n, title in enumerate(TITLES) if sections[title])
    write_text("\n\n".join(found) + "\n", path)


def _of_mutants(rows: Rows) -> list[str]:
    """Which mutants the tests have seen, and what is said of those that they have not."""
    drawn, last = {}, {}
    for row in rows:  # those that survived may have been tried again, with the tests that were added
        drawn.setdefault(row["seed"], row)
        last[row["seed"]] = row
    left_over = [row for row in drawn.values() if row["outcome"] == "survived"]
    not_seen = [row for row in last.values() if row["outcome"] == "survived"]
    sentences = tomllib.loads(SURVIVORS.read_text(encoding="utf-8"))
    lines = [
        f"{len(drawn)} random mutants of equations, event code, motion, steady states and likelihood (`python -m "
        f"reports.reliability --mutants N`; seeds {min(drawn)} to {max(drawn)}), by the operators of cosmic-ray; a "
        "place in the code is drawn first, then what may stand there instead. The quick tests of its part are run on "
        "each, no others: the whole suite may see more. One that no longer ends counts as seen.", "",
        f"Seen: {_share(list(drawn.values()))}. Of the {len(left_over)} survivors {len(left_over) - len(not_seen)} are "
        "seen by the tests that were added for them, each tried with its test alone. That is no estimate of what the "
        "tests see now: others would have to be drawn for it.", "",
        "| part | mutants | killed | timeout | survived | survived at last |", "|---|---|---|---|---|---|",
    ]  # fmt: skip
    counts = Counter((_part_of(row), row["outcome"]) for row in drawn.values())
    left = Counter(map(_part_of, not_seen))
    for part in sorted({part for part, _ in counts}):
        each = [counts[part, outcome] for outcome in ("killed", "timeout", "survived")]
        lines.append(f"| {part} | {sum(each)} | {' | '.join(map(str, each))} | {left[part]} |")
    lines += ["", "The survivors, with what was found when they were read:", ""]
    for row in sorted(left_over, key=lambda row: row["seed"]):
        now = last[row["seed"]]
        seen = "not seen" if now["outcome"] == "survived" else f"seen now by `{now['test']}`"
        where = f"`{row['kind']}`, line {row['line']}, {row['operator']}"
        said = sentences.get(row["what"], "not read yet.")
        lines.append(f"- {row['seed']}, {where}: `{row['what']}` ({seen}). {said}")
    return lines


def _part_of(row: dict[str, Any]) -> str:
    return str(Path(row["kind"]).parent.relative_to("piezoharvest"))


def _share(rows: Rows) -> str:
    """Share of mutants that are seen, with its interval."""
    seen = sum(row["outcome"] != "survived" for row in rows)
    low, high = binomtest(seen, len(rows)).proportion_ci(0.95, "exact")
    shares = [f"{100 * share:.0f}" for share in (seen / len(rows), low, high)]
    return "{} of {}, {} % (95 % by Clopper-Pearson: {} to {} %)".format(seen, len(rows), *shares)


def _of_inputs(rows: Rows) -> list[str]:
    """What became of wrong files and tables."""
    kinds, outcomes = sorted({row["kind"] for row in rows}), sorted({row["outcome"] for row in rows})
    counts = Counter((row["kind"], row["outcome"]) for row in rows)
    files, tables = ([row for row in rows if ("." in row["kind"]) == is_file] for is_file in (True, False))
    lines = [
        f"{len(files)} files and {len(tables)} sets of tables, valid ones made wrong where their structure is (`python "
        f"-m reports.reliability --inputs`; seeds {min(row['seed'] for row in rows)} and above), read, or given to a "
        "command, in 2 GiB of memory. Refused means: in one sentence, with status 2. Processor time of one: at most "
        f"{_most_seconds(files)} s of a file, {_most_seconds(tables)} s of tables.", "",
        f"| input | {' | '.join(outcomes)} |", "|---|" + "---|" * len(outcomes),
    ]  # fmt: skip
    lines += [f"| {kind} | {' | '.join(str(counts[kind, each]) for each in outcomes)} |" for kind in kinds]
    bad = [row for row in rows if row["outcome"] in ("internal error", "impossible", "slow")]
    wrong = [f"- {row['seed']} ({row['kind']}) {row['outcome']}: {row['what']}" for row in bad]
    return [
        *lines,
        *([""] if wrong else []),
        *wrong,
        "",
        "What was found, and is refused or read now:",
        "",
        *_findings("inputs"),
    ]


def _of_campaigns(rows: Rows) -> list[str]:
    """What became of campaigns, and how far healthy specimens are from the truth."""
    kinds, outcomes = sorted({row["kind"] for row in rows}), sorted({row["outcome"] for row in rows})
    counts = Counter((row["kind"], row["outcome"]) for row in rows)
    lines = [
        f"{len(rows)} random campaigns of every circuit, excitation and kind of record, measured by the bench's solver,"
        " most of them damaged as real ones are, or described wrongly (`python -m reports.reliability --campaigns`; "
        f"seeds {_ranges([row['seed'] for row in rows])}); given to `check` and then to one more command, whose JSON, "
        "saved specimen and report are looked at. Refused means: in one sentence, with status 2; slow: more than "
        "240 s of processor time; no campaign: nothing was found that the bench can measure.", "",
        f"| command | {' | '.join(outcomes)} |", "|---|" + "---|" * len(outcomes),
    ]  # fmt: skip
    lines += [f"| {kind} | {' | '.join(str(counts[kind, each]) for each in outcomes)} |" for kind in kinds]
    healthy = [value for row in rows if row["damage"] == ["healthy"] and row["outcome"] == "done"
               for value in row.get("deviations", {}).values()]  # fmt: skip
    if healthy:
        far = int(np.sum(np.abs(healthy) > 4.0))
        lines += ["", f"Of {len(healthy)} parameters of healthy specimens in results with status 0, {far} are more "
                  "than four standard errors from the truth."]  # fmt: skip
    bad = [row for row in rows if row["outcome"] in ("internal error", "impossible", "slow")]
    lines += ["", *(f"- {row['seed']} ({row['kind']}) {row['outcome']}: {row['what']}" for row in bad)]
    return [*lines, "", "What was found, and is not so now:", "", *_findings("campaigns")]


def _most_seconds(rows: Rows) -> str:
    return f"{max((row['seconds'] for row in rows), default=0.0):.1f}"


def _of_kills(rows: Rows) -> list[str]:
    """What became of commands that were killed."""
    counts = Counter((row["kind"], row["outcome"]) for row in rows)
    lines = [
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


def _of_faults(rows: Rows) -> list[str]:
    """What became of commands under a fault."""
    counts = Counter((row["kind"], row["outcome"]) for row in rows)
    commands = sorted({row["what"].partition(":")[0] for row in rows})
    lines = [
        f"{len(rows)} runs of {', '.join(commands)} (`python -m reports.reliability --faults`). Done means that the "
        "result is that of an undisturbed run; said, that the command gave the reason in one sentence with status 1 or "
        "2 (141 and no error where its reader has gone), and that what stands under its own name is whole. In either "
        "case the same command, without the fault, leaves the same bytes; of pages and figures, which bear dates, that "
        "they are there. A scheduler that is silent, wrong or gone is in `tests/sweep/test_sweep_dask.py`.", "",
        "| fault | done | said | not |", "|---|---|---|---|",
    ]  # fmt: skip
    for kind in dict.fromkeys(row["kind"] for row in rows):
        lines.append(f"| {kind} | " + " | ".join(str(counts[kind, o]) for o in ("done", "said", "impossible")) + " |")
    bad = [row for row in rows if row["outcome"] == "impossible"]
    return [*lines, "", *(f"- {row['seed']} ({row['kind']}) {row['what']}" for row in bad)]


def _findings(part: str) -> list[str]:
    """Sentences about trials of one part."""
    found = tomllib.loads(FINDINGS.read_text(encoding="utf-8")).get(part, [])
    return [f"- {each['seed']} of {each['commit']} ({each['kind']}): {each['found']}" for each in found]


def _of_distances(rows: Rows) -> list[str]:
    """How far the engine is from the bench's solver."""
    counts = Counter(row["outcome"] for row in rows)
    lines = [
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
    lines += ["", "What was found of the most distant, of this run and an earlier one:", "", *_findings("distances")]
    missed = [row for row in rows if row["outcome"] == "not followed"]
    lines += ["", "Not followed by the bench's solver:", ""]
    return [*lines, *(f"- {row['seed']} ({row['kind']}): {row['what']}" for row in missed)]


def _quantiles(values: Sequence[float]) -> list[str]:
    return [f"{np.quantile(values, q):.1e}" for q in (0.5, 0.9, 0.99, 1.0)]


def _ranges(seeds: Sequence[int]) -> str:
    """First and last of each run of seeds."""
    found = np.array(sorted(seeds))
    runs = np.split(found, np.flatnonzero(np.diff(found) > 1) + 1)
    return ", ".join(f"{run[0]} to {run[-1]}" for run in runs)


def _of_studies(rows: Rows) -> list[str]:
    counts = Counter(row["outcome"] for row in rows)
    closures = np.array([row["closure"] for row in rows if row["outcome"] == "converged"])
    seconds, seeds = np.array([row["seconds"] for row in rows]), [row["seed"] for row in rows]
    lines = [
        f"{len(rows)} random studies of every shunt and effect (`make torture`; seeds {_ranges(seeds)}): values over "
        "twelve decades, on bounds, at resonance, at zero.", "",
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
        lines += ["", *_findings("studies"), ""]
    worst = sorted((r for r in rows if r["closure"] is not None), key=lambda r: -r["closure"])[:WORST]
    lines += ["The worst closures:", "", "| seed | shunt | closure |", "|---|---|---|"]
    return [*lines, *(f"| {r['seed']} | {r['kind']} | {r['closure']:.1e} |" for r in worst), ""]
