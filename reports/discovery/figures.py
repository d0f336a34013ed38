"""Figures of the page."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from piezoharvest.report.figures import style
from reports.discovery.campaigns import BENT
from reports.discovery.plan import SIGMAS
from reports.discovery.summary import METHODS, OUTCOMES, Rows, of_kind

COLOURS = dict(
    zip(OUTCOMES, (style.PALETTE[2], style.PALETTE[4], style.PALETTE[5], style.GRID, style.LIMIT), strict=True)
)
WORDS = {
    "right": "right",
    "kin": "a known effect of the place",
    "among": "told among others",
    "missed": "said not to know",
    "wrong": "wrong and confident",
}
COLUMNS, PANELS = 3, 15  # of the gallery


@style.styled
def outcome_figure(rows: Rows) -> Figure | None:
    """Draw how laws were answered over their size, and how often other methods have the place; None without any."""
    laws = of_kind(rows, "law")
    if not laws:
        return None
    figure, axes = style.grid_of_axes(1, height=3.0)
    places, counts = np.arange(len(SIGMAS)), [sum(row["sigma"] == sigma for row in laws) for sigma in SIGMAS]
    below, total = np.zeros(len(SIGMAS)), np.maximum(counts, 1)
    handles = []
    for outcome in OUTCOMES:
        mine = [sum(_answer(row) == outcome for row in laws if row["sigma"] == sigma) for sigma in SIGMAS]
        bars = axes.bar(places, mine / total, 0.55, bottom=below, color=COLOURS[outcome], label=WORDS[outcome])
        handles.append(bars)
        below = below + mine / total
    for name, marker, beside in zip(METHODS, "os", (-0.34, 0.34), strict=True):
        with_it = [[row["others"][name]["right"] for row in laws if row["sigma"] == sigma and row.get("others")]
                   for sigma in SIGMAS]  # fmt: skip
        rates = [np.mean(flags) if flags else np.nan for flags in with_it]
        handles += axes.plot(places + beside, rates, color=style.INK, linestyle="none", marker=marker, markersize=6,
                             markerfacecolor="white", label=f"place right by a {_words(name)}")  # fmt: skip
    axes.set_xticks(places, [f"{sigma:g} σ\n({n} laws)" for sigma, n in zip(SIGMAS, counts, strict=True)])
    axes.set_ylabel("share")
    axes.set_ylim(-0.04, 1.04)
    axes.grid(axis="x", visible=False)
    style.legend_above(figure, handles, columns=3)
    return figure


def _words(method: str) -> str:
    return method.replace("gaussian", "Gaussian")


def _answer(row: dict[str, Any]) -> str:
    return row["outcome"] if row["outcome"] in OUTCOMES else "missed"


@style.styled
def gain_figure(rows: Rows) -> Figure | None:
    """Draw what the answers take off the error of a record that nobody has seen; None without any."""
    laws = [row for row in of_kind(rows, "law") if row.get("others")]
    if not laws:
        return None
    figure, axes = style.grid_of_axes(1, height=2.8)
    methods = {"diagnose": lambda row: row["gain"]}
    methods |= {name: (lambda row, name=name: row["others"][name]["gain"]) for name in METHODS}
    handles, rng = [], np.random.default_rng(0)
    for n, (name, gain) in enumerate(methods.items()):
        x = [SIGMAS.index(row["sigma"]) + 0.24 * (n - 1) + rng.uniform(-0.07, 0.07) for row in laws]
        handles += axes.plot(x, [gain(row) for row in laws], linestyle="none", marker=".", markersize=6, alpha=0.75,
                             color=style.PALETTE[n], label=_words(name))  # fmt: skip
    axes.axhline(0.9, color=style.LIMIT, linewidth=0.8)
    axes.set_xticks(range(len(SIGMAS)), [f"{sigma:g} σ" for sigma in SIGMAS])
    axes.set_xlim(-0.5, len(SIGMAS) - 0.5)
    axes.set_ylabel("gain on an unseen record")
    axes.set_ylim(-1.05, 1.05)
    axes.grid(axis="x", visible=False)
    style.legend_above(figure, handles)
    return figure


@style.styled
def gallery_figure(rows: Rows, law_of: Any) -> Figure | None:
    """Draw laws that were found at the right place against the true ones; None without any.

    Parameters
    ----------
    rows : sequence of dict
        With their curves: of development trials.
    law_of : callable
        The law of a row's truth, a function in SI units.
    """
    some = [row for row in of_kind(rows, "law") if row["right"] and row["found"]][:PANELS]
    if not some:
        return None
    lines = -(-len(some) // COLUMNS)
    figure, axes = style.grid_of_axes(lines, COLUMNS, height=1.55 * lines + 0.5, squeeze=False)
    handles = []
    for one, row in zip(axes.flat, some, strict=False):
        handles = _panel(one, row, law_of(row))
    for one in list(axes.flat)[len(some) :]:
        one.set_visible(False)
    style.legend_above(figure, handles)
    return figure


def _panel(axes: Any, row: dict[str, Any], law: Any) -> list[Any]:
    found = max(row["found"], key=lambda each: each["gain"])
    x, value, std = (np.array(found["curve"][name]) for name in ("input", "value", "std"))
    true = law(x)
    if row["truth"]["site"][0] in BENT:  # a straight line is a parameter of the model
        value, true = (y - x * float(x @ y / (x @ x)) for y in (value, true))
    size = float(np.abs(true).max()) or 1.0
    band = axes.fill_between(x, (value - 3 * std) / size, (value + 3 * std) / size, color=style.PALETTE[5], alpha=0.5,
                             linewidth=0, label="found, three standard errors")  # fmt: skip
    (drawn,) = axes.plot(x, true / size, color=style.INK, linewidth=1.0, label="true")
    axes.set_title(f"{row['law'].replace('_', ' ')}, {row['sigma']:g} σ\n{found['place']} of {found['input']}",
                   fontsize=7.5)  # fmt: skip
    axes.tick_params(labelsize=6.5)
    axes.ticklabel_format(axis="x", style="sci", scilimits=(-2, 3))
    axes.xaxis.get_offset_text().set_fontsize(6.5)
    axes.set_ylim(min(-0.15, 1.3 * float(np.min(true / size))), max(0.15, 1.3 * float(np.max(true / size))))
    return [drawn, band]


@style.styled
def real_figure(rows: Rows) -> Figure | None:
    """Draw the laws that were found in measured data; None where there is none."""
    found = [(row["name"], law) for row in rows for law in row["laws"]]
    if not found:
        return None
    lines = -(-len(found) // 2)
    figure, axes = style.grid_of_axes(lines, 2, height=2.1 * lines, squeeze=False)
    for one, (name, law) in zip(axes.flat, found, strict=False):
        x, value, std = (np.array(law["curve"][key]) for key in ("input", "value", "std"))
        one.fill_between(x, value - 3 * std, value + 3 * std, color=style.PALETTE[5], alpha=0.5, linewidth=0)
        one.plot(x, value, color=style.PALETTE[0])
        one.set_title(f"{name}\n{law['place']}, gain {law['gain']:.2f}", fontsize=7.5)
        one.set_xlabel(law["input"].replace("_", " "), fontsize=7.5)
        one.ticklabel_format(style="sci", scilimits=(-2, 3))
        one.tick_params(labelsize=6.5)
        for axis in (one.xaxis, one.yaxis):
            axis.get_offset_text().set_fontsize(6.5)
    for one in list(axes.flat)[len(found) :]:
        one.set_visible(False)
    return figure
