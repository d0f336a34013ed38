"""Figures of measured records, with the findings of the checks marked."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezoharvest.records import Finding, FrequencyRecord, Record, Signal
from piezoharvest.records.finding import index_of
from piezoharvest.records.reading.channels import UNITS
from piezoharvest.report.figures import style
from piezoharvest.report.units import prefix_of, pretty_unit

_COLOURS = {"error": style.LIMIT, "warning": style.PALETTE[4]}
_PIXELS = 1500  # with more than two samples a pixel, their minimum and maximum is drawn
_WIDTH = 118  # characters in a line of the list of findings
_MAX_LISTED = 6  # findings that are written out
_PANEL, _LINE = 1.3, 0.16  # inches
_MAX_MARKS = 400
_MIN_MARK_WIDTH = 0.003  # of the width: smallest width of a mark
_EVERY_PANEL = ("", "time", "frequency")  # channels of findings that concern every panel


@style.styled
def record_figure(record: Record | FrequencyRecord, findings: Sequence[Finding] = ()) -> Figure:
    """Draw a record with its findings: one panel for each channel, rows with a fault shaded.

    Parameters
    ----------
    record : Record or FrequencyRecord
    findings : sequence of Finding
        Of this record, from `Campaign.findings`.

    Returns
    -------
    Figure
        With the file's name as title, and the findings below.
    """
    lines = _listed(findings)
    panels = _frequency_panels(record) if isinstance(record, FrequencyRecord) else _time_panels(record)
    height = _PANEL * len(panels) + _LINE * (len(lines) + 1) + 0.7
    figure, axes = style.grid_of_axes(len(panels), height=height, sharex=True, squeeze=False)
    for one, (channel, x, y, label, first_row) in zip(axes[:, 0], panels, strict=True):
        _draw(one, x, y)
        one.set_ylabel(label)
        of_all = [finding for finding in findings if finding.channel in _EVERY_PANEL]
        own = [finding for finding in findings if finding.channel == channel]
        for finding in (*of_all, *own):
            _shade(one, x, finding, first_row)
        _name(one, x, own if one is not axes[0, 0] else (*of_all, *own), first_row)
    if isinstance(record, FrequencyRecord):
        style.frequency_axis(axes[-1, 0], record.frequency[-1] > 3 * record.frequency[0] > 0)
    else:
        axes[-1, 0].set_xlabel(_time_axis(record)[1])
    figure.align_ylabels(axes[:, 0])
    figure.suptitle("\n".join((style.plain(f"{record.name} ({record.role})"), *lines)), x=0.01, ha="left", fontsize=8.5)
    return figure


def _listed(findings: Sequence[Finding]) -> list[str]:
    """Findings in words, errors first."""
    ordered = sorted(findings, key=lambda finding: finding.severity)
    lines = []
    for finding in ordered[:_MAX_LISTED]:
        text = f"{finding.severity}: {finding.check}: {finding.place}: {finding.message}"
        lines += textwrap.wrap(style.plain(text), _WIDTH, subsequent_indent="    ")
    more = len(ordered) - _MAX_LISTED
    return [*lines, f"and {more} more"] if more > 0 else lines or ["nothing found"]


def _time_panels(record: Record) -> list[tuple]:
    """Channel, x, y, label and first row of every panel, the drive first."""
    x = _time_axis(record)[0]
    panels = []
    for channel in (record.drive, *record.responses):
        signal: Signal = record.signals[channel]
        factor, unit = _scale(signal.values, UNITS[channel])
        name = channel.replace("base_acceleration", "base accel.")
        drive = " (drive)" if channel == record.drive else ""
        panels.append((channel, x, factor * signal.values, f"{name}{drive}\nin {unit}", signal.first_row))
    return panels


def _time_axis(record: Record) -> tuple[np.ndarray, str]:
    """Time if it increases, else row numbers."""
    time = record.time.values
    if np.isfinite(time).all() and np.all(np.diff(time) > 0):
        factor, unit = prefix_of(float(time[-1] - time[0]), "s")
        return factor * time, f"time in {unit}"
    first_row = record.time.first_row
    rows = first_row if isinstance(first_row, np.ndarray) else first_row + np.arange(len(record))
    return rows.astype(float), "row"


def _frequency_panels(record: FrequencyRecord) -> list[tuple]:
    """As `_time_panels`: magnitude in decibels, phase, and coherence where there is one."""
    over = UNITS[record.input]
    unit = pretty_unit(f"{UNITS[record.output]}/{f'({over})' if '/' in over else over}")
    name = f"{record.output} / {record.input}".replace("_", " ")
    if record.kind == "impedance":
        unit, name = pretty_unit("ohm"), "impedance"
    size = np.abs(record.response)
    level = 20 * np.log10(size, out=np.full(len(size), np.nan), where=size > 0)
    angle = np.degrees(np.angle(record.response))
    x, row = record.frequency, record.first_row
    panels = [
        ("response", x, level, f"{name}\nin dB re 1 {unit}", row),
        ("response", x, angle, "phase\nin degrees", row),
    ]
    return panels if record.coherence is None else [*panels, ("coherence", x, record.coherence, "coherence", row)]


def _scale(values: np.ndarray, unit: str) -> tuple[float, str]:
    finite = values[np.isfinite(values)]
    return prefix_of(float(np.max(np.abs(finite), initial=0.0)), unit)


def _draw(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Draw a signal; of very many samples the minimum and maximum of each pixel, so that no spike is lost."""
    if len(x) > 2 * _PIXELS:
        edges = np.linspace(0, len(x), _PIXELS + 1).astype(int)[:-1]
        x, y = np.repeat(x[edges], 2), np.column_stack((np.fmin.reduceat(y, edges), np.fmax.reduceat(y, edges))).ravel()
    axes.plot(x, y, color=style.PALETTE[0], linewidth=0.9)


def _shade(axes: Axes, x: np.ndarray, finding: Finding, first_row: int | np.ndarray) -> None:
    """Shade the rows of a finding; paler if it covers all rows."""
    least = _MIN_MARK_WIDTH * abs(x[-1] - x[0])
    step = max(1, len(finding.rows) // _MAX_MARKS)
    for first, last in finding.rows[::step]:
        begin, end = _at(x, first, first_row), _at(x, last, first_row)
        pad = max(0.0, (least - (end - begin)) / 2)
        alpha = 0.12 if last - first + 1 >= len(x) else 0.7 if pad else 0.35
        colour = _COLOURS[finding.severity]
        axes.axvspan(begin - pad, end + pad, color=colour, alpha=alpha, linewidth=0, zorder=0.5)


def _name(axes: Axes, x: np.ndarray, findings: Sequence[Finding], first_row: int | np.ndarray) -> None:
    """Write the names of the findings above the panel, each once, at its first row."""
    first = {finding.check: finding for finding in reversed(findings) if finding.rows}
    for finding in first.values():
        at = _at(x, finding.rows[0][0], first_row)
        axes.annotate(finding.check, (at, 1.0), xycoords=("data", "axes fraction"), color=_COLOURS[finding.severity],
                      fontsize=8, xytext=(0, 1.5), textcoords="offset points")  # fmt: skip


def _at(x: np.ndarray, row: int, first_row: int | np.ndarray) -> float:
    return float(x[min(max(index_of(row, first_row), 0), len(x) - 1)])
