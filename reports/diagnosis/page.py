"""The page, its figures, and a file of its numbers."""

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
from reports.diagnosis.circuits import DRAWS as CIRCUIT_EFFECTS
from reports.diagnosis.figures import confusion_figure, coverage_figure, power_figure, time_figure
from reports.diagnosis.sensitivity import TABLE, lines
from reports.diagnosis.summary import STRONG, THEORY, Results, coverage, days, of_kind, power, share, size, smallest
from reports.diagnosis.trials import DRAWS

NAMES = list(DRAWS)
HELD_OUT_KINDS = {
    "single effects": "single",
    "two effects at once": "pair",
    "healthy specimens": "healthy",
    "steps without a rise and a multisine": "ideal",
    "effects that are not in the library": "withheld",
    "faults that are not in the vocabulary": "foreign",
}


def write_page(
    results: Results,
    directory: Path,
    *,
    alone: Results = (),
    held_out: Results = (),
    others: Results = (),
    circuits: Results = (),
) -> Path:
    """Write figures, results.json and, last, the page.

    Parameters
    ----------
    results : sequence of dict
        As `trials.run` gives them, one or more.
    directory : Path
    alone : sequence of dict
        The same of trials that had the machine to themselves.
    held_out : sequence of dict
        As `sensitivity.attempt` gives them.
    others, circuits : sequence of dict
        As `trials.held_out` and `circuits.held_out` give them.
    """
    figures = {name: figure for name, figure in _figures(results) if figure is not None}
    for name, figure in figures.items():
        style.write_png(figure, directory / f"{name}.png")
    numbers = {
        **summary(results), "alone": _alone(alone), "held_out": held_out_shares(held_out),
        "others": held_out_shares(others),
        "circuits": held_out_shares(circuits), "circuit_effects": circuit_effects(circuits),
    }  # fmt: skip
    write_text(json.dumps(numbers, indent=1, allow_nan=False) + "\n", directory / "results.json")
    text = page(
        "page.html.j2", Path(__file__).parent, figures=list(figures), wrong=list(_wrong(results)),
        thresholds=list(lines(held_out)), table=TABLE, **numbers,
    )  # fmt: skip
    write_text(text, directory / "index.html")
    return directory / "index.html"


def _figures(results: Results) -> Iterator[tuple[str, Figure | None]]:
    yield "confusion", confusion_figure(results, NAMES)
    yield "power", power_figure(results, NAMES)
    yield "coverage", coverage_figure(results)
    yield "time", time_figure(results)


def summary(results: Results) -> dict[str, Any]:
    """All numbers of the page."""
    strong = [result for result in of_kind(results, "single") if size(result) >= STRONG]
    covered = coverage(results)
    inside = sum(value * count for value, count in covered.values())
    times = [result["cpu"] for result in results if "cpu" in result]
    return {
        "shares": {
            "single effects of 10 σ or more": share(strong),
            "two effects at once": share(of_kind(results, "pair")),
            "healthy specimens": share(of_kind(results, "healthy")),
            "steps without a rise and a multisine, one effect or none": share(of_kind(results, "ideal")),
            "effects that are not in the library": share(of_kind(results, "withheld")),
            "faults that are not in the vocabulary": share(of_kind(results, "foreign")),
        },
        "alarms": sum(not result["right"] for result in of_kind(results, "healthy")),
        "power": {name: one for name in NAMES if (one := _power(results, name))},
        "power_days": days(of_kind(results, "weak")),
        "theory": THEORY,
        "coverage": {name: list(value) for name, value in sorted(covered.items())},
        "covered": inside / max(1, sum(count for _, count in covered.values())),
        "cpu_median": float(np.median(times)), "cpu_most": float(max(times)), "campaigns": len(results),
    }  # fmt: skip


def held_out_shares(held_out: Results) -> dict[str, Any]:
    """Right answers by kind and in all, of campaigns of which none was ever looked at."""
    kinds = {name: share(some) for name, kind in HELD_OUT_KINDS.items() if (some := of_kind(held_out, kind))}
    return {**kinds, "all": share(held_out)} if kinds else {}


def circuit_effects(circuits: Results) -> dict[str, Any]:
    """Right answers by effect, of single effects of circuits."""
    single = of_kind(circuits, "single")
    by_name = {name: [result for result in single if result["names"] == [name]] for name in CIRCUIT_EFFECTS}
    return {name: share(some) for name, some in by_name.items() if some}


def _alone(alone: Results) -> dict[str, Any] | None:
    """How long those took that had the machine to themselves."""
    times = [result["wall"] for result in alone if "wall" in result]
    if not times:
        return None
    return {"campaigns": len(times), "median": float(np.median(times)), "most": max(times), "days": days(alone)}


def _power(results: Results, name: str) -> dict[str, Any] | None:
    """The smallest size of an effect that is named with 90 % power, from how many trials."""
    sizes, named = power(results, name)
    found = smallest(sizes, named) if len(sizes) else None
    return found and {"smallest": found[0], "std": found[1], "trials": len(sizes)}


def _wrong(results: Results) -> Iterator[dict[str, Any]]:
    for result in results:
        if not result["right"] and result["kind"] != "weak":
            answer = " + ".join(result["found"]) or "nothing"
            left = "; ".join(
                f"{where}, {record}, {channel}" for where, record, channel, _ in result.get("left", [])[:1]
            )
            yield {
                "kind": result["kind"], "names": " + ".join(result["names"]) or "nothing", "seed": result["seed"],
                "size": f"{size(result):.0f}", "verdict": result["verdict"], "answer": answer,
                "left": result.get("error", left),
            }  # fmt: skip
