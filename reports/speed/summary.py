"""The short table: what docs/validation.md shows of the results."""

from __future__ import annotations

from reports.speed.goals import own
from reports.speed.words import capacitance, error, figures, markdown, seconds

COARSE = 1e-3  # error within which an alternative's cheapest run is chosen
NAMES = ("NumPy exact", "solve_ivp LSODA", "solve_ivp DOP853", "ngspice")


def chosen(section: dict, name: str, limit: float = COARSE) -> dict | None:
    """The cheapest run of an alternative within an error; of ngspice the first whose answer holds."""
    rows = [row for row in section["rows"] if row["alternative"] == name]
    fitting = [row for row in rows if (row["holds"] if name == "ngspice" else row["error"] <= limit)]
    return min(fitting, key=lambda row: row["seconds"], default=None)


def summary(results: dict) -> str:
    """The short table: a column for each alternative, time, error and ratio in its cells."""
    rows = []
    for key, words, count in (
        ("sshi", "a period of parallel SSHI, 8 events", 1),
        ("sshi_stops", "with three P-I operators, 20 events", 1),
        (
            "record",
            f"a record of noise, {results['record']['samples']:,} samples, {results['record']['events']:,} events",
            results["record"]["samples"],
        ),
    ):
        section, mine = results[key], own(results[key])
        cells = [f"**{seconds(mine['seconds'] * count)}**, {error(mine['error'])}"]
        cells += [_cell(chosen(section, name), mine, count) for name in NAMES]
        rows.append([words, *cells])
    for row in results["steady"]:
        if row["smoothing_capacitance"] in _shown(results["steady"]):
            rows.append(_steady_row(results, row))
    rows.append(_sweep_row(results))
    text = markdown(["", "piezoharvest", *NAMES], rows)
    info = results["machine"]
    return text + (
        f"\nTime, error of the state, and ratio to piezoharvest's time. Of each alternative it is the cheapest run "
        f"with an error within {COARSE:g} (ngspice: the step halved until the power holds within 0.1 %). Steady states "
        f"are found by piezoharvest, waited for with the alternatives: periods needed times time a period. One core, "
        f"{info['processor']}, {info['date']}.\n"
    )


def _cell(row: dict | None, mine: dict, count: int) -> str:
    if row is None:
        return "–"
    return f"{seconds(row['seconds'] * count)}, {error(row['error'])}, {figures(row['seconds'] / mine['seconds'])}×"


def _shown(rows: list[dict]) -> tuple[float, ...]:
    """Capacitors of the short table: the bench's own, or the middle one, and the largest."""
    values = [row["smoothing_capacitance"] for row in rows]
    return min(values, key=lambda c: abs(c / 1e-6 - 1)), values[-1]


def waiting(results: dict, name: str, row: dict) -> float | None:
    """Time for waiting until the steady state with an alternative: periods needed times its time a period, s."""
    run = chosen(results["sshi"], name)
    return None if run is None else run["seconds"] * row["periods_waited"]


def _steady_row(results: dict, row: dict) -> list[str]:
    worst = max(row["state_error"], row["power_error"])
    cells = [f"**{seconds(row['seconds'])}**, {error(worst)}"]
    for name in NAMES:
        time = waiting(results, name, row)
        cells.append("–" if time is None else f"{seconds(time)}, {figures(time / row['seconds'])}×")
    return [f"steady state of parallel SSHI, {capacitance(row['smoothing_capacitance'])} behind the bridge", *cells]


def _sweep_row(results: dict) -> list[str]:
    rows = [row for row in results["sweep"].get("rows", []) if row["workers"] == 1]
    if not rows:
        return ["steady states a second, one core", "–", *["–"] * len(NAMES)]
    best = max(row["designs"] / row["seconds"] for row in rows)
    cells = [f"**{figures(best)}**"]
    own_capacitor = next(r for r in results["steady"] if r["smoothing_capacitance"] == _shown(results["steady"])[0])
    for name in NAMES:
        time = waiting(results, name, own_capacitor)
        cells.append("–" if time is None else f"{figures(1 / time)}, {figures(best * time)}×")
    return ["steady states a second, one core", *cells]
