"""Figures 2, 5, 6, 7, 8 and 9 of the paper in kind: the model's signals and loops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from piezoharvest import Response
from piezoharvest.description.hysteresis import play
from piezoharvest.report.figures import style
from reports.paper.rows import Bench, sampled, sine, step
from reports.paper.tables import parameters

_PANELS = {
    "force": ("force in kN", 1e-3), "displacement": ("displacement\nread in µm", 1e6), "voltage": ("voltage in V", 1.0),
    "current": ("current in µA", 1e6),
}  # fmt: skip
NAMES = ("Table V", "extended")
_THINNED = 10  # every so many samples of a period are enough to draw it


@style.styled
def play_operators() -> Figure:
    """Figure 2: two play operators and their sum, in the play reading of Table V; and the whole model's loop."""
    figure, axes = style.grid_of_axes(1, 3, height=2.7)
    thresholds = [float(parameters()[f"r_{n}"].printed.text) for n in (1, 2, 3)]
    slopes = [float(parameters()[f"w_{n}"].printed.text) for n in (1, 2, 3)]
    angle = np.linspace(0, 4.5 * np.pi, 1200)
    voltage = np.linspace(0.4, 1.0, len(angle)) * 1.5 * np.sin(angle)
    operators = [w * play(voltage, r) for r, w in zip(thresholds, slopes, strict=True)]
    for axis, curve, title in (
        (axes[0], operators[0], f"r₁ = {thresholds[0]:g} V, w₁ = {slopes[0]:g} µC/V"),
        (axes[1], operators[1], f"r₂ = {thresholds[1]:g} V, w₂ = {slopes[1]:g} µC/V"),
        (axes[2], sum(operators), "sum of all three"),
    ):
        axis.plot(voltage, curve, color=style.PALETTE[0])
        axis.set_title(title)
        axis.set_xlabel("$v_h$ in V")
    axes[0].set_ylabel("charge in µC")
    return figure


@style.styled
def responses(benches: Sequence[Bench], runs: Sequence[Sequence[Response]], names: Sequence[str], window) -> Figure:
    """Signals of runs in columns, the benches over each other.

    Parameters
    ----------
    benches : sequence of Bench
    runs : sequence of sequences of Response
        For each bench a response for each column.
    names : sequence of str
        Signals to be drawn, of force, displacement, voltage and current.
    window : sequence of tuple
        For each column: title, begin and end in s.
    """
    figure, axes = style.grid_of_axes(
        len(names), len(window), height=1.1 + 1.15 * len(names), sharex="col", sharey="row", squeeze=False
    )
    for n, (bench, responses_) in enumerate(zip(benches, runs, strict=True)):
        for column, (response, (title, begin, end)) in enumerate(zip(responses_, window, strict=True)):
            signals = sampled(bench, response)
            inside = (signals.time >= begin - 1e-9) & (signals.time <= end + 1e-9)
            for axis, name in zip(axes[:, column], names, strict=True):
                factor = _PANELS[name][1]
                values = factor * getattr(signals, name)[inside]
                axis.plot(signals.time[inside], values, label=NAMES[n], **style.line_style(n))
            axes[0, column].set_title(title)
            axes[0, column].set_xlim(begin, end)
            axes[-1, column].set_xlabel("time in s")
    for axis, name in zip(axes[:, 0], names, strict=True):
        axis.set_ylabel(_PANELS[name][0])
    figure.align_ylabels(axes[:, 0])
    style.legend_above(figure, axes[0, 0].get_legend_handles_labels()[0])
    return figure


def figure_5(benches: Sequence[Bench], load: float) -> Figure:
    """A step of 1 kN for 5 s and its release."""
    runs = [[step(bench, 1000.0, load)] * 2 for bench in benches]
    return responses(benches, runs, tuple(_PANELS), [("load and release", 0.0, 10.0), ("the first second", 0.0, 1.0)])


def figure_6(benches: Sequence[Bench], load: float) -> Figure:
    """Sines to 1 kN at 1 and 5 Hz."""
    runs = [[sine(bench, 1000.0, f, load) for f in (1.0, 5.0)] for bench in benches]
    return responses(benches, runs, tuple(_PANELS), [("1 Hz", 0.0, 2.0), ("5 Hz", 0.0, 0.4)])


def figures_8_9(benches: Sequence[Bench], load: float) -> Figure:
    """Displacement and current at 1.25 kN: a step, and a sine of 2 Hz."""
    runs = [[step(bench, 1250.0, load), sine(bench, 1250.0, 2.0, load)] for bench in benches]
    window = [("step of 1.25 kN (Fig. 8)", 0.0, 10.0), ("sine to 1.25 kN, 2 Hz (Fig. 9)", 0.0, 2.0)]
    return responses(benches, runs, ("displacement", "current"), window)


@style.styled
def figure_7(benches: Sequence[Bench], load: float) -> Figure:
    """Displacement-force and displacement-voltage loops from 1 to 5 Hz."""
    figure, axes = style.grid_of_axes(2, 2, height=5.4, sharex="col")
    for line, (bench, name) in enumerate(zip(benches, NAMES, strict=True)):
        for n, frequency in enumerate((1.0, 2.0, 3.0, 4.0, 5.0)):
            response = sine(bench, 1000.0, frequency, load)
            waves = response.waveforms
            assert waves is not None
            reading = 1e6 * bench.reading(waves.drive, waves.displacement)
            around = np.append(np.arange(0, len(waves.time), _THINNED), 0)
            look = {"color": style.PALETTE[n], "linewidth": 1.2, "label": f"{frequency:g} Hz"}
            axes[line, 0].plot(1e-3 * waves.drive[around], reading[around] - reading.mean(), **look)
            axes[line, 1].plot(waves.voltage[around], reading[around] - reading.mean(), **look)
        axes[line, 0].set_title(f"{name}: displacement and force")
        axes[line, 1].set_title(f"{name}: displacement and voltage")
        axes[line, 0].set_ylabel("displacement read in µm,\nmean removed")
    axes[1, 0].set_xlabel("force in kN")
    axes[1, 1].set_xlabel("voltage in V")
    style.legend_above(figure, axes[0, 0].get_legend_handles_labels()[0], 5)
    return figure
