"""The page and the file of numbers beside it."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from piezoharvest.output import write_text
from piezoharvest.report.frame.rendering import page
from reports.actuators.data import LEVELS
from reports.actuators.results import as_json, comparison, mirror_results, stack_results

_STRONG = 0.05  # share of the responses' energy


def write_page(directory: Path) -> Path:
    """Write results.json and, last, the page; the figures are there."""
    results = {"stack": stack_results(), "mirror": mirror_results()}
    write_text(as_json(results), directory / "results.json")
    captions = tomllib.loads((Path(__file__).parent / "captions.toml").read_text(encoding="utf-8"))
    content = {"captions": captions, "levels": LEVELS, "rows": comparison(), **results, **_words(results)}
    write_text(page("page.html.j2", Path(__file__).parent, **content), directory / "index.html")
    return directory / "index.html"


def _words(results: dict[str, Any]) -> dict[str, Any]:
    """Shares and differences that the text quotes."""
    stack, mirror = results["stack"], results["mirror"]
    windows = list(stack["tracking_um"].values())
    names = [step["name"] for step in stack["breakdown"]]
    squares = [sum(value**2 for value in step["windows"]) for step in stack["breakdown"]]
    noise = 2 * stack["noise_um"]["cycle to cycle"] ** 2
    shares = [(names[n], (squares[n - 1] - squares[n]) / squares[0]) for n in range(1, len(names))]
    shares += [("noise", noise / squares[0]), ("not explained", (squares[-1] - noise) / squares[0])]
    # A mode beyond the excited lines stands for many: what becomes of it says nothing of the structure.
    modes = [mode for mode in mirror["modes_by_level"] if mode["frequency"] < 3000]
    strong = [mode for mode in modes if mode["share"] > _STRONG]
    ratios = [mode["shift_of_the_P-I_model"] / mode["shifts"][-1] for mode in strong]
    weak = [mode for mode in modes if mode["share"] <= _STRONG]
    gains = mirror["gain_20_100_Hz_um_per_V"]
    moved = [mode["shifts"][-1] for mode in modes]
    by_name = {row.name: row for row in comparison()}
    hysteretic = next(row for name, row in by_name.items() if name.startswith("P-I"))
    return {
        "predicted": max(w["predicted for our inverse"] for w in windows),
        "shares": shares,
        "gain_change": gains[-1] / gains[0] - 1,
        "strong": strong, "ratios": ratios, "energy": sum(mode["share"] for mode in strong),
        "weak": sum(m["shift_of_the_P-I_model"] for m in weak) / sum(m["shifts"][-1] for m in weak),
        "largest_shift": min(moved), "down": sum(shift < 0 for shift in moved), "modes": len(moved),
        "hysteretic": hysteretic,
    }  # fmt: skip
