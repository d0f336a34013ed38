"""Figures of the page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import norm

from piezoharvest.report.figures import style
from reports.diagnosis.summary import THEORY, Results, confusion, coverage, power, smallest


def _words(name: str) -> str:
    return name.replace("_", " ")


@style.styled
def confusion_figure(results: Results, names: Sequence[str]) -> Figure:
    """Draw what was there against what it was called."""
    columns, table = confusion(results, names)
    figure, axes = style.grid_of_axes(1, height=5.4)
    total = np.maximum(table.sum(axis=1, keepdims=True), 1)
    axes.imshow(table / total, cmap="Blues", vmin=0, vmax=1.3, aspect="auto", interpolation="nearest")
    axes.set_xticks(range(len(columns)), [_words(c) for c in columns], rotation=60, ha="right", fontsize=7.5)
    axes.set_yticks(range(len(names)), [_words(n) for n in names], fontsize=7.5)
    axes.set_xlabel("called")
    axes.set_ylabel("on the bench")
    axes.grid(False)
    for i, j in zip(*np.nonzero(table), strict=True):
        axes.text(
            j,
            i,
            str(table[i, j]),
            ha="center",
            va="center",
            fontsize=8,
            color="white" if table[i, j] > total[i, 0] / 2 else style.INK,
        )
    return figure


@style.styled
def power_figure(results: Results, names: Sequence[str]) -> Figure | None:
    """Draw in which trials an effect is named over its size, and its power; None without such trials."""
    drawn = [(name, *trials) for name in names if len((trials := power(results, name))[0])]
    if not drawn:
        return None
    columns = 4
    rows = -(-len(drawn) // columns)
    figure, axes = style.grid_of_axes(rows, columns, height=1.35 * rows + 0.6, sharex=True, sharey=True, squeeze=False)
    grid = np.linspace(0.0, 12.0, 121)
    for one, (name, sizes, named) in zip(axes.flat, drawn, strict=False):
        one.plot(sizes, named, linestyle="none", marker="|", markersize=7, color=style.PALETTE[0])
        found = smallest(sizes, named)
        if found:
            one.plot(grid, norm.cdf(grid - found[0] + norm.ppf(0.9)), color=style.PALETTE[0])
        one.axvline(THEORY, color=style.MUTED, linewidth=0.8)
        one.axvline(1.5 * THEORY, color=style.LIMIT, linewidth=0.8)
        one.axhline(0.9, color=style.MUTED, linewidth=0.8, linestyle=":")
        one.set_title(_words(name), fontsize=7.5)
        one.set_xlim(0.0, 12.0)
    for one in list(axes.flat)[len(drawn) :]:
        one.set_visible(False)
    figure.supxlabel("size in σ", fontsize=9)
    figure.supylabel("named", fontsize=9)
    return figure


@style.styled
def coverage_figure(results: Results) -> Figure:
    """Draw how often the truth lies within three standard errors."""
    shares = sorted(coverage(results).items())
    figure, axes = style.grid_of_axes(1, height=0.2 * len(shares) + 0.9)
    places = np.arange(len(shares))
    axes.barh(places, [value for _, (value, _) in shares], color=style.PALETTE[0], height=0.7)
    axes.axvline(0.95, color=style.LIMIT, linewidth=1.0)
    axes.set_yticks(places, [f"{_words(name)} ({count})" for name, (_, count) in shares], fontsize=7)
    axes.invert_yaxis()
    axes.set_xlim(0, 1.02)
    axes.set_xlabel("share within three standard errors (in brackets: how many)")
    return figure


@style.styled
def time_figure(results: Results) -> Figure:
    """Draw the processor time of a diagnosis."""
    times = [result["cpu"] for result in results if "cpu" in result]
    figure, axes = style.grid_of_axes(1, height=2.3)
    axes.hist(times, bins=np.arange(0, max(times) + 2, 2), color=style.PALETTE[0])
    axes.axvline(30, color=style.LIMIT, linewidth=1.0)
    axes.set_xlabel("processor time of a campaign in s")
    axes.set_ylabel("campaigns")
    return figure
