"""Numbers of the page: rates with exact intervals, by size, place and law."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

from reports.discovery.campaigns import IMPOSSIBLE, SITES
from reports.discovery.laws import LAWS
from reports.discovery.plan import SIGMAS

Rows = Sequence[dict[str, Any]]
OUTCOMES = ("right", "kin", "among", "missed", "wrong")
STRONG = 40.0  # sigma, from which on a place has to be found
BANDED = 0.95  # of the visited range
WANTED_GAIN, WANTED_SECONDS = 0.95, 120.0
METHODS = ("sparse regression", "gaussian process")


def share(flags: Iterable[bool]) -> dict[str, Any] | None:
    """How many of how many, with the 95 % interval of Clopper and Pearson; None of none."""
    all_ = list(flags)
    if not all_:
        return None
    ends = binomtest(sum(all_), len(all_)).proportion_ci(0.95, method="exact")
    return {"right": sum(all_), "count": len(all_), "low": float(ends.low), "high": float(ends.high)}


def of_kind(rows: Rows, kind: str) -> list[dict[str, Any]]:
    """Rows of a kind whose campaign could be made."""
    return [row for row in rows if row["kind"] == kind and row["outcome"] != "not made"]


def summary(rows: Rows) -> dict[str, Any]:
    """All numbers of one set of trials."""
    laws = of_kind(rows, "law")
    return {
        "count": len(rows), "goals": goals(rows),
        "not_made": sum(row["outcome"] == "not made" for row in rows),
        "failed": sum(row["outcome"] == "failed" for row in rows),
        "by_size": {f"{sigma:g} σ": _outcomes([r for r in laws if r["sigma"] == sigma]) for sigma in SIGMAS},
        "by_place": _by("place", SITES, _strong(laws)), "by_law": _by("law", LAWS, _strong(laws)),
        "impossible": _by("law", IMPOSSIBLE, of_kind(rows, "impossible")),
        "comparison": [_compared(laws, sigma) for sigma in SIGMAS],
        "power": _powers(laws), "seconds": _seconds(rows),
    }  # fmt: skip


def _by(key: str, names: Iterable[str], rows: Rows) -> dict[str, dict[str, int]]:
    """Answers by law or place, of those that were tried."""
    each = {name: _outcomes([row for row in rows if row[key] == name]) for name in names}
    return {name: counts for name, counts in each.items() if counts["count"]}


def _strong(laws: Rows) -> list[dict[str, Any]]:
    return [row for row in laws if row["sigma"] >= STRONG]


def _outcomes(rows: Rows) -> dict[str, int]:
    """How many were answered how; what failed with an error is missed."""
    counts = {name: sum(row["outcome"] == name for row in rows) for name in OUTCOMES}
    return {**counts, "missed": len(rows) - sum(counts.values()) + counts["missed"], "count": len(rows)}


def goals(rows: Rows) -> list[dict[str, Any]]:
    """What was asked for, what came out, and the goal."""
    laws, healthy = of_kind(rows, "law"), of_kind(rows, "healthy")
    strong = _strong(laws)
    found = [row for row in laws if row["right"]]
    inside = [each for row in rows if row["right"] and row["kind"] in ("law", "healthy") for each in row["inside"]]
    formulas = [row["formula_right"] for row in found if row["sigma"] == STRONG and "formula_right" in row]
    table = (
        ("place right, laws of 40 σ and more", (row["right"] for row in strong), "95 %"),
        ("the same, with a known effect of the true place", (row["outcome"] in ("right", "kin") for row in strong), ""),
        ("place right, laws of all sizes", (row["right"] for row in laws), ""),
        ("wrong and confident, laws of all sizes", (row["outcome"] == "wrong" for row in laws), "at most 1 %"),
        ("law within three standard errors on 95 % of the visited range, where its place is right",
         (row["banded"] >= BANDED for row in found if "banded" in row), ""),
        ("formula right at 40 σ, where there is one and its place is right", formulas, "80 %"),
        ("exponents within 0.05, where a power was found", (row["exponent_error"] <= 0.05 for row in found
                                                         if "exponent_error" in row), ""),
        ("parameters of the base model within three standard errors", inside, ""),
        ("gain of 0.95 on an unseen record, laws of 40 σ and more whose place is right",
         (row["gain"] >= WANTED_GAIN for row in found if row["sigma"] >= STRONG), ""),
        ("alarms, healthy specimens", (not row["right"] for row in healthy), "none in 300"),
        ("a law and a named effect, both right", (row["right"] for row in of_kind(rows, "pair")), ""),
        ("impossible ones answered so", (row["right"] for row in of_kind(rows, "impossible")), ""),
        ("at most 120 s of processor time", (row["cpu"] <= WANTED_SECONDS for row in rows if "cpu" in row), "all"),
    )  # fmt: skip
    return [{"name": name, "share": share(flags), "goal": goal} for name, flags, goal in table]


def _compared(laws: Rows, sigma: float) -> dict[str, Any]:
    """At one size: place and gain on the unseen record of `diagnose` and of other methods."""
    mine = [row for row in laws if row["sigma"] == sigma and row.get("others")]
    methods = {"diagnose": [(row["right"], row["gain"]) for row in mine]}
    for name in METHODS:
        methods[name] = [(row["others"][name]["right"], row["others"][name]["gain"]) for row in mine]
    return {"size": f"{sigma:g} σ", "methods": {
        name: {"place": share(right for right, _ in pairs), "gain": float(np.median([gain for _, gain in pairs]))}
        for name, pairs in methods.items() if pairs
    }}  # fmt: skip


def _powers(laws: Rows) -> dict[str, Any] | None:
    """Median relative error of the mean power of unseen records as predicted, where the place is right."""
    errors = np.array([row["power_error"] for row in laws if row["right"] and "power_error" in row])
    if not len(errors):
        return None
    before, after = np.median(errors, axis=0)
    return {"before": float(before), "after": float(after), "count": len(errors)}


def _seconds(rows: Rows) -> dict[str, float] | None:
    times = [row["cpu"] for row in rows if "cpu" in row]
    return {"median": float(np.median(times)), "most": float(max(times))} if times else None
