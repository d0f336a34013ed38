"""What was promised, and what was measured."""

from __future__ import annotations

import math
from typing import NamedTuple

GIB = 2**30


class Goal(NamedTuple):
    """A figure with its limit: `at_most`, or at least; no figure where it was not measured, and why."""

    what: str
    limit: float
    unit: str
    at_most: bool
    found: float | None
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether it is kept; None where it was not measured."""
        if self.found is None:
            return None
        return self.found <= self.limit if self.at_most else self.found >= self.limit


def own(section: dict) -> dict:
    """Row of piezoharvest itself in a section."""
    return section["rows"][0]


def goals(results: dict) -> list[Goal]:
    """All goals of a run."""
    return [*_runs(results), *_steady(results["steady"]), *_sweep(results["sweep"]), *_start(results["startup"]),
            *_gradient(results["gradient"]), *_explorer(results["explorer"])]  # fmt: skip


def exponent(sizes: list[float], seconds: list[float]) -> float:
    """Slope of time against size in logarithms, from the smallest to the largest: 1 is linear."""
    return math.log(seconds[-1] / seconds[0]) / math.log(sizes[-1] / sizes[0])


def _runs(results: dict) -> list[Goal]:
    plain, stops, record, flips = (results[name] for name in ("sshi", "sshi_stops", "record", "sshc"))
    scaling = results["scaling"]
    slope = exponent([row["periods"] for row in scaling], [row["seconds"] for row in scaling])
    *usual, dense = results["campaign"]  # the last one is a multisine whose events are dense
    tones = dense["title"].rsplit(", ", 2)[0]
    slowest, worst = max(row["seconds"] for row in usual), max(row["error"] for row in results["campaign"])
    whole = own(record)["seconds"] * record["samples"]
    return [
        Goal("transient, parallel SSHI, a period", 3e-6, "s", True, own(plain)["seconds"], "wanted: 1 µs"),
        Goal("its state error against DOP853", 1e-9, "", True, own(plain)["error"]),
        Goal("with three P-I operators, a period", 10e-6, "s", True, own(stops)["seconds"]),
        Goal("its state error against DOP853", 1e-9, "", True, own(stops)["error"]),
        Goal(f"transient, {flips['title']}, a period", 5e-6, "s", True, flips["seconds"], _events(flips)),
        Goal("exponent of time against periods", 1.05, "", True, slope, "1 is linear"),
        Goal("record of 10 s at 1 kHz, three P-I operators, at most", 1e-3, "s", True, slowest, "steps, sines, tones"),
        Goal("its state error against DOP853", 1e-9, "", True, worst, "each of them"),
        Goal(f"the same of a {tones}", 1e-3, "s", True, dense["seconds"], f"{dense['events']:,} events"),
        Goal("the same of noise, 5-80 Hz", 1e-3, "s", True, whole, f"{record['events']:,} events"),
        Goal("its state error against DOP853", 1e-9, "", True, own(record)["error"]),
    ]


def _events(section: dict) -> str:
    return f"{section['events']:.3g} events, {section['date']}"


def _steady(rows: list[dict]) -> list[Goal]:
    worst = max(row["period_evaluations"] for row in rows)
    error = max(max(row["state_error"], row["power_error"]) for row in rows)
    return [
        Goal("steady state from a cold start, period evaluations at most", 30, "", True, worst, "1 nF to 1 mF"),
        Goal("its error against the long transient", 1e-6, "", True, error),
    ]


def _sweep(sweep: dict) -> list[Goal]:
    rows, missing = sweep.get("rows", []), sweep.get("skipped", "")
    found = []
    for workers, least, note in ((1, 5000, "wanted: 20000/s"), (2, 9000, "")):
        mine = [row for row in rows if row["workers"] == workers]
        rate = max((row["designs"] / row["seconds"] for row in mine), default=None)
        found.append(Goal(f"sweep, {workers} core(s)", least, "designs/s", False, rate, missing or note))
    memory = max((row["memory"] / GIB for row in rows if row["designs"] >= 100_000), default=None)
    why = missing or ("" if memory else "left out: it would take too long")
    found.append(Goal("memory of 100,000 designs", 1.0, "GiB", True, memory, why))
    alone = [row for row in rows if row["workers"] == 1]
    # From the second size on: the start of the process is not what grows.
    slope = exponent([r["designs"] for r in alone[1:]], [r["seconds"] for r in alone[1:]]) if len(alone) > 2 else None
    found.append(Goal("exponent of time against designs", 1.05, "", True, slope, missing or "1 is linear"))
    error = sweep.get("power_error")
    found.append(Goal("error of its power against long transients", 1e-6, "", True, error, missing))
    return found


def _start(startup: dict) -> list[Goal]:
    limits = {"import": 0.3, "help": 0.6, "first_simulate": 15.0, "next_simulate": 1.5}
    words = {
        "import": "`import piezoharvest`", "help": "`piezoharvest --help`",
        "first_simulate": "first `simulate` after an installation", "next_simulate": "the next one",
    }  # fmt: skip
    return [Goal(words[name], limit, "s", True, startup[name], "whole process") for name, limit in limits.items()]


def _gradient(gradient: dict) -> list[Goal]:
    what = "gradient to all parameters, in steady states"
    return [Goal(what, 3.0, "", True, gradient.get("ratio"), gradient.get("skipped", ""))]


def _explorer(explorer: dict) -> list[Goal]:
    slowest = max(explorer["rows"], key=lambda row: row["seconds"])
    what = "an answer of `explore` with its bound, without the drawing, at most"
    return [Goal(what, 0.1, "s", True, slowest["seconds"], slowest["title"])]
