"""Figures of power, efficiency and damping against load and frequency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from piezoharvest.report.figures import style
from piezoharvest.report.figures.bound_lines import BoundLine
from piezoharvest.report.spans import Span
from piezoharvest.report.subjects import Subject
from piezoharvest.report.sweeps import CandidateCurve
from piezoharvest.report.units import prefix_of

_LIMIT = {"color": style.LIMIT, "linestyle": (0, (8, 2, 2, 2)), "linewidth": 1.2}
_BOUND = {"color": style.MUTED, "linestyle": (0, (6, 2)), "linewidth": 1.4, "zorder": 1.9}
_SHORT = {"color": style.MUTED, "linestyle": "-", "linewidth": 1.2}
_LOG_AXIS_RATIO = 10.0  # of the largest to the smallest displacement, or of powers, above which the axis is logarithmic
_LOG_AXIS_REACH = 30.0  # down to which share of the least candidate a logarithmic axis shows its curve
_MAX_HEIGHT_RATIO = 5.0  # of a limit to the curves' top above which it is not drawn
_MAX_MARKERS = 40  # number of points from which a curve is drawn without markers


@style.styled
def power_along_loads(
    curves: Sequence[CandidateCurve], level: Sequence[Subject], limit: float | None, bound: float | None = None
) -> Figure:
    """Harvested power and efficiency against the load.

    `level` are candidates whose power does not depend on a load; `limit` of any interface and `bound` of passive linear
    shunts in W.
    """
    figure, (power, efficiency) = style.grid_of_axes(2, height=4.9, sharex=True, height_ratios=(1.5, 1))
    tops = [*_tops(curves), *(subject.candidate.harvested_power for subject in level)]
    factor, unit = _power_unit(tops)
    for curve in curves:
        _line(power, curve, factor * curve.harvested)
        _line(efficiency, curve, 100 * curve.efficiency)
        _tuned(power, efficiency, curve, factor)
    for subject in level:
        power.axhline(factor * subject.candidate.harvested_power, linewidth=1.5, **subject.style)
        if subject.response is not None:
            efficiency.axhline(100 * subject.response.efficiency, linewidth=1.5, **subject.style)
    handles = _handles([c.subject for c in curves]) + _handles(level, ", any load")
    handles += _limit(power, limit, factor)
    if bound is not None and _fits(power, factor * bound):
        power.axhline(factor * bound, **_BOUND)
        handles.append(Line2D([], [], label="bound for passive linear shunts", **_BOUND))
    _finish_powers(power, efficiency, tops, unit)
    style.log_axis(efficiency.xaxis, "Ω")
    efficiency.set_xlabel("load resistance (dots: as tuned)")
    style.legend_above(figure, handles)
    return figure


@style.styled
def power_along_frequencies(
    curves: Sequence[CandidateCurve], span: Span, limit: float | None, bound: BoundLine | None,
    marks: dict[str, Any],
) -> Figure:  # fmt: skip
    """Harvested power and efficiency against the frequency of the sine.

    `limit` of any interface in W, `bound` of passive linear shunts; `marks` as for `_marks`.
    """
    figure, (power, efficiency) = style.grid_of_axes(2, height=4.9, sharex=True, height_ratios=(1.5, 1))
    factor, unit = _power_unit(tops := _tops(curves))
    for curve in curves:
        _line(power, curve, factor * curve.harvested)
        _line(efficiency, curve, 100 * curve.efficiency)
    handles = _handles([c.subject for c in curves]) + _limit(power, limit, factor)
    # Without effects that dissipate, the bound at each frequency is the limit for any interface.
    if bound is not None and not (limit and np.allclose(bound.values, limit, rtol=1e-3)):
        handles += _bound(power, bound, factor) if _fits(power, factor * float(np.max(bound.values))) else []
    handles += _marks((power, efficiency), **marks)
    _finish_powers(power, efficiency, tops, unit)
    efficiency.set_xlim(span.low, span.high)
    style.frequency_axis(efficiency, span.logarithmic, "excitation frequency")
    style.legend_above(figure, handles)
    return figure


@style.styled
def damping(
    curves: Sequence[CandidateCurve], short: tuple[np.ndarray, np.ndarray], span: Span, marks: dict[str, Any],
    per: str = "", bound: BoundLine | None = None,
) -> Figure:  # fmt: skip
    """Displacement amplitude and its attenuation against the frequency.

    Parameters
    ----------
    curves : sequence of CandidateCurve
    short : pair of (n,) arrays
        Frequencies in Hz, and displacement amplitude in m with shorted electrodes.
    span : Span
    marks : mapping
        As for `_marks`.
    per : str
        Unit of the drive if displacements are per unit of drive.
    bound : BoundLine, optional
        Bound of passive linear shunts.
    """
    figure, (level, attenuation) = style.grid_of_axes(2, height=4.9, sharex=True)
    every = np.concatenate([short[1], *(curve.displacement for curve in curves)])
    every = every[np.isfinite(every) & (every > 0)]
    wide = len(every) > 0 and np.max(every) > _LOG_AXIS_RATIO * np.min(every)
    factor, unit = (1.0, "") if wide else prefix_of(float(np.max(every, initial=0.0)), "m")
    level.plot(short[0], factor * short[1], **_SHORT)
    attenuation.axhline(0, **_SHORT)
    for curve in curves:
        _line(level, curve, factor * curve.displacement)
        _line(attenuation, curve, curve.attenuation)
    handles = [Line2D([], [], label="shorted", **_SHORT), *_handles([c.subject for c in curves])]
    handles += _marks((level, attenuation), **marks)
    if bound is not None:
        handles += _bound(level, bound, factor)
    level.set_ylabel(("displacement" if wide else f"displacement in {unit}") + (f" per {per}" if per else ""))
    if wide:
        style.log_axis(level.yaxis, "m")
    else:
        level.set_ylim(bottom=0)
    attenuation.set_ylabel("relative to shorted, in dB")
    attenuation.set_xlim(span.low, span.high)
    style.frequency_axis(attenuation, span.logarithmic, "excitation frequency")
    style.legend_above(figure, handles)
    return figure


def _line(axes: Axes, curve: CandidateCurve, values: np.ndarray) -> None:
    """Draw a curve; small dots show simulated points, if these are few."""
    few = not curve.exact and len(curve.x) < _MAX_MARKERS
    axes.plot(curve.x, values, marker="." if few else None, markersize=3.5, **curve.subject.style)


def _tuned(power: Axes, efficiency: Axes, curve: CandidateCurve, factor: float) -> None:
    """Mark the tuned point of a curve."""
    subject = curve.subject
    assert subject.load_field is not None
    load = getattr(subject.shunt, subject.load_field)
    if subject.load_field == "dc_voltage":
        found = subject.candidate.harvested_power
        load = load**2 / found if found > 0 else np.nan
    n = int(np.nanargmin(np.abs(np.log(np.where(np.isfinite(curve.x), curve.x, np.inf) / load))))
    style.mark(power, load, factor * subject.candidate.harvested_power, subject.style)
    style.mark(efficiency, curve.x[n], 100 * curve.efficiency[n], subject.style)


def _tops(curves: Sequence[CandidateCurve]) -> list[float]:
    """The largest power of each curve, W."""
    return [float(np.nanmax(curve.harvested, initial=0.0)) for curve in curves]


def _power_unit(tops: Sequence[float]) -> tuple[float, str]:
    """Factor and unit for power, by the largest to be drawn; W for a logarithmic axis."""
    return (1.0, "") if _least_of_wide(tops) else prefix_of(max(tops, default=0.0), "W")


def _least_of_wide(tops: Sequence[float]) -> float:
    """The least of powers that one linear axis would not show together; 0 where it does."""
    drawn = [top for top in tops if top > 0]
    return min(drawn) if drawn and max(drawn) > _LOG_AXIS_RATIO * min(drawn) else 0.0


def _handles(subjects: Sequence[Subject], words: str = "") -> list[Line2D]:
    return [Line2D([], [], label=s.label + words, **s.style) for s in subjects]


def _fits(axes: Axes, level: float) -> bool:
    """True if a level is not so far above the curves that they would be flattened."""
    return 0 < level <= _MAX_HEIGHT_RATIO * axes.dataLim.ymax


def _limit(power: Axes, limit: float | None, factor: float) -> list[Line2D]:
    """Draw the upper limit of power, if it fits."""
    if limit is None or not _fits(power, factor * limit):
        return []
    power.axhline(factor * limit, **_LIMIT)
    return [Line2D([], [], label="limit for any interface", **_LIMIT)]


def _bound(axes: Axes, bound: BoundLine, factor: float) -> list[Line2D]:
    axes.plot(bound.frequencies, factor * bound.values, **_BOUND)
    return [Line2D([], [], label=bound.label, **_BOUND)]


def _marks(axes: Sequence[Axes], drive: float | None, band: tuple[float, float] | None) -> list[Line2D]:
    """Mark the excitation frequency, or the band of the design, in Hz."""
    line = {"color": style.MUTED, "linestyle": ":", "linewidth": 1.0}
    for one in axes:
        if band is not None:
            one.axvspan(*band, color=style.GRID, alpha=0.5, linewidth=0, zorder=0)
        elif drive is not None:
            one.axvline(drive, **line)
    if band is not None:
        return [Line2D([], [], label="band of the design", color=style.GRID, linewidth=7)]
    return [Line2D([], [], label="excitation of the study", **line)] if drive is not None else []


def _finish_powers(power: Axes, efficiency: Axes, tops: Sequence[float], unit: str) -> None:
    power.set_ylabel(f"harvested power in {unit}" if unit else "harvested power")
    efficiency.set_ylabel("efficiency in %")
    least = _least_of_wide(tops)
    if least:
        shown = least / max(tops) / _LOG_AXIS_REACH  # of both axes' tops
        power.set_ylim(shown * power.dataLim.ymax, 1.5 * power.dataLim.ymax)
        style.log_axis(power.yaxis, "W")
        efficiency.set_ylim(shown * efficiency.dataLim.ymax, 1.5 * efficiency.dataLim.ymax)
        efficiency.set_yscale("log")
        efficiency.yaxis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
        return
    power.set_ylim(bottom=0)
    efficiency.set_ylim(0, 1.06 * max(efficiency.dataLim.ymax, 1.0))
