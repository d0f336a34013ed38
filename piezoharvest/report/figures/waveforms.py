"""Figures of signals over time: one period of a steady state, or a whole run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from piezoharvest.engine.response import Waveforms
from piezoharvest.report.figures import style
from piezoharvest.report.signals import Window
from piezoharvest.report.units import prefix_of

_UNITS = {"displacement": "m", "voltage": "V", "current": "A", "charge": "C"}
_NAMES = {"current": "load current", "charge": "charge qₚ"}
_COLOURS = {
    "drive": style.INK, "displacement": style.PALETTE[0], "voltage": style.PALETTE[1], "current": style.PALETTE[2],
    "charge": style.PALETTE[2],
}  # fmt: skip
_DC = {"color": style.INK, "linestyle": (0, (5, 1.6)), "linewidth": 1.1}
# Marker of each event in the circuit; True if it is filled.
_EVENTS = {
    "switch closes": ("v", True), "switch opens": ("^", False), "voltage extracted": ("D", True),
    "diodes conduct": ("o", True), "diodes block": ("o", False),
}  # fmt: skip
_ACTIONS = ("switch closes", "voltage extracted")
_MAX_EVENTS = 80  # with more events, markers would overlap
_MAX_SAMPLES = 6000
_PIXELS = 1500


@style.styled
def waveforms(signals: Waveforms, windows: Sequence[Window], base: bool) -> Figure:
    """Drive, displacement, voltage (with the dc side's) and load current, in one column for each window.

    The charge is drawn instead of a load current that consists of impulses.

    Parameters
    ----------
    signals : Waveforms
    windows : sequence of Window
    base : bool
        True if the drive is base acceleration.
    """
    names = ("drive", "displacement", "voltage", "current" if np.any(signals.current) else "charge")
    figure, axes = style.grid_of_axes(
        len(names), len(windows), height=5.6, sharex="col", sharey="row", squeeze=False, height_ratios=(0.8, 1, 1.3, 1)
    )
    shown = set()
    for column, window in enumerate(windows):
        time_factor, time_unit = prefix_of(window.end - window.begin, "s")
        for one, name in zip(axes[:, column], names, strict=True):
            _draw(one, signals, name, window, (time_factor, _unit(signals, name, base)[0]))
        shown |= _mark_events(axes[:, column], signals, window, time_factor, _unit(signals, "voltage", base)[0])
        axes[0, column].set_title(window.title)
        axes[0, column].set_xlim(time_factor * window.begin, time_factor * window.end)
        axes[-1, column].set_xlabel(f"time in {time_unit}")
    for one, name in zip(axes[:, 0], names, strict=True):
        words = ("base accel." if base else "force") if name == "drive" else _NAMES.get(name, name)
        one.set_ylabel(f"{words}\nin {_unit(signals, name, base)[1]}")
    figure.align_ylabels(axes[:, 0])
    style.legend_above(figure, _legend(signals, shown), 6)
    return figure


def _unit(signals: Waveforms, name: str, base: bool) -> tuple[float, str]:
    """Factor and unit of a panel, by its largest value."""
    unit = _UNITS.get(name) or ("m/s^2" if base else "N")
    values = np.abs(getattr(signals, name))
    return prefix_of(float(np.max(values, initial=0.0)), unit)


def _draw(axes: Axes, signals: Waveforms, name: str, window: Window, factors: tuple[float, float]) -> None:
    """Draw one signal in one window; of very many samples the minimum and maximum of each pixel."""
    # One sample beyond either end, so that the lines reach the border.
    spacing = float(np.max(np.diff(signals.time), initial=0.0))
    inside = (signals.time >= window.begin - spacing) & (signals.time <= window.end + spacing)
    times, values = _thinned(signals.time[inside], np.broadcast_to(getattr(signals, name), inside.shape)[inside])
    width = 0.8 if signals.time[-1] - signals.time[0] > 1e3 * spacing and len(times) > _MAX_SAMPLES // 3 else 1.3
    axes.plot(factors[0] * times, factors[1] * values, color=_COLOURS[name], linewidth=width)
    if name == "voltage" and np.any(signals.dc_voltage):
        times, values = _thinned(signals.time[inside], np.broadcast_to(signals.dc_voltage, inside.shape)[inside])
        axes.plot(factors[0] * times, factors[1] * values, **_DC)


def _thinned(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if len(times) <= _MAX_SAMPLES:
        return times, values
    edges = np.linspace(0, len(times), _PIXELS + 1).astype(int)[:-1]
    low, high = np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)
    return np.repeat(times[edges], 2), np.column_stack((low, high)).ravel()


def _mark_events(
    axes: Sequence[Axes], signals: Waveforms, window: Window, time_factor: float, factor: float
) -> set[str]:
    """Draw lines through all panels where the switch acts, and markers of events; returns the names of those shown."""
    events = [
        (time, name) for time, name in zip(signals.event_times, signals.event_names, strict=True)
        if name in _EVENTS and window.begin <= time <= window.end
    ]  # fmt: skip
    if len(events) > _MAX_EVENTS:
        return set()
    for time, name in events:
        if name in _ACTIONS:
            for one in axes:
                one.axvline(time_factor * time, color=style.MUTED, linewidth=0.8, linestyle=":", zorder=1)
        marker, filled = _EVENTS[name]
        voltage = factor * _voltage_at(signals, time, before=name == "voltage extracted")
        axes[2].plot([time_factor * time], [voltage], marker=marker, markersize=5, markeredgecolor=style.INK, zorder=4,
                     markerfacecolor=style.INK if filled else style.PAPER, markeredgewidth=0.9)  # fmt: skip
    return {name for _, name in events}


def _voltage_at(signals: Waveforms, time: float, before: bool) -> float:
    """Electrode voltage in V at an event, or just before it where the voltage jumps."""
    if before:
        return float(signals.voltage[max(int(np.searchsorted(signals.time, time)) - 1, 0)])
    return float(np.interp(time, signals.time, signals.voltage))


def _legend(signals: Waveforms, shown: set[str]) -> list[Line2D]:
    """Legend of the markers and the dashed line."""
    handles = [Line2D([], [], label="dc voltage", **_DC)] if np.any(signals.dc_voltage) else []
    for name, (marker, filled) in _EVENTS.items():
        if name in shown:
            face = style.INK if filled else style.PAPER
            handles.append(Line2D([], [], marker=marker, linestyle="none", markersize=5, markeredgecolor=style.INK,
                                  markerfacecolor=face, label=name))  # fmt: skip
    return handles
