"""speed.md: all results as tables, and the part of docs/validation.md between two comments."""

from __future__ import annotations

import re
from pathlib import Path

from piezoharvest.output import atomic
from reports.speed.goals import GIB, Goal, goals, own
from reports.speed.summary import NAMES, chosen, summary
from reports.speed.words import capacitance, error, figures, markdown, seconds, si

FINE = 1e-9
MARKED = re.compile(r"(?<=<!-- speed: begin -->\n).*(?=<!-- speed: end -->)", re.DOTALL)


def page(results: dict) -> str:
    """All of speed.md."""
    machine = results["machine"]
    versions = ", ".join(f"{name} {machine[name]}" for name in machine if name not in _NOT_VERSIONS and machine[name])
    parts = [
        "# Speed\n",
        f"Written by `make bench` on {machine['date']}: {machine['processor']}, {machine['cores']} cores, "
        f"{machine['system']}; {versions}. All times are of this one run, on one core unless it says otherwise.\n",
        _HOW_TIMED,
        "## What was promised\n",
        markdown(["", "limit", "measured", "kept", ""], [_goal(goal) for goal in goals(results)], (0, 3, 4)),
        "## Time and error from rest\n",
        _HOW_RUNS,
        "![time against error](work_precision.png)\n",
        *(_section(results[key]) for key in ("sshi", "sshi_stops", "record")),
        _campaign(results["campaign"]),
        "## Periodic steady states from a cold start\n",
        _HOW_STEADY,
        "![time to the steady state](steady_state.png)\n",
        _steady(results["steady"]),
        "## Sweeps\n",
        *_sweep(results["sweep"]),
        "## Start\n",
        _start(results["startup"]),
    ]
    return "\n".join(parts)


_NOT_VERSIONS = ("date", "processor", "cores", "system")
_HOW_TIMED = """\
Repeated times are medians of the repeats that nothing disturbed, or of all where there was none: beside each a fixed
loop is timed, and where that took a tenth longer than at its shortest, the repeat is made again for up to ten seconds.
On a shared host every second one may be disturbed, and takes half as long again. Sweeps, and alternatives that run for
seconds, are timed once.
"""
_HOW_RUNS = """\
Every alternative runs the same study from rest. The error is the largest distance of the state from DOP853 at 1e-12
(the oracle of the tests) at the quarters of 20 periods spread over the run (of a record: at its samples), relative to
the largest state, in the energy norm. Beside it stands by how much DOP853 at 1e-13 differs: smaller errors are not
resolved. Of each alternative the table has the cheapest run within 1e-3 and the cheapest within 1e-9; all of them are
in the figure and in speed.json. Tables, compilation and the start of processes are not in the times.

- *NumPy exact*: `scipy.linalg.expm` of every mode for 64 steps a period, halved again and again for bisecting events.
- *solve_ivp*: terminal events, started again in the next mode after each; tolerances from 1e-3 to 1e-11 and at most
  1/16 of a period a step. It looks for events at the ends of steps and misses two crossings within one, which
  bounds what it reaches with P-I operators.
- *ngspice*: the netlist of `piezoharvest export` with ngspice's own reltol; its largest step is halved until the
  harvested power of the last period changes by less than 0.1 %. Its diodes and switches are slightly rounded, which
  bounds its accuracy. The time is that of the transient analysis alone, as ngspice gives it.
"""
_HOW_STEADY = """\
`simulate` against waiting: the run from rest, continued until as many periods again change the state by less than
1e-9. Its end is also what the answer is compared with (state at phase zero and harvested power, the larger error).
Waiting is over when the state stays within 1e-6 of that end.
"""


def _goal(goal: Goal) -> list[str]:
    limit = ("at most " if goal.at_most else "at least ") + _figure(goal.limit, goal.unit, False)
    found = "–" if goal.found is None else _figure(goal.found, goal.unit, True)
    return [goal.what, limit, found, {True: "yes", False: "**no**", None: "not measured"}[goal.met], goal.note]


def _figure(value: float, unit: str, measured: bool) -> str:
    if unit == "s":
        return si(value, unit, measured)
    if 0 < value < 1e-3:
        return error(value)
    return f"{figures(value) if measured else f'{value:,g}'} {unit}".rstrip()


def _section(section: dict) -> str:
    """One study: two rows at most for each alternative."""
    mine = own(section)
    picked = [mine]
    for name in NAMES:
        for row in (chosen(section, name), chosen(section, name, FINE)):
            if row is not None and row not in picked:
                picked.append(row)
    rows = [
        [r["alternative"], r["setting"], seconds(r["seconds"]), error(r["error"]),
         figures(r["seconds"] / mine["seconds"])] for r in picked
    ]  # fmt: skip
    unit, compared = section["unit"], section[f"compared_{section['unit']}s"]
    text = f"### {section['title']}\n\n" + markdown(["", "setting", f"time a {unit}", "error", "ratio"], rows, (0, 1))
    text += f"\nCompared over {compared} {unit}s; error of the reference {error(section['reference_uncertainty'])}. "
    text += f"piezoharvest: shortest of the repeats {seconds(section['least_seconds'])}, set-up of a run (modes and "
    text += f"tables) {seconds(section['set_up_seconds'])}.\n"
    return text + (f"ngspice is missing: {section['ngspice']}.\n" if section["ngspice"] else "")


def _campaign(rows: list[dict]) -> str:
    """The records of the paper, and multisines."""
    table = markdown(
        ["record", "events", "time", "error"],
        [[r["title"], f"{r['events']:,}", seconds(r["seconds"]), error(r["error"])] for r in rows],
    )
    count = f"{rows[0]['samples']:,} samples at 1 kHz each"
    about = f"The eight records of the reference paper's campaign and multisines, {count}, on its stack of 22 kHz."
    return f"### records as they are measured, three P-I operators\n\n{about}\n\n{table}\n"


def _steady(rows: list[dict]) -> str:
    return markdown(
        ["smoothing capacitor", "period evaluations", "time", "error", "periods waited for", "time waited", "ratio"],
        [[capacitance(r["smoothing_capacitance"]), f"{r['period_evaluations']:.1f}", seconds(r["seconds"]),
          error(max(r["state_error"], r["power_error"])), f"{r['periods_waited']:,}", seconds(r["seconds_waited"]),
          figures(r["seconds_waited"] / r["seconds"])] for r in rows],
    )  # fmt: skip


def _sweep(sweep: dict) -> list[str]:
    if "skipped" in sweep:
        return [f"Not measured: {sweep['skipped']}.\n"]
    table = markdown(
        ["designs", "workers", "time", "designs a second", "memory of all processes"],
        [[f"{r['designs']:,}", str(r["workers"]), seconds(r["seconds"]), figures(r["designs"] / r["seconds"]),
          f"{r['memory'] / GIB:.2f} GiB"] for r in sweep["rows"]],
    )  # fmt: skip
    about = (
        f"`piezoharvest sweep` on a grid of load resistance and frequency, as many cores as workers, from the start of "
        f"the process to the finished Parquet file. {100 * sweep['converged']:.4g} % of the designs have a trusted "
        f"answer; the harvested power of some chosen at random differs by at most {error(sweep['power_error'])} from "
        "that of long transients.\n"
    )
    return [about, "![designs a second](sweep_rate.png)\n", table, *(f"{note}.\n" for note in sweep["notes"])]


def _start(startup: dict) -> str:
    words = {
        "python": "python alone", "import": "`import piezoharvest`", "help": "`piezoharvest --help`",
        "first_simulate": "`simulate`, nothing compiled before", "next_simulate": "`simulate` again",
    }  # fmt: skip
    return markdown(["whole process", "time"], [[words[name], seconds(startup[name])] for name in words])


def refresh(readme: Path, results: dict) -> None:
    """Replace what stands between the two comments of the page, docs/validation.md.

    Raises
    ------
    ValueError
        The comments are missing.
    """
    old = readme.read_text(encoding="utf-8")
    new, count = MARKED.subn(lambda _: summary(results), old)
    if count != 1:
        raise ValueError(f"{readme.name}: found {count} places for the table of speeds, must be one")
    with atomic(readme) as temporary:
        Path(temporary).write_text(new, encoding="utf-8")
