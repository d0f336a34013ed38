"""Figures of the results."""

from __future__ import annotations

from pathlib import Path

from piezoharvest.report.figures.style import LIMIT, PALETTE, grid_of_axes, legend_above, log_axis, styled, write_png
from reports.speed.summary import NAMES, waiting

COLOURS = dict(zip(("piezoharvest", *NAMES), PALETTE, strict=False))
MARKERS = dict(zip(("piezoharvest", *NAMES), "*osd^", strict=True))


def draw(results: dict, folder: Path) -> None:
    """Write all figures."""
    write_png(work_precision(results), folder / "work_precision.png")
    write_png(steady_state(results), folder / "steady_state.png")
    if "rows" in results["sweep"]:
        write_png(sweep_rate(results), folder / "sweep_rate.png")


@styled
def work_precision(results: dict):
    """Error of the state against time, for every setting of every alternative."""
    sections = [results[key] for key in ("sshi", "sshi_stops", "record")]
    figure, axes = grid_of_axes(1, 3, height=3.6, sharey=True)
    for ax, section in zip(axes, sections, strict=True):
        for name in COLOURS:
            rows = [row for row in section["rows"] if row["alternative"] == name]
            size = 11 if name == "piezoharvest" else 4
            x, y = [row["seconds"] for row in rows], [row["error"] for row in rows]
            ax.plot(x, y, color=COLOURS[name], marker=MARKERS[name], markersize=size, label=name, linewidth=1.0)
        ax.axhspan(1e-14, section["reference_uncertainty"], color=LIMIT, alpha=0.08, linewidth=0)
        ax.set_yscale("log")
        log_axis(ax.xaxis, "s")
        ax.set_title(section["title"].replace(", ", ",\n", 1))
        ax.set_xlabel(f"time a {section['unit']}")
    axes[0].set_ylim(1e-13, 1e-1)
    axes[0].set_ylabel("error of the state, relative")
    axes[0].text(0.03, 0.02, "below the reference's own error", transform=axes[0].transAxes, color=LIMIT, fontsize=8)
    legend_above(figure, axes[0].get_lines(), columns=5)
    return figure


@styled
def steady_state(results: dict):
    """Time to the steady state, and periods it takes, against the smoothing capacitor."""
    rows = results["steady"]
    capacitors = [row["smoothing_capacitance"] for row in rows]
    figure, (left, right) = grid_of_axes(1, 2, height=3.6)
    style = {"color": COLOURS["piezoharvest"], "markersize": 5}
    left.plot(capacitors, [r["seconds"] for r in rows], marker="*", label="piezoharvest, found directly", **style)
    waited = [r["seconds_waited"] for r in rows]
    left.plot(capacitors, waited, marker="*", label="piezoharvest, waited for", linestyle=":", **style)
    for name in NAMES:
        times = [waiting(results, name, row) for row in rows]
        if times[0] is not None:
            left.plot(capacitors, times, label=f"{name}, waited for", color=COLOURS[name], linestyle=":", linewidth=1.2)
    left.set_ylabel("time to the steady state")
    right.plot(capacitors, [r["period_evaluations"] for r in rows], marker="*", **style)
    right.plot(capacitors, [r["periods_waited"] for r in rows], marker="*", linestyle=":", **style)
    right.axhline(30, color=LIMIT, linewidth=1.0)
    right.text(capacitors[-1], 27, "promised: 30", color=LIMIT, fontsize=8, ha="right", va="top")
    right.set_ylabel("periods simulated")
    for ax, unit in ((left, "s"), (right, "")):
        log_axis(ax.yaxis, unit)
        log_axis(ax.xaxis, "F")
        ax.set_xlabel("smoothing capacitor")
    legend_above(figure, left.get_lines(), columns=2)
    return figure


@styled
def sweep_rate(results: dict):
    """Designs a second against cores, beside what the alternatives reach by waiting, as if it cost no start."""
    rows = results["sweep"]["rows"]
    figure, ax = grid_of_axes(1, height=3.4)
    cores = sorted({row["workers"] for row in rows})
    best = [max(r["designs"] / r["seconds"] for r in rows if r["workers"] == n) for n in cores]
    style = {"color": COLOURS["piezoharvest"], "marker": "*", "markersize": 11}
    ax.plot(cores, best, label="piezoharvest sweep", **style)
    for n, rate in zip(cores, best, strict=True):
        ax.annotate(f"{rate:,.0f}/s", (n, rate), textcoords="offset points", xytext=(0, 9), ha="center")
    bench = min(results["steady"], key=lambda row: abs(row["smoothing_capacitance"] / 1e-6 - 1))
    for name in NAMES:
        time = waiting(results, name, bench)
        if time is not None:
            ax.plot(cores, [n / time for n in cores], color=COLOURS[name], marker=MARKERS[name], linestyle=":",
                    label=f"{name}, waited for")  # fmt: skip
    ax.plot(cores[:2], [5000, 9000][: len(cores)], color=LIMIT, marker="_", linestyle="none", markersize=16,
            label="promised")  # fmt: skip
    ax.set_xticks(cores)
    ax.set_xlim(cores[0] - 0.4, cores[-1] + 0.4)
    ax.set_xlabel("cores")
    ax.set_ylabel("steady states a second")
    ax.set_yscale("log")
    ax.margins(y=0.15)
    legend_above(figure, ax.get_lines(), columns=3)
    return figure
