"""Which figures the page has; their words are in figures/captions.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

from matplotlib.figure import Figure

from piezoharvest.report.figures.pictures import Picture
from reports.paper import beyond, compare, reproduction
from reports.paper.extended import bench, extended_fit
from reports.paper.figures import comparisons, harvest, in_kind
from reports.paper.tables import experiment

_RECTIFYING = ("resistor", "rectifier", "parallel SSHI", "series SSHI")


def pictures() -> Iterator[Picture]:
    """All figures, in the order of the page."""
    words = tomllib.loads((Path(__file__).parent / "figures" / "captions.toml").read_text(encoding="utf-8"))
    drawn = {**_tables(), **_in_kind(), **_harvest()}
    for name, entry in words.items():
        yield Picture(name, "page", entry["heading"], entry["caption"], drawn[name])


def _tables() -> dict[str, Figure]:
    series = {
        "Table V, one cycle": reproduction.per_cycle(),
        "Table V, summed": reproduction.summed(),
        "extended": reproduction.extended(),
    }
    groups = {
        "Tables I and II": [*compare.electrical(), *compare.hysteretic()],
        "Tables III and IV": compare.mechanical(),
        "All four": [compare.extended()],
    }
    return {
        "rows": comparisons.row_ratios({n: {c.row: c.ratios for c in results} for n, results in series.items()}),
        "records": comparisons.record_lengths(),
        "candidates": comparisons.candidate_errors(groups),
    }


def _in_kind() -> dict[str, Figure]:
    machine = bench(extended_fit().parameters)
    benches = [reproduction.table_bench(rise_time=machine.rise_time), machine]
    load = experiment()["loads_ohm"][1]
    return {
        "fig2": in_kind.play_operators(),
        "fig5": in_kind.figure_5(benches, load),
        "fig6": in_kind.figure_6(benches, load),
        "fig7": in_kind.figure_7(benches, load),
        "fig8-9": in_kind.figures_8_9(benches, load),
    }


def _harvest() -> dict[str, Figure]:
    survey = beyond.survey()
    panels = {
        f"{name}, {force / 1e3:g} kN": {kind: survey.against_drops[name, force][kind] for kind in _RECTIFYING}
        for name in ("Table V", "extended")
        for force in (500.0, 1000.0)
    }
    return {"loads": harvest.load_curves(beyond.devices()), "drops": harvest.against_drops(panels)}
