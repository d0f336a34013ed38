"""Figures of a diagnosis: residuals without and with the effects found, and failed residual tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from piezoharvest.diagnose.discovery.result import Discovery
from piezoharvest.diagnose.residual_structure.residual_tests import ResidualTest, drive_frequency_of
from piezoharvest.diagnose.residuals import Residuals, in_bins
from piezoharvest.records.reading.channels import UNITS
from piezoharvest.report.figures import style
from piezoharvest.report.units import prefix_of, pretty_unit

BEFORE = {"color": style.PALETTE[1], "linewidth": 0.7}
AFTER = {"color": style.PALETTE[0], "linewidth": 0.7}
_BAND = {"color": style.PALETTE[2], "alpha": 0.3, "linewidth": 0, "zorder": 3}
_PANEL = 1.35  # inches
_BINS = 40
BAND_ERRORS = 3.0  # standard errors of a law's band: 99.7 % of a normal distribution
# Points of a residual over time: averaging reveals structure below the noise of single samples.
_TIME_POINTS = 200
_SPECTRUM_POINTS = 160  # points of a spectrum
PARTNERS = {"voltage": "displacement", "current": "voltage", "force": "displacement"}  # others: the drive


def _legend(figure: Figure, changed: bool) -> None:
    handles = [Line2D([], [], label="without effects", **{**BEFORE, "linewidth": 1.5})]
    if changed:
        handles.append(Line2D([], [], label="with effects", **{**AFTER, "linewidth": 1.5}))
    handles.append(Line2D([], [], color=style.PALETTE[2], alpha=0.5, linewidth=6, label="noise (±2σ, or its density)"))
    style.legend_above(figure, handles)


def _means(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Means over equal spans of time, and the number of samples of each."""
    each = max(1, len(values) // _TIME_POINTS)
    kept = len(values) // each * each
    return time[:kept].reshape(-1, each).mean(axis=1), values[:kept].reshape(-1, each).mean(axis=1), each


def _over_time(axes: Axes, found: Residuals, c: int, changed: bool, factor: float = 1.0) -> str:
    """Draw means of a channel's residual over time; returns their unit."""
    sides = [(found.before[:, c], BEFORE)] + ([(found.after[:, c], AFTER)] if changed else [])
    drawn = [(*_means(found.time, values), look) for values, look in sides]
    band = 2 * found.noise[c] / np.sqrt(drawn[0][2])
    most = max(band, *(float(np.abs(mean).max()) for _, mean, _, _ in drawn))
    scale, unit = prefix_of(most, UNITS[found.data.channels[c]])
    for time, mean, _, look in drawn:
        axes.plot(factor * time, scale * mean, **{**look, "linewidth": 1.0})
    axes.axhspan(-scale * band, scale * band, **{**_BAND, "zorder": 1})
    return unit


def _spectra(axes: Axes, found: Residuals, c: int, changed: bool) -> str:
    """Draw spectra of a channel's residual; returns the unit of the density."""
    step, noise = found.data.setting.sample_time, found.noise[c]
    scale, unit = prefix_of(float(noise * np.sqrt(2 * step)), UNITS[found.data.channels[c]])
    for values, look in [(found.before[:, c], BEFORE)] + ([(found.after[:, c], AFTER)] if changed else []):
        axes.loglog(*spectrum(values, step, scale), **{**look, "linewidth": 1.1})
    axes.axhline(scale * noise * np.sqrt(2 * step), color=style.PALETTE[2], linewidth=3, alpha=0.5, zorder=1.5)
    style.power_ticks(axes.xaxis)
    style.power_ticks(axes.yaxis)
    axes.yaxis.set_minor_formatter(NullFormatter())
    return f"{unit}/√Hz"


@style.styled
def record_figure(found: Residuals, changed: bool) -> Figure:
    """Draw the residuals of a record: means over time on the left, their spectra on the right."""
    channels = found.data.channels
    figure, axes = style.grid_of_axes(
        len(channels), 2, height=_PANEL * len(channels) + 0.75, sharex="col", squeeze=False
    )
    factor, unit = prefix_of(float(found.time[-1]), "s")
    for c, ((left, right), channel) in enumerate(zip(axes, channels, strict=True)):
        left.set_ylabel(f"{channel}\nin {_over_time(left, found, c, changed, factor)}")
        right.set_ylabel(f"density\nin {_spectra(right, found, c, changed)}")
    axes[-1, 0].set_xlabel(f"time in {unit}")
    axes[-1, 1].set_xlabel("frequency in Hz")
    figure.align_ylabels()
    _legend(figure, changed)
    return figure


def spectrum(values: np.ndarray, step: float, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude spectral density, one-sided, averaged over bins on a logarithmic axis."""
    lines = np.abs(np.fft.rfft(values)) ** 2 * 2 * step / len(values)
    frequencies = np.fft.rfftfreq(len(values), step)
    edges = np.unique(np.round(np.geomspace(1, len(lines), _SPECTRUM_POINTS)).astype(int))
    sums, counts = np.add.reduceat(lines, edges[:-1]), np.diff(edges)
    sums[-1] = lines[edges[-2] : edges[-1]].sum()
    middle = np.add.reduceat(frequencies, edges[:-1])
    middle[-1] = frequencies[edges[-2] : edges[-1]].sum()
    return middle / counts, scale * np.sqrt(sums / counts)


@style.styled
def cause_figure(found: Residuals, c: int, changed: bool) -> Figure:
    """Draw a channel's residual so that its cause is visible: loop, mean residual along it or over time, spectrum."""
    data, channel = found.data, found.data.channels[c]
    partner = PARTNERS.get(channel, data.drive)
    partner = partner if partner in data.record.signals else data.drive
    x, y = data.record[partner], data.record[channel]
    figure, axes = style.grid_of_axes(1, 3, height=2.9)
    fx, ux = prefix_of(float(np.abs(x).max()), UNITS[partner])
    fy, uy = prefix_of(float(np.abs(y).max()), UNITS[channel])
    along = f"{partner.replace('_', ' ')} in {ux}"
    axes[0].plot(fx * x[::2], fy * y[::2], color=style.MUTED, linewidth=0.6)
    axes[0].set_xlabel(along)
    axes[0].set_ylabel(f"measured {channel} in {uy}")
    if drive_frequency_of(data) is None:
        unit = _over_time(axes[1], found, c, changed)
        axes[1].set_xlabel("time in s")
    else:
        unit = _along(axes[1], found, c, changed, fx * x)
        axes[1].set_xlabel(along)
    axes[1].set_ylabel(f"mean residual in {unit}")
    axes[2].set_ylabel(f"density of the residual in {_spectra(axes[2], found, c, changed)}")
    axes[2].set_xlabel("frequency in Hz")
    _legend(figure, changed)
    return figure


def _along(axes: Axes, found: Residuals, c: int, changed: bool, x: np.ndarray) -> str:
    """Draw means of a residual along a loop, solid while the signal rises, dashed while it falls; returns the unit."""
    sides = [(found.before[:, c], BEFORE)] + ([(found.after[:, c], AFTER)] if changed else [])
    branches = [(*_branch(x, values, rising), look, rising) for values, look in sides for rising in (True, False)]
    scale, unit = prefix_of(
        max(float(np.nanmax(np.abs(mean))) for _, mean, _, _ in branches), UNITS[found.data.channels[c]]
    )
    for level, mean, look, rising in branches:
        axes.plot(level, scale * mean, color=look["color"], linestyle="-" if rising else (0, (3, 1.5)), linewidth=1.3)
    return unit


def _branch(x: np.ndarray, values: np.ndarray, rising: bool) -> tuple[np.ndarray, np.ndarray]:
    """Mean of values in bins of a signal while it rises or falls."""
    kernel = np.ones(9) / 9
    rate = np.gradient(np.convolve(x, kernel, "same"))
    kept = rate >= 0 if rising else rate < 0
    edges = np.linspace(x.min(), x.max(), _BINS + 1)
    place = np.clip(np.searchsorted(edges, x[kept], side="right") - 1, 0, _BINS - 1)
    count = np.bincount(place, minlength=_BINS)
    mean = np.where(count >= 5, np.bincount(place, values[kept], minlength=_BINS) / np.maximum(count, 1), np.nan)
    return 0.5 * (edges[1:] + edges[:-1]), mean


@style.styled
def structure_figure(sides: Sequence[tuple[str, Sequence[ResidualTest]]]) -> Figure:
    """Draw the ratio of residuals to noise, by record, channel and frequency band."""
    bands = [p for p in sides[0][1] if " Hz" in p.where and p.record != "all"]
    columns = sorted({p.where for p in bands}, key=_lowest)
    rows = list(dict.fromkeys((p.record, p.channel) for p in sorted(bands, key=lambda p: (p.record, p.channel))))
    figure, axes = style.grid_of_axes(1, len(sides), height=0.19 * len(rows) + 1.5, sharey=True, squeeze=False)
    for one, (title, places) in zip(axes[0], sides, strict=True):
        values = {(p.record, p.channel, p.where): p.excess for p in places}
        table = np.array([[values.get((*row, column), np.nan) for column in columns] for row in rows])
        table = np.sign(table) * np.log10(1.0 + np.abs(table))
        one.imshow(table, aspect="auto", cmap="RdBu_r", vmin=-3.0, vmax=3.0, interpolation="nearest")
        one.set_title(title)
        one.set_xticks(range(len(columns)), [_short(column) for column in columns], rotation=60, ha="right")
        one.grid(False)
    axes[0, 0].set_yticks(
        range(len(rows)),
        [f"{style.plain(record.rsplit('.', 1)[0])[:24]} {channel}" for record, channel in rows],
        fontsize=6.5,
    )
    ticks = [-100, -10, -1, 0, 1, 10, 100]
    bar = figure.colorbar(axes[0, -1].images[0], ax=list(axes[0]), shrink=0.9, aspect=30, extend="both",
                          ticks=[float(np.sign(t) * np.log10(1 + abs(t))) for t in ticks])  # fmt: skip
    bar.ax.set_yticklabels([f"{t:g}".replace("-", "−") for t in ticks])
    bar.ax.grid(False)
    bar.set_label("excess over noise, σ")
    return figure


def _lowest(where: str) -> float:
    words = where.split()
    return float(words[1] if words[0] == "above" else words[0])


def _short(where: str) -> str:
    return where.replace(" to ", "–").replace("above ", "> ")


@style.styled
def where_figure(found: Sequence[Residuals], channel: str, changed: bool) -> Figure:
    """Draw the whitened residual of a channel against time, level and rate of the drive, and in the phase plane."""
    mine = [(each, each.data.channels.index(channel)) for each in found if channel in each.data.channels]
    figure, axes = style.grid_of_axes(2, 2, height=4.6)
    drive = mine[0][0].data.drive
    mine = [pair for pair in mine if pair[0].data.drive == drive]
    level = [each.data.record[drive] - each.data.rest for each, _ in mine]
    rate = [
        1e-3 * np.gradient(values, each.data.setting.sample_time) for values, (each, _) in zip(level, mine, strict=True)
    ]
    time = [each.time for each, _ in mine]
    unit = UNITS[drive]
    sides = [("white_before", BEFORE)] + ([("white_after", AFTER)] if changed else [])
    for name, look in sides:
        white = np.concatenate([getattr(each, name)[:, c] for each, c in mine])
        for one, where in ((axes[0, 0], time), (axes[0, 1], level), (axes[1, 0], rate)):
            _binned(one, white, np.concatenate(where), look)
    axes[0, 0].set_xlabel("time in the record in s")
    axes[0, 1].set_xlabel(f"{drive.replace('_', ' ')} in {pretty_unit(unit)}")
    axes[1, 0].set_xlabel(f"rate of change in {pretty_unit(unit)}/ms")
    for one in (axes[0, 0], axes[0, 1], axes[1, 0]):
        one.axhspan(-2, 2, **{**_BAND, "zorder": 1})
        one.set_ylabel("mean in σ")
    _plane(figure, axes[1, 1], np.concatenate(level), np.concatenate(rate), mine, sides[-1][0], drive)
    _legend(figure, changed)
    return figure


def _binned(axes: Axes, white: np.ndarray, where: np.ndarray, look: dict) -> None:
    low, high = np.quantile(where, (0.002, 0.998))
    edges = np.linspace(low, high, _BINS + 1)
    if edges[-1] > edges[0]:
        axes.plot(
            0.5 * (edges[1:] + edges[:-1]),
            in_bins(white, where, edges),
            **{**look, "linewidth": 1.2},
            marker=".",
            markersize=3,
        )


def _plane(figure: Figure, axes: Axes, level: np.ndarray, rate: np.ndarray, mine, name: str, drive: str) -> None:
    """Draw means in cells of the drive and its rate."""
    white = np.concatenate([getattr(each, name)[:, c] for each, c in mine])
    number = 24
    reach = float(np.quantile(np.abs(rate), 0.99)) or 1.0
    columns = np.linspace(level.min(), level.max(), number + 1)
    rows = np.linspace(-reach, reach, number + 1)
    a = np.clip(np.searchsorted(columns, level, side="right") - 1, 0, number - 1)
    b = np.clip(np.searchsorted(rows, rate, side="right") - 1, 0, number - 1)
    table = in_bins(white, (b * number + a).astype(float), np.arange(number**2 + 1.0)).reshape(number, number)
    most = max(3.0, float(np.nanquantile(np.abs(table), 0.98)))
    image = axes.pcolormesh(columns, rows, table, cmap="RdBu_r", vmin=-most, vmax=most, rasterized=True)
    axes.set_xlabel(f"{drive.replace('_', ' ')} in {pretty_unit(UNITS[drive])}")
    axes.set_ylabel(f"rate in {pretty_unit(UNITS[drive])}/ms")
    axes.grid(False)
    figure.colorbar(
        image, ax=axes, label=f"mean in σ, {'with effects' if name == 'white_after' else 'without effects'}"
    )


@style.styled
def cosine_figure(names: Sequence[str], table: np.ndarray) -> Figure:
    """Draw the cosines of the effects' signatures in these records."""
    figure, axes = style.grid_of_axes(1, height=0.26 * len(names) + 1.7)
    image = axes.imshow(table, cmap="RdBu_r", vmin=-1, vmax=1, aspect="auto", interpolation="nearest")
    words = [name.replace("_", " ") for name in names]
    axes.set_xticks(range(len(names)), words, rotation=50, ha="right")
    axes.set_yticks(range(len(names)), words)
    axes.grid(False)
    for i in range(len(names)):
        for j in range(len(names)):
            if i != j and abs(table[i, j]) >= 0.3:
                colour = "white" if abs(table[i, j]) > 0.6 else style.INK
                axes.text(
                    j, i, f"{table[i, j]:.2f}".replace("-", "−"), ha="center", va="center", fontsize=7, color=colour
                )
    figure.colorbar(image, ax=axes, label="cosine")
    return figure


@style.styled
def law_figure(law: Discovery) -> Figure:
    """Draw what a law adds at its place against its input, with a band of three standard errors."""
    place = law.law.place
    figure, axes = style.grid_of_axes(1, height=2.9)
    x, y, band = law.input, law.value, BAND_ERRORS * law.std
    fx, x_unit = prefix_of(float(abs(x).max()), place.input_unit)
    fy, y_unit = prefix_of(float((abs(y) + band).max()), place.unit)
    axes.fill_between(fx * x, fy * (y - band), fy * (y + band), color=style.PALETTE[2], alpha=0.3, linewidth=0)
    axes.plot(fx * x, fy * y, color=style.PALETTE[0])
    axes.axhline(0.0, color=style.MUTED, linewidth=0.7)
    name = place.input.replace("_", " ")
    axes.set_xlabel(f"{name} ({x_unit})" if x_unit else name)
    axes.set_ylabel(f"added at the {style.plain(place.name.replace('.', ' of '))}" + (f" ({y_unit})" if y_unit else ""))
    return figure
