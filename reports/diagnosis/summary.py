"""Numbers of the trials: how often the right cause, false alarms, power, coverage, time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import beta, norm, theilslopes

Results = Sequence[dict[str, Any]]
OUTCOMES = ("adequate", "unexplained", "failed")
THEORY = 4.6  # sigma found with 90 % power at 1 % false alarms over twelve candidates
STRONG = 10.0  # sigma, from which an effect has to be named


def of_kind(results: Results, *kinds: str) -> list[dict[str, Any]]:
    """Results of some kinds of trial."""
    return [result for result in results if result["kind"] in kinds]


def size(result: dict[str, Any]) -> float:
    """Size in sigma: what was reached, or where the effect was not even fitted, what was aimed at."""
    return result.get("reached") or result["sigma"]


def share(results: Results) -> dict[str, Any]:
    """How many are right of how many, with the 95 % interval of Clopper and Pearson, and when they were diagnosed."""
    n, k = len(results), sum(result["right"] for result in results)
    low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
    return {"right": k, "count": n, "low": low, "high": high, "days": days(results)}


def days(results: Results) -> str:
    """When these were diagnosed: a search that has changed since may answer otherwise."""
    found = sorted({result["diagnosed"][:10] for result in results if "diagnosed" in result})
    return " to ".join(dict.fromkeys((found[0], found[-1]))) if found else "–"


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


def power(results: Results, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Size in sigma of every weak trial of an effect, and whether the effect was named.

    What a fit reaches is the size give or take one. Trials of one seed are of one specimen with one noise, so that what
    they reach grows by the sizes alone: the slope over the sizes aimed at tells what a unit of these really is. It is
    the median of the slopes between any two (Theil & Sen), as a fit without the effect may be caught beside its
    minimum, beside which the effect reaches twice its size.
    """
    sizes, named = [], []
    mine = [result for result in of_kind(results, "weak") if result["names"] == [name]]
    for seed in sorted({result["seed"] for result in mine}):
        one = [result for result in mine if result["seed"] == seed]
        told = [(result["reached"], result["sigma"]) for result in one if result["reached"] is not None]
        if len(told) < 2:
            continue
        unit = float(theilslopes(*zip(*told, strict=True)).slope)
        sizes += [unit * result["sigma"] for result in one]
        # Right is also an effect among those that the records cannot tell.
        named += [result["right"] or (name in result["found"] and result["verdict"] != "unexplained") for result in one]
    return np.array(sizes), np.array(named, bool)


def smallest(sizes: np.ndarray, named: np.ndarray) -> tuple[float, float] | None:
    """Size in sigma that is named with 90 % power, and its standard error; None where the trials do not bound it.

    What is reached scatters by one (Wilks), so that the power is a normal distribution of that width about a threshold,
    which is fitted by maximum likelihood.
    """
    if named.all() or not named.any():
        return None

    def surprise(threshold: float) -> float:
        return -float(np.sum(norm.logcdf(np.where(named, sizes - threshold, threshold - sizes))))

    threshold = float(minimize_scalar(surprise, bounds=(float(min(sizes)) - 5, float(max(sizes)) + 5)).x)
    share = norm.cdf(sizes - threshold)
    information = np.sum(norm.pdf(sizes - threshold) ** 2 / np.maximum(share * (1 - share), 1e-12))
    return threshold + float(norm.ppf(0.9)), float(information**-0.5)


def coverage(results: Results) -> dict[str, tuple[float, int]]:
    """Share of the parameters within three standard errors of the truth, by parameter; of right answers."""
    inside: Counter[str] = Counter()
    count: Counter[str] = Counter()
    for result in results:
        if not result["right"] or result["kind"] in ("withheld", "foreign"):
            continue
        for name, deviation in result["deviations"].items():
            count[name] += 1
            inside[name] += abs(deviation) <= 3
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
