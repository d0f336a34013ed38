"""Bode diagram of the two-port: mechanical receptance with shorted, open and loaded electrodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from piezoharvest.description.shunts import Open, Short, Shunt
from piezoharvest.description.system import System
from piezoharvest.linear import frequency_response
from piezoharvest.report.figures import style
from piezoharvest.report.limits import hysteretic
from piezoharvest.report.spans import Span, dense, design_band, drive_frequency, resonance_span, wide_span
from piezoharvest.report.subjects import Subject
from piezoharvest.report.units import engineering
from piezoharvest.study import Study

_SHORT = {"color": style.INK, "linestyle": "-", "linewidth": 1.2}
_OPEN = {"color": style.MUTED, "linestyle": (0, (4, 2)), "linewidth": 1.2}


@style.styled
def bode(study: Study, subjects: Sequence[Subject], amplitude: float | None) -> Figure:
    """Receptance x/F, over a wide range and around the driven mode; `amplitude` of the charge in C for hysteresis."""
    figure, axes = style.grid_of_axes(2, 2, height=4.7, sharex="col")
    curves: list[tuple[str, Shunt, dict[str, Any]]] = [("shorted", Short(), _SHORT), ("open", Open(), _OPEN)]
    best = best_linear(subjects)
    if best is not None:
        curves.append((f"{best.label} (best linear candidate)", best.shunt, {**best.style, "linestyle": "-"}))
    for column, span in enumerate((wide_span(study.transducer), resonance_span(study))):
        frequencies = dense(span, study.transducer)
        for _, shunt, line in curves:
            system = System(study.transducer, shunt)
            response = frequency_response(system, frequencies, amplitude=amplitude).displacement
            axes[0, column].plot(frequencies, np.abs(response), **line)
            axes[1, column].plot(frequencies, _phase(response), **line)
        _finish(axes[:, column], span, None if design_band(study) else drive_frequency(study))
    axes[0, 0].set_ylabel("receptance |x/F|")
    axes[1, 0].set_ylabel("phase of x/F in degrees")
    figure.align_ylabels(axes[:, 0])
    axes[0, 0].set_title("all modes" if study.transducer.modes else "wide")
    axes[0, 1].set_title("around the resonance")
    style.legend_above(figure, [Line2D([], [], label=label, **line) for label, _, line in curves], 3)
    return figure


def best_linear(subjects: Sequence[Subject]) -> Subject | None:
    """Best ranked linear candidate, open and short excluded."""
    return next((s for s in subjects if s.linear and not isinstance(s.shunt, Open | Short)), None)


def charge_amplitude(study: Study, subjects: Sequence[Subject]) -> float | None:
    """Charge amplitude in C for the describing function of the hysteresis: of the best (linear) candidate."""
    if not hysteretic(study.transducer):
        return None
    first = best_linear(subjects)
    for subject in ([first] if first else []) + list(subjects):
        if subject.waveforms is not None:
            charge = subject.waveforms.charge
            half = 0.5 * float(np.max(charge) - np.min(charge))
            return half if half > 0 else None
    return None


def _phase(response: np.ndarray) -> np.ndarray:
    """Unwrapped phase in degrees, from -270 to 90 for a single mode that begins at 0."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    return phase - 360 * np.round(phase[0] / 360)


def _finish(axes: np.ndarray, span: Span, drive: float | None) -> None:
    style.log_axis(axes[0].yaxis, "m/N")
    axes[1].yaxis.set_major_locator(MultipleLocator(45))
    style.frequency_axis(axes[1], span.logarithmic)
    if drive is not None and span.low <= drive <= span.high:
        for one in axes:
            one.axvline(drive, color=style.MUTED, linewidth=0.8, linestyle=":")
        words = f"drive {engineering(drive, 'Hz', 5, exact=True)}"
        axes[0].annotate(words, (drive, 0), xycoords=("data", "axes fraction"), xytext=(3, 3),
                         textcoords="offset points", fontsize=8, color=style.MUTED)  # fmt: skip
