"""Figures of measured records with the predictions of an identified model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from piezoharvest.identify.prediction_overlay import Predicted
from piezoharvest.readers.units import ratio_of
from piezoharvest.records import FrequencyRecord, Record
from piezoharvest.records.reading.channels import UNITS
from piezoharvest.report.figures import style
from piezoharvest.report.units import prefix_of, pretty_unit

_PIXELS = 900  # with more than two samples a pixel, their minimum and maximum is drawn
_MEASURED = {"color": style.PALETTE[0], "linewidth": 1.6}
_PREDICTED = {"color": style.PALETTE[1], "linewidth": 1.0, "linestyle": (0, (4, 2))}
_EXTENDED = {"color": style.INK, "linewidth": 1.0}
_BAND = {"color": style.PALETTE[2], "alpha": 0.25, "linewidth": 0}
_PANEL = 1.35  # inches


def thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Minimum and maximum of each pixel of very many samples, so that no spike is lost."""
    if len(x) <= 2 * _PIXELS:
        return x, y
    edges = np.linspace(0, len(x), _PIXELS + 1).astype(int)[:-1]
    extremes = np.column_stack((np.fmin.reduceat(y, edges), np.fmax.reduceat(y, edges))).ravel()
    return np.repeat(x[edges], 2), extremes


def fit_figure(predicted: Predicted) -> Figure:
    """Draw a record: measured and predicted on the left, residuals with twice the noise on the right.

    A response is drawn as magnitude and phase.
    """
    if isinstance(predicted.record, FrequencyRecord):
        return response_figure(predicted.record, {"predicted": predicted.values})
    return _time_figure(predicted, predicted.record)


@style.styled
def _time_figure(predicted: Predicted, record: Record) -> Figure:
    count = len(predicted.channels)
    figure, axes = style.grid_of_axes(count, 2, height=_PANEL * count + 0.75, sharex=True, squeeze=False)
    start = record["time"][0]
    factor, unit = prefix_of(record.duration, "s")
    x = factor * (record["time"] - start)
    for (left, right), channel, values in zip(axes, predicted.channels, predicted.values.T, strict=True):
        measured, noise = record[channel], predicted.judged.quality.noise[channel]
        scale, name = prefix_of(float(np.abs(measured).max()), UNITS[channel])
        left.plot(*thinned(x, scale * measured), **_MEASURED)
        left.plot(*thinned(x, scale * values), **_PREDICTED)
        left.set_ylabel(f"{channel}\nin {name}")
        residual = measured - values
        scale, name = prefix_of(float(max(np.abs(residual).max(), noise)), UNITS[channel])
        right.plot(*thinned(x, scale * residual), color=style.MUTED, linewidth=0.6)
        right.axhspan(-2 * scale * noise, 2 * scale * noise, zorder=3, **_BAND)
        right.set_ylabel(f"residual\nin {name}")
    for one in axes[-1]:
        one.set_xlabel(f"time in {unit}")
    figure.align_ylabels()
    style.legend_above(
        figure,
        [
            Line2D([], [], label="measured", **_MEASURED),
            Line2D([], [], label="predicted", **_PREDICTED),
            Line2D([], [], color=style.MUTED, linewidth=0.6, label="residual"),
            Line2D([], [], color=style.PALETTE[2], alpha=0.4, linewidth=6, label="±2 × noise"),
        ],
    )
    return figure


@style.styled
def response_figure(record: FrequencyRecord, predicted: Mapping[str, np.ndarray]) -> Figure:
    """Draw a response as magnitude and phase, with predictions (f,) by their names in the legend, and its residuals."""
    figure, axes = style.grid_of_axes(3, height=4.6, sharex=True)
    x = record.frequency
    unit = "ohm" if record.kind == "impedance" else ratio_of(UNITS[record.output], UNITS[record.input])
    axes[0].semilogy(x, np.abs(record.response), ".", markersize=3, color=style.PALETTE[0], label="measured")
    axes[1].plot(x, np.degrees(np.angle(record.response)), ".", markersize=3, color=style.PALETTE[0])
    for (name, values), line in zip(predicted.items(), (_PREDICTED, _EXTENDED), strict=False):
        axes[0].semilogy(x, np.abs(values), label=name, **line)
        axes[1].plot(x, np.degrees(np.angle(values)), **line)
        residual = 100 * np.abs(record.response - values) / np.abs(record.response)
        axes[2].plot(x, residual, ".", markersize=3, color=line["color"] if len(predicted) > 1 else style.MUTED)
    style.power_ticks(axes[0].yaxis)
    for one, label in zip(axes, (f"magnitude\nin {pretty_unit(unit)}", "phase in °", "residual\nin %"), strict=True):
        one.set_ylabel(label)
    style.frequency_axis(axes[-1], record.frequency[-1] > 3 * record.frequency[0] > 0)
    figure.align_ylabels()
    style.legend_above(figure, axes[0].get_legend_handles_labels()[0])
    return figure


@style.styled
def loops_figure(records: Sequence[Predicted]) -> Figure | None:
    """Draw displacement over force and voltage over charge, measured and predicted; None if neither is known.

    The charge is the integral of the load current.
    """
    panels = [panel for panel in (_strain_loops(records), _charge_loops(records)) if panel[0]]
    if not panels:
        return None
    figure, axes = style.grid_of_axes(1, len(panels), height=3.4, squeeze=False)
    for one, (curves, x_unit, y_unit, x_name, y_name) in zip(axes[0], panels, strict=True):
        fx, px = prefix_of(max(float(np.abs(c[0]).max()) for c in curves), x_unit)
        fy, py = prefix_of(max(float(np.abs(c[1]).max()) for c in curves), y_unit)
        for n, (x, measured, x_predicted, y) in enumerate(curves):
            colour = style.PALETTE[n % len(style.PALETTE)]
            one.plot(fx * x, fy * measured, color=colour, linewidth=2.4, alpha=0.4)
            one.plot(fx * x_predicted, fy * y, color=style.INK, linewidth=0.5)
        one.set_xlabel(f"{x_name} in {px}")
        one.set_ylabel(f"{y_name} in {py}")
    handles = [
        Line2D([], [], color=style.PALETTE[0], linewidth=2.4, alpha=0.4, label="measured (one colour per record)"),
        Line2D([], [], color=style.INK, linewidth=0.5, label="predicted"),
    ]
    style.legend_above(figure, handles)
    return figure


_Curve = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
_MAX_SAMPLES = 4000  # samples of a curve


def _strain_loops(records: Sequence[Predicted]) -> tuple[list[_Curve], str, str, str, str]:
    curves = []
    for each in records:
        if isinstance(each.record, Record) and each.record.drive == "force" and "displacement" in each.channels:
            force, x = each.record["force"], each.record["displacement"]
            offset = each.judged.own.get("displacement offset", 0.0)
            predicted = each.values[:, each.channels.index("displacement")]
            curves.append(_sparse(force, x - offset, force, predicted - offset))
    return curves, "N", "m", "force", "displacement"


def _charge_loops(records: Sequence[Predicted]) -> tuple[list[_Curve], str, str, str, str]:
    curves = []
    for each in records:
        if isinstance(each.record, Record) and {"voltage", "current"} <= set(each.channels):
            step = each.record.duration / (len(each.record) - 1)
            offset = each.judged.own.get("current offset", 0.0)
            charges = [
                -step * np.cumsum(current - offset)
                for current in (each.record["current"], each.values[:, each.channels.index("current")])
            ]
            voltage = each.values[:, each.channels.index("voltage")]
            curves.append(_sparse(charges[0], each.record["voltage"], charges[1], voltage))
    return curves, "C", "V", "charge carried", "voltage"


def _sparse(*arrays: np.ndarray) -> _Curve:
    stride = max(1, len(arrays[0]) // _MAX_SAMPLES)
    return tuple(array[::stride] for array in arrays)  # pyright: ignore[reportReturnType]
