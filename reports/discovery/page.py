"""The page of both sets of trials and of the real data."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from piezoharvest.output import write_text
from piezoharvest.report.figures import style
from piezoharvest.report.frame.rendering import page
from reports.discovery.campaigns import Trial, drawn_of
from reports.discovery.figures import gain_figure, gallery_figure, outcome_figure, real_figure
from reports.discovery.plan import plan
from reports.discovery.summary import METHODS, OUTCOMES, Rows, summary


def write_page(development: Rows, held_out: Rows, directory: Path) -> Path:
    """Write figures, results.json and, last, the page.

    Parameters
    ----------
    development, held_out : sequence of dict
        As `trials.attempt` and `trials.held_out` give them.
    directory : Path
        Where `real.json` may lie, what was found in real data.
    """
    file = directory / "real.json"
    real = json.loads(file.read_text(encoding="utf-8")) if file.exists() else []
    figures = {name: figure for name, figure in _figures(development, held_out, real) if figure is not None}
    for name, figure in figures.items():
        style.write_png(figure, directory / f"{name}.png")
    sets = {"held-out": summary(held_out), "development": summary(development)}
    write_text(json.dumps(sets, indent=1, allow_nan=False) + "\n", directory / "results.json")
    text = page(
        "page.html.j2", Path(__file__).parent, figures=list(figures), sets=sets,
        drawn="held-out" if held_out else "development",
        planned=len(plan(held_out=True)), wrong=list(_wrong(development)), outcomes=OUTCOMES, methods=METHODS,
        real=real,
    )  # fmt: skip
    write_text(text, directory / "index.html")
    return directory / "index.html"


def _figures(development: Rows, held_out: Rows, real: Rows) -> Iterator[tuple[str, Figure | None]]:
    drawn = held_out or development
    yield "outcomes", outcome_figure(drawn)
    yield "gains", gain_figure(drawn)
    yield "gallery", gallery_figure(development, _law_of)
    yield "real", real_figure(real)


def _law_of(row: dict[str, Any]) -> Any:
    """The true law of a row in SI units, drawn again from its seed."""
    truth = row["truth"]
    drawn = drawn_of(Trial(*(row[name] for name in ("kind", "law", "place", "sigma", "seed"))))
    return lambda x: truth["strength"] * drawn.of(np.asarray(x) / truth["size"])


def _wrong(development: Rows) -> Iterator[dict[str, Any]]:
    """Development trials that were not answered right, the weak ones left out."""
    for row in development:
        if row["right"] or row["outcome"] == "not made" or (row["kind"] == "law" and row["sigma"] < 40.0):
            continue
        found = [f"{each['place']} of {each['input']} ({each['form']})" for each in row.get("found", ())]
        site = row.get("truth", {}).get("site")
        yield {
            "there": f"{row['law']} at {site[0]} of {site[1]}" if site else row["law"] or "nothing",
            "kind": row["kind"], "seed": row["seed"], "sigma": row["sigma"], "verdict": row.get("verdict", "failed"),
            "answer": " + ".join([*row.get("effects", ()), *found]) or row.get("error", "nothing"),
            "outcome": row["outcome"],
        }  # fmt: skip
