"""Figure of the front between harvested power and damping."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from piezoharvest.design.front.point import Front, FrontPoint
from piezoharvest.design.result import Bound
from piezoharvest.report.figures import style
from piezoharvest.report.subjects import Subject
from piezoharvest.report.units import prefix_of

_BEST = {"color": style.GRID, "linestyle": "-", "linewidth": 6.0, "solid_capstyle": "round"}
_BOUND = {"color": style.LIMIT, "linestyle": (0, (8, 2, 2, 2)), "linewidth": 1.2}
_DOTS = (0, (1, 1.6))  # of lines whose colour another one has already
_MARGIN = 0.5  # of the fronts' extent: a bound farther away would flatten them, and is left to the text


@style.styled
def front(drawn: Sequence[tuple[Subject, Front]], best: Sequence[FrontPoint], bound: Bound) -> Figure:
    """Harvested power over attenuation: the front of each candidate, the best over all, the bound of linear shunts."""
    figure, axes = style.grid_of_axes(1, height=4.4)
    top = max((p.harvested_power for _, one in drawn for p in one.points), default=0.0)
    factor, unit = prefix_of(top, "W")
    for _, part in groupby(best, key=lambda point: point.shunt.kind):  # between kinds there is no design
        axes.plot(*_figures(list(part), factor), zorder=1.5, **_BEST)
    handles = [Line2D([], [], label="best over all kinds", **_BEST)]
    for subject, one in drawn:
        look = _look(subject, alone=len(one.points) == 1)
        axes.plot(*_figures(one.points, factor), **look)
        handles.append(Line2D([], [], label=subject.label, **look))
    axes.set_xlabel("displacement relative to shorted electrodes in dB (to the left: more damping)")
    axes.set_ylabel(f"harvested power in {unit}")
    handles += _bounds(axes, bound, factor)
    axes.set_ylim(bottom=-0.02 * factor * top)  # after the bounds: it ends the automatic choice of the upper end
    style.legend_above(figure, handles)
    return figure


def _figures(points: Sequence[FrontPoint], factor: float) -> tuple[np.ndarray, np.ndarray]:
    """Attenuation in dB and scaled power of points."""
    return np.array([p.attenuation_db for p in points]), factor * np.array([p.harvested_power for p in points])


def _look(subject: Subject, *, alone: bool) -> dict[str, Any]:
    """The subject's line, dotted where its colour is used before; a marker for a front of one point."""
    look = {**subject.style, "marker": "o", "markersize": 3.0}
    if subject.rank >= len(style.PALETTE):
        look["linestyle"] = _DOTS
    return {**look, "linestyle": "none", "marker": "D", "markersize": 6.0} if alone else look


def _bounds(axes: Axes, bound: Bound, factor: float) -> list[Line2D]:
    """Lines of the bound in either figure, where they are near the fronts."""
    near, (left, right), top = False, sorted(axes.dataLim.intervalx), axes.dataLim.ymax
    if bound.harvested_power is not None and factor * bound.harvested_power < (1 + _MARGIN) * top:
        axes.axhline(factor * bound.harvested_power, **_BOUND)
        near = True
    if bound.attenuation_db is not None and bound.attenuation_db > left - max(_MARGIN * (right - left), 1.0):
        axes.axvline(bound.attenuation_db, **_BOUND)
        near = True
    return [Line2D([], [], label="bound for passive linear shunts", **_BOUND)] if near else []
