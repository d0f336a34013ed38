"""Printed numbers beside simulated ones, and candidates beside each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from piezoharvest.report.figures import style
from piezoharvest.report.units import number
from reports.paper.audit.energy import mean_over_peak_of_loop
from reports.paper.compare import Comparison
from reports.paper.rows import RECORD
from reports.paper.tables import Row, rows

_FORCES = (500.0, 750.0, 1000.0)
_MARKERS = ("o", "s", "^")
_TITLES = {"I": "I: electrical, steps", "II": "II: electrical, sines", "III": "III: mechanical, steps",
           "IV": "IV: mechanical, sines"}  # fmt: skip


def _place(row: Row) -> float:
    """Where on the axis a row stands: loads and frequencies at whole numbers, forces beside each other."""
    steps = {load: n for n, load in enumerate((51.43e3, 97.78e3, 143.8e3), 1)}
    centre = steps[round(row.load, 6)] if row.load is not None else float(row.frequency or 0.0)
    return centre + 0.22 * (_FORCES.index(row.force) - 1)


def _ratio_axis(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value, 1)))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.axhline(1.0, color=style.INK, linewidth=0.9)


@style.styled
def row_ratios(series: dict[str, dict[Row, tuple[float, float]]]) -> Figure:
    """Simulated over printed, for every row: energies above, peak powers below; one colour for each series.

    Parameters
    ----------
    series : dict
        By name: ratios of energy and peak by row.
    """
    figure, axes = style.grid_of_axes(2, 4, height=5.2, sharex="col", sharey="row")
    for column, (table, title) in enumerate(_TITLES.items()):
        for line, axis in enumerate(axes[:, column]):
            _ratio_axis(axis)
            for colour, values in zip(style.PALETTE, series.values(), strict=False):
                for row in rows(table):
                    marker = _MARKERS[_FORCES.index(row.force)]
                    axis.plot(_place(row), values[row][line], marker, color=colour, markersize=4, markeredgewidth=0)
        axes[0, column].set_title(title)
        axes[1, column].set_xlabel("load" if table in ("I", "III") else "frequency in Hz")
        if table in ("I", "III"):
            axes[1, column].set_xticks([1, 2, 3], ["R1", "R2", "R3"])
        else:
            axes[1, column].set_xticks([1, 2, 3, 4, 5])
    axes[0, 0].set_ylabel("energy,\nsimulated over printed")
    axes[1, 0].set_ylabel("peak power,\nsimulated over printed")
    blank = {"linestyle": "none", "markersize": 5}
    names = [Line2D([], [], marker="o", color=c, label=n, **blank) for c, n in zip(style.PALETTE, series, strict=False)]
    forces = [
        Line2D([], [], marker=m, color=style.MUTED, label=f"{f / 1e3:g} kN", **blank)
        for m, f in zip(_MARKERS, _FORCES, strict=True)
    ]
    style.legend_above(figure, [*names, *forces], 3)
    return figure


@style.styled
def record_lengths() -> Figure:
    """Time over which the sines' energies are sums, as peak powers have it, with what rounding allows."""
    figure, axes = style.grid_of_axes(1, 2, height=2.9, sharex=True)
    for axis, table, share in zip(axes, ("II", "IV"), (0.5, 1.0), strict=True):
        for n, force in enumerate(_FORCES):
            chosen = [row for row in rows(table) if row.force == force]
            seconds = np.array([r.energy.value / (share * r.peak.value) for r in chosen])
            least = [(r.energy.value - r.energy.half) / (share * (r.peak.value + r.peak.half)) for r in chosen]
            most = [(r.energy.value + r.energy.half) / (share * (r.peak.value - r.peak.half)) for r in chosen]
            place = np.array([r.frequency for r in chosen], float) + 0.12 * (n - 1)
            spread = [seconds - least, np.array(most) - seconds]
            style_of = {"color": style.PALETTE[n], "marker": _MARKERS[n], "markersize": 4, "linestyle": "none"}
            axis.errorbar(place, seconds, yerr=spread, elinewidth=1.0, label=f"{force / 1e3:g} kN", **style_of)
        frequency = np.linspace(0.7, 5.3, 60)
        axis.plot(frequency, 1 / frequency, ":", color=style.INK)
        axis.annotate("one period", (2.0, 0.75), color=style.INK, fontsize=8.5)
        axis.set_xlabel("frequency in Hz")
        axis.set_xticks([1, 2, 3, 4, 5])
        axis.set_ylim(0, 14 if table == "II" else 7)
    axes[0].set_title("Table II")
    axes[0].set_ylabel("E over half the peak power\nin s")
    axes[1].set_title("Table IV")
    axes[1].set_ylabel("E over peak power in s")
    gross = [RECORD * mean_over_peak_of_loop(force)[1] for force in _FORCES]
    axes[1].axhspan(min(gross), max(gross), color=style.GRID)
    axes[1].annotate("∫|F x'| over 10 s, sinusoidal", (1.0, 5.6), color=style.INK, fontsize=8.5)
    style.legend_above(figure, axes[0].get_legend_handles_labels()[0], 3)
    return figure


@style.styled
def candidate_errors(groups: Mapping[str, Sequence[Comparison]]) -> Figure:
    """Error of each candidate on all rows and on left-out rows, by group."""
    count = sum(len(group) for group in groups.values())
    sizes = [len(group) for group in groups.values()]
    figure, axes = style.grid_of_axes(len(groups), height=0.8 + 0.27 * count, sharex=True, height_ratios=sizes)
    for axis, (title, group) in zip(axes, groups.items(), strict=True):
        for place, comparison in enumerate(group):
            axis.barh(place, 100 * comparison.fit.rms, 0.62, color=style.PALETTE[0], alpha=0.85)
            axis.plot(100 * comparison.left_out, place, "D", color=style.PALETTE[1], markersize=5)
        axis.set_yticks(range(len(group)), [c.fit.candidate.name for c in group])
        axis.invert_yaxis()
        axis.grid(False, axis="y")
        axis.set_title(title)
        axis.set_xscale("log")
        axis.set_xlim(2.5, 120)
        axis.set_xticks([3, 5, 10, 20, 50, 100], ["3", "5", "10", "20", "50", "100"])
        axis.xaxis.set_minor_formatter(NullFormatter())
    axes[-1].set_xlabel("root mean square of ln(predicted/printed), × 100")
    bar = Line2D([], [], color=style.PALETTE[0], linewidth=6, alpha=0.85, label="all rows, fitted")
    mark = Line2D([], [], color=style.PALETTE[1], marker="D", linestyle="none", label="rows left out, predicted")
    style.legend_above(figure, [bar, mark], 2)
    return figure
