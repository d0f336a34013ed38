"""What other circuits would take from the same force cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from piezoharvest import Resistor, Transducer
from piezoharvest.report.figures import style
from reports.paper.beyond import DROPS, power
from reports.paper.tables import experiment


@style.styled
def load_curves(devices: dict[str, Transducer]) -> Figure:
    """Mean power over the load resistance at 1 and 5 Hz, the paper's loads marked; one panel for each device."""
    figure, axes = style.grid_of_axes(1, len(devices), height=3.0, sharex=True, squeeze=False)
    loads = np.geomspace(1e3, 1e6, 49)
    for axis, (name, device) in zip(axes[0], devices.items(), strict=True):
        for n, frequency in enumerate((1.0, 5.0)):
            curve = [power(device, Resistor(resistance=load), 1000.0, frequency) for load in loads]
            axis.plot(loads, 1e6 * np.array(curve), label=f"{frequency:g} Hz", **style.line_style(n))
            marks = [power(device, Resistor(resistance=load), 1000.0, frequency) for load in experiment()["loads_ohm"]]
            axis.plot(experiment()["loads_ohm"], 1e6 * np.array(marks), "o", color=style.PALETTE[n], markersize=5)
        axis.set_title(name)
        style.log_axis(axis.xaxis, "Ω")
        axis.set_xlabel("load resistance")
        axis.set_ylim(0, None)
    axes[0, 0].set_ylabel("mean power in µW")
    style.legend_above(figure, axes[0, 0].get_legend_handles_labels()[0])
    return figure


@style.styled
def against_drops(panels: Mapping[str, Mapping[str, Sequence[float]]]) -> Figure:
    """Best power over the drop of a diode, one line for each interface, one panel for each case."""
    figure, axes = style.grid_of_axes(1, len(panels), height=3.1, sharex=True, squeeze=False)
    for axis, (title, curves) in zip(axes[0], panels.items(), strict=True):
        for n, (name, powers) in enumerate(curves.items()):
            axis.plot(DROPS, 1e6 * np.array(powers), marker=".", label=name, **style.line_style(n))
        axis.set_title(title)
        axis.set_xlabel("drop of one diode in V")
        axis.set_ylim(0, None)
        axis.set_xticks([0.0, 0.2, 0.4, 0.6])
    axes[0, 0].set_ylabel("best mean power in µW")
    style.legend_above(figure, axes[0, 0].get_legend_handles_labels()[0], 5)
    return figure
