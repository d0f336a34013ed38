"""Figure of the price of restrictions: one bar for the bound and for each restriction on a synthesised network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from piezoharvest.report.figures import style
from piezoharvest.report.units import decibel, engineering, percent

_KEYS = ("harvested_power", "attenuation_db")


@style.styled
def restrictions(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Horizontal bars of harvested power in percent of the first row, or of attenuation in dB."""
    power = _KEYS[0] in rows[0]
    sizes = np.array([figure_of(row) for row in rows])
    lengths = 100 * sizes / sizes[0] if power else -sizes
    figure, axes = style.grid_of_axes(1, height=0.9 + 0.36 * len(rows))
    colours = [style.PALETTE[5] if row["order"] is None else style.PALETTE[2] for row in rows]
    axes.barh(range(len(rows)), lengths, height=0.66, color=colours, linewidth=0)
    for n, (row, length) in enumerate(zip(rows, lengths, strict=True)):
        text = value_text(row)
        inside = length > 0.5 * np.max(lengths)
        place, side, colour = (-6, "right", "#101418") if inside else (6, "left", style.MUTED)
        axes.annotate(text, (length, n), xytext=(place, 0), textcoords="offset points", va="center", ha=side,
                      fontsize=8, color=colour)  # fmt: skip
    axes.set_yticks(range(len(rows)), [row["name"] for row in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    reference = f"the {rows[0]['name']}" if rows[0]["order"] is None else rows[0]["name"]
    axes.set_xlabel(
        f"harvested power in % of {reference}" if power else "attenuation relative to shorted electrodes in dB"
    )
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    return figure


def figure_of(row: Mapping[str, Any]) -> float:
    """Figure of a row: power in W, or attenuation in dB."""
    return next(float(row[key]) for key in _KEYS if key in row)


def value_text(row: Mapping[str, Any]) -> str:
    """Figure of a row with its unit."""
    return engineering(figure_of(row), "W") if _KEYS[0] in row else decibel(figure_of(row))


def price_text(rows: Sequence[Mapping[str, Any]], n: int) -> str:
    """Loss of a row against the first one: a share of the power, or dB."""
    first, own = figure_of(rows[0]), figure_of(rows[n])
    return percent(1 - own / first, 2) if _KEYS[0] in rows[0] else decibel(own - first)
