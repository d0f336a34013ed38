"""Hysteresis loops: voltage over charge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from piezoharvest.report import style
from piezoharvest.report.subjects import Subject
from piezoharvest.report.units import prefix_of

_MOST = 4000  # points of a loop


@style.styled
def loops(subjects: Sequence[Subject], periodic: bool) -> Figure:
    """Hysteresis voltage and electrode voltage against charge, of candidates that have waveforms."""
    figure, (inner, outer) = style.grid_of_axes(1, 2, height=3.3, sharex=True)
    drawn = [(s, s.waveforms) for s in subjects if s.waveforms is not None]
    charge_factor, charge_unit = _unit([w.charge for _, w in drawn], "C")
    units = {}
    for axes, signal in ((inner, "hysteresis_voltage"), (outer, "voltage")):
        factor, units[signal] = _unit([getattr(w, signal) for _, w in drawn], "V")
        for subject, waveforms in drawn:
            every = slice(None, None, 1 + len(waveforms.time) // _MOST)
            path = charge_factor * waveforms.charge[every], factor * getattr(waveforms, signal)[every]
            if periodic:
                path = tuple(np.append(values, values[0]) for values in path)
            axes.plot(*path, linewidth=1.3, **subject.style)
        axes.set_xlabel(f"charge $q_p$ in {charge_unit}")
    inner.set_ylabel(f"hysteresis voltage $v_h$ in {units['hysteresis_voltage']}")
    outer.set_ylabel(f"electrode voltage $v_p$ in {units['voltage']}")
    style.legend_above(figure, [Line2D([], [], label=s.label, **s.style) for s, _ in drawn])
    return figure


def _unit(signals: Sequence[np.ndarray], unit: str) -> tuple[float, str]:
    return prefix_of(max((float(np.max(np.abs(s))) for s in signals), default=0.0), unit)
