"""Numbers of the trials: how often the right cause, false alarms, power, coverage, time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import beta

Results = Sequence[dict[str, Any]]
OUTCOMES = ("adequate", "unexplained", "failed")
STRONG = 10.0  # sigma, from which an effect has to be named


def of_kind(results: Results, *kinds: str) -> list[dict[str, Any]]:
    """Results of some kinds of trial."""
    return [result for result in results if result["kind"] in kinds]


def size(result: dict[str, Any]) -> float:
    """Size in sigma: what was reached, or where the effect was not even fitted, what was aimed at."""
    return result.get("reached") or result["sigma"]


def share(results: Results) -> dict[str, Any]:
    """How many are right of how many, with the 95 % interval of Clopper and Pearson."""
    n, k = len(results), sum(result["right"] for result in results)
    low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
    return {"right": k, "count": n, "low": low, "high": high}


def confusion(results: Results, names: Sequence[str]) -> tuple[list[str], np.ndarray]:
    """Columns, and counts (effects, columns), of what single effects of ten sigma or more were called.

    Two effects where there is one count as "more than one"; an ambiguous verdict by its likeliest.
    """
    columns = [*names, "more than one", *OUTCOMES]
    table = np.zeros((len(names), len(columns)), int)
    for result in of_kind(results, "single"):
        if size(result) < STRONG:
            continue
        found = result["found"]
        called = result["verdict"]
        if called in ("effect", "ambiguous"):
            called = found[0] if len(found) == 1 else "more than one"
        table[names.index(result["names"][0]), columns.index(called)] += 1
    return columns, table


def power(results: Results, name: str) -> list[tuple[float, float, int]]:
    """Size aimed at in sigma, share of the trials in which the effect was named, and their number."""
    mine = [result for result in of_kind(results, "weak") if result["names"] == [name]]
    sizes = sorted({result["sigma"] for result in mine})
    groups = [[result for result in mine if result["sigma"] == sigma] for sigma in sizes]
    return [
        (s, float(np.mean([name in r["found"] for r in group])), len(group))
        for s, group in zip(sizes, groups, strict=True)
    ]


def coverage(results: Results) -> dict[str, tuple[float, int]]:
    """Share of the parameters within three standard errors of the truth, by parameter; of right answers."""
    inside: Counter[str] = Counter()
    count: Counter[str] = Counter()
    for result in results:
        if not result["right"] or result["kind"] == "withheld":
            continue
        for name, (truth, value, std) in result["parameters"].items():
            count[name] += 1
            inside[name] += abs(value - truth) <= 3 * std
        for name, truth, value, std in effect_values(result):
            count[name] += 1
            inside[name] += abs(value - truth) <= 3 * std
    return {name: (inside[name] / number, number) for name, number in count.items()}


def effect_values(result: dict[str, Any]) -> list[tuple[str, float, float, float]]:
    """Name, truth, value and standard error of what was fitted of effects that are there."""
    rows = []
    for effect, values in zip(result["found"], result["values"], strict=True):
        for name, (value, std, _) in values.items():
            truth = result["truth"].get(effect, {}).get(name)
            if std is not None and isinstance(truth, int | float):
                rows.append((f"{effect}: {name}", float(truth), float(value), float(std)))
    return rows
