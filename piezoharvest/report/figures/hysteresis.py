"""Figures of hysteresis loops: voltage over charge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from piezoharvest.engine.response import Waveforms
from piezoharvest.report.figures import style
from piezoharvest.report.signals import Window
from piezoharvest.report.subjects import Subject
from piezoharvest.report.units import prefix_of

_MAX_POINTS = 4000  # points of a loop


@style.styled
def loops(parts: Sequence[tuple[Subject, Waveforms, Window]], periodic: bool) -> Figure:
    """Hysteresis voltage and electrode voltage against charge, for each candidate within a window of its run."""
    figure, (inner, outer) = style.grid_of_axes(1, 2, height=3.3, sharex=True)
    drawn = [(subject, _within(signals, window)) for subject, signals, window in parts]
    charge_factor, charge_unit = _unit([path["charge"] for _, path in drawn], "C")
    units = {}
    for axes, signal in ((inner, "hysteresis_voltage"), (outer, "voltage")):
        factor, units[signal] = _unit([path[signal] for _, path in drawn], "V")
        for subject, path in drawn:
            charge, voltage = (np.append(x, x[0]) if periodic else x for x in (path["charge"], path[signal]))
            axes.plot(charge_factor * charge, factor * voltage, linewidth=1.3, **subject.style)
        axes.set_xlabel(f"charge qₚ in {charge_unit}")
    inner.set_ylabel(f"hysteresis voltage vₕ in {units['hysteresis_voltage']}")
    outer.set_ylabel(f"electrode voltage vₚ in {units['voltage']}")
    style.legend_above(figure, [Line2D([], [], label=s.label, **s.style) for s, _ in drawn])
    return figure


def _within(signals: Waveforms, window: Window) -> dict[str, np.ndarray]:
    """Signals of a loop within a window, thinned to a maximum number of samples."""
    inside = np.flatnonzero((signals.time >= window.begin) & (signals.time <= window.end))
    inside = inside[:: 1 + len(inside) // _MAX_POINTS]
    names = ("charge", "hysteresis_voltage", "voltage")
    return {name: np.broadcast_to(getattr(signals, name), signals.time.shape)[inside] for name in names}


def _unit(signals: Sequence[np.ndarray], unit: str) -> tuple[float, str]:
    return prefix_of(max((float(np.max(np.abs(s), initial=0.0)) for s in signals), default=0.0), unit)
