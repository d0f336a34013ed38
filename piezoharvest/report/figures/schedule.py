"""Figure of a switch's schedule: the lag, the load and the power that are best at each frequency of a band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from piezoharvest.report.figures import style
from piezoharvest.report.subjects import Subject
from piezoharvest.report.units import prefix_of

_FIXED: dict[str, Any] = {"linestyle": ":", "linewidth": 1.2}


@style.styled
def schedule(subjects: Sequence[Subject], band: tuple[float, float]) -> Figure:
    """Lag, load and harvested power over the frequency for candidates with a schedule; dotted: the best fixed values.

    Parameters
    ----------
    subjects : sequence of Subject
        With schedules.
    band : (float, float)
        Hz.
    """
    figure, (lag, load, power) = style.grid_of_axes(3, height=6.2, sharex=True)
    factor, unit = prefix_of(max(row["harvested_power"] for s in subjects for row in s.candidate.schedule or ()), "W")
    for subject in subjects:
        frequency, lags, loads, powers = columns(subject)
        lag.plot(frequency, np.degrees(lags), **subject.style)
        dotted = {**subject.style, **_FIXED}
        lag.axhline(_nearest(np.degrees(getattr(subject.shunt, "phase_lag", 0.0)), np.degrees(lags)), **dotted)
        power.plot(frequency, factor * powers, **subject.style)
        power.axhline(factor * subject.candidate.harvested_power, **dotted)
        if np.all(np.isfinite(loads)):
            load.plot(frequency, loads, **subject.style)
            fixed = getattr(subject.shunt, "load_resistance", None)
            if fixed is not None:
                load.axhline(fixed, **dotted)
    lag.set_ylabel("lag of the switch in °")
    load.set_ylabel("load")
    if load.lines:
        style.log_axis(load.yaxis, "Ω")
    power.set_ylabel(f"harvested power in {unit}")
    power.set_ylim(bottom=0)
    power.set_xlim(*band)
    style.frequency_axis(power, False, "excitation frequency")
    handles = [Line2D([], [], label=s.label, **s.style) for s in subjects]
    fixed = Line2D([], [], label="best fixed values (power: mean)", color=style.MUTED, **_FIXED)
    style.legend_above(figure, [*handles, fixed])
    return figure


def columns(subject: Subject) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Frequency in Hz, lag in rad without jumps, load in ohm (NaN without one) and power in W of a schedule, (n,) each.

    Half a turn more is the same action at the other extremum. With a dc voltage V the load is V^2 over the power.
    """
    rows = subject.candidate.schedule or ()
    frequency, power = (np.array([row[name] for row in rows]) for name in ("frequency", "harvested_power"))
    fixed = getattr(subject.shunt, "phase_lag", 0.0)
    lags = np.unwrap([row.get("phase_lag", fixed) for row in rows], period=np.pi)
    voltage = np.array([row.get("dc_voltage", np.nan) for row in rows])
    with np.errstate(all="ignore"):
        loads = np.array([row.get("load_resistance", np.nan) for row in rows])
        loads = np.where(np.isfinite(loads), loads, voltage**2 / power)
    return frequency, lags, loads, power


def _nearest(fixed: float, lags: np.ndarray) -> float:
    """A fixed lag in degrees by as many half turns more or less that it lies among the scheduled ones."""
    return float(fixed + 180 * np.round((np.mean(lags) - fixed) / 180))
