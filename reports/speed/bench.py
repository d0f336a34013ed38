"""Measure everything and write reports/speed: what `python -m reports.speed` and `make bench` do."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from piezoharvest.output import atomic
from reports.speed import campaign, explorer, gradient, pages, plots, startup, steady, studies, sweep, transient
from reports.speed.goals import goals
from reports.speed.timing import machine, once

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Extent:
    """How much is measured; the smoke test measures less."""

    runs: transient.Sizes = field(default_factory=transient.Sizes)
    capacitors: tuple[float, ...] = steady.CAPACITORS
    designs: tuple[int, ...] = sweep.DESIGNS
    workers: tuple[int, ...] = sweep.WORKERS
    repeats: int = 5
    fresh: bool = True


def measure(
    extent: Extent, say: Callable[[str], None] = lambda text: None, kept: dict | None = None, only: tuple[str, ...] = ()
) -> dict:
    """Run every measurement, one after the other; with `only` these parts, the others being those of a `kept` run."""
    plain, stops = studies.sshi(), studies.sshi(stops=True)
    parts: dict[str, Callable[[], object]] = {
        "machine": machine,
        "sshi": lambda: transient.periodic(plain, extent.runs),
        "sshi_stops": lambda: transient.periodic(stops, extent.runs),
        "sshc": lambda: transient.alone(studies.sshc(), extent.runs),
        "record": lambda: transient.recorded(extent.runs),
        "campaign": lambda: campaign.measure(extent.runs),
        "scaling": lambda: transient.scaling(plain, extent.runs),
        "steady": lambda: steady.measure(extent.capacitors, extent.repeats),
        "gradient": lambda: gradient.measure(extent.repeats),
        "explorer": lambda: explorer.measure(extent.repeats),
        "sweep": lambda: sweep.measure(extent.designs, extent.workers),
        "startup": lambda: startup.measure(extent.repeats, extent.fresh),
    }
    results = {}
    for name, work in parts.items():
        if only and name not in only:
            results[name] = (kept or {})[name]
            continue
        results[name], seconds = once(work)
        say(f"{name}: {seconds:.1f} s")
    results["goals"] = [{**goal._asdict(), "met": goal.met} for goal in goals(results)]
    return results


def write(results: dict, folder: Path) -> None:
    """Write the table, the JSON and the figures."""
    for name, text in (("speed.json", json.dumps(results, indent=1) + "\n"), ("speed.md", pages.page(results))):
        with atomic(folder / name) as temporary:
            Path(temporary).write_text(text, encoding="utf-8")
    plots.draw(results, folder)


def main() -> None:
    """Measure all parts, or those that are named beside what is kept; write, and say which promises are not kept."""
    only = tuple(sys.argv[1:])
    kept = json.loads((HERE / "speed.json").read_text(encoding="utf-8")) if only else None
    results = measure(Extent(), lambda text: print(text, flush=True), kept, only)
    write(results, HERE)
    pages.refresh(HERE.parents[1] / "docs" / "validation.md", results)
    for goal in goals(results):
        if goal.met is False:
            print(f"not kept: {goal.what}: {goal.found:.3g} {goal.unit}".rstrip())
    print("written: reports/speed/speed.md, speed.json and figures; the table in docs/validation.md")
