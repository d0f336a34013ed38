"""Figures of the page; each is a function of nothing, by the name of its file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from piezoharvest.report.figures import style
from reports.actuators import mirror, stack
from reports.actuators.data import LEVELS, STACK_RATE, minor_loops, sine
from reports.actuators.results import comparison, hysteretic_shifts

_MEASURED = {"color": style.MUTED, "linewidth": 3.0, "alpha": 0.45}
_COLOURS = style.PALETTE


@style.styled
def loops() -> Figure:
    """Displacement over voltage: the sine that was fitted, minor loops that were predicted."""
    figure, axes = style.grid_of_axes(1, 2, height=3.4, sharey=True)
    fit, first, second = stack.operator(), sine(), minor_loops()
    settled = slice(stack.SETTLED, None)
    fitted = fit.predict(first.voltage[settled], fit.states)
    parts = (
        ("fitted: 1 Hz sine, a cycle", first.voltage[settled], first.displacement[settled], fitted, slice(2000, 2201)),
        ("predicted: shrinking loops", *second[:2], fit.predict(second.voltage), slice(2900, 3900)),
    )
    for ax, (title, voltage, measured, predicted, rows) in zip(axes, parts, strict=True):
        ax.plot(voltage[rows], measured[rows] - measured[rows].mean(), label="measured", **_MEASURED)
        ax.plot(voltage[rows], predicted[rows] - predicted[rows].mean(), label="P-I", color=_COLOURS[1], linewidth=1.0)
        ax.set(title=title, xlabel="control voltage in V")
    axes[0].set_ylabel("displacement from its mean in µm")
    axes[0].legend(loc="upper left")
    return figure


@style.styled
def minor() -> Figure:
    """The first window of the test file: displacement, and the error of prediction."""
    figure, axes = style.grid_of_axes(2, height=4.2, sharex=True, height_ratios=(1.3, 1))
    record, errors = minor_loops(), stack.prediction_errors()
    window = stack.WINDOWS["without inverse"]
    time = np.arange(window.start, window.stop) / STACK_RATE
    measured, predicted = record.displacement[window], (record.displacement - errors)[window]
    axes[0].plot(time, measured - measured.mean(), label="measured", **_MEASURED)
    axes[0].plot(time, predicted - predicted.mean(), label="predicted from the sine", color=_COLOURS[1], linewidth=1.0)
    axes[0].set_ylabel("displacement in µm")
    axes[0].legend(loc="upper left")
    error = errors[window] - errors[window].mean()
    axes[1].plot(time, error, color=_COLOURS[1], linewidth=1.0, label=f"prediction, rms {error.std():.2f} µm")
    wanted = (record.displacement - record.wanted)[window]
    label = f"tracking without inverse, rms {wanted.std():.2f} µm"
    axes[1].plot(time, wanted - wanted.mean(), color=style.MUTED, linewidth=1.0, label=label)
    axes[1].set(ylabel="error in µm", xlabel="time in s", ylim=(-6.5, 5))
    axes[1].legend(loc="lower left", ncols=2)
    return figure


@style.styled
def tracking() -> Figure:
    """Second window: tracking error with the authors' inverse, and that predicted for ours."""
    figure, axes = style.grid_of_axes(1, height=2.9)
    record, window = minor_loops(), stack.WINDOWS["with the paper's inverse"]
    time = np.arange(window.start, window.stop) / STACK_RATE
    lagged = stack.window_errors()[2][1]
    lines = (
        ("measured with the paper's inverse", (record.wanted - record.displacement)[window], style.MUTED),
        ("predicted, inverse P-I", -stack.prediction_errors()[window], _COLOURS[1]),
        ("predicted, inverse P-I and lag undone", -lagged, _COLOURS[0]),
    )
    for name, error, colour in lines:
        centred = error - error.mean()
        axes.plot(time, centred, color=colour, linewidth=1.0, label=f"{name}: {centred.std():.2f} µm rms")
    axes.set(xlabel="time in s", ylabel="tracking error in µm", ylim=(-1.9, 2.7))
    axes.legend(loc="upper left")
    return figure


@style.styled
def breakdown() -> Figure:
    """Held-out error by term, and how well the records tell the lag."""
    figure, axes = style.grid_of_axes(1, 2, height=3.3, width_ratios=(1.5, 1))
    steps = stack.breakdown()
    place = np.arange(len(steps))
    for n, name in enumerate(stack.WINDOWS):
        values = [step.windows[n] for step in steps]
        axes[0].barh(place + 0.2 - 0.4 * n, values, height=0.36, color=_COLOURS[n], label=f"window {name}")
    axes[0].axvline(stack.PAPER["with the paper's inverse"], color=style.LIMIT, linewidth=1.0)
    words = {"color": style.LIMIT, "ha": "right", "va": "center", "rotation": 90, "fontsize": 8}
    axes[0].text(0.575, 2.0, "tracking error of the paper", **words)
    axes[0].axvline(stack.repeat_noise(), color=style.INK, linestyle=":", linewidth=1.0)
    axes[0].text(0.08, -0.52, "noise", fontsize=8)
    names = ["P-I from the sine", "P-I, more data", "+ lag", "+ asymmetry", "+ creep", "20 thresholds"]
    axes[0].set_yticks(place, names)
    axes[0].set(xlabel="error in the windows in µm rms, mean removed", xlim=(0, 0.62), ylim=(5.75, -0.75))
    style.legend_above(figure, axes[0].get_legend_handles_labels()[0])
    lags = np.linspace(0.0005, 0.025, 13)
    names = ("sine alone", "with minor loops")
    for name, values, colour in zip(names, stack.lag_profile(lags), _COLOURS, strict=False):
        axes[1].plot(lags * 1e3, values, color=colour, label=name)
    axes[1].set(xlabel="lag in ms", ylabel="rms of the fit in µm", ylim=(0.28, 0.46))
    axes[1].legend(loc="upper center")
    return figure


@style.styled
def responses() -> Figure:
    """Two of the nine responses, with noise and distortion, and the first resonances of one from near."""
    figure, axes = style.grid_of_axes(3, height=6.6)
    for ax, (j, low, high) in zip(axes, ((1, 0, 3000), (0, 600, 1050), (1, 1270, 1500)), strict=True):
        for n, level in enumerate(LEVELS):
            r, colour = mirror.response(level), _COLOURS[n]
            seen = (r.frequency >= low) & (r.frequency <= high)
            x = r.frequency[seen]
            ax.plot(x, np.abs(r.response[seen, j, j]) * 1e6, color=colour, linewidth=0.8, label=f"{level} mV")
            ax.plot(x, r.total[seen, j, j] * 1e6, color=colour, linewidth=0.7, linestyle=(0, (4, 1.5)))
            ax.plot(x, r.noise[seen, j, j] * 1e6, color=colour, linewidth=0.7, linestyle=":")
        ax.set(yscale="log", ylabel=f"|G| {j + 1}{j + 1} in µm/V", xlim=(low, high))
        style.power_ticks(ax.yaxis)
    handles = axes[0].get_legend_handles_labels()[0]
    for dashes, name in (("-", "response"), ((0, (4, 1.5)), "noise and distortion"), (":", "noise alone")):
        handles.append(Line2D([], [], color=style.INK, linewidth=0.9, linestyle=dashes, label=name))
    style.legend_above(figure, handles, columns=6)
    axes[-1].set(xlabel="frequency in Hz")
    return figure


@style.styled
def fits() -> Figure:
    """One response with its linear model, and the number of modes."""
    figure, axes = style.grid_of_axes(1, 2, height=3.1, width_ratios=(1.7, 1))
    number, (chosen, errors) = mirror.selected(), mirror.selection()
    r, modes = mirror.response(200), mirror.fits(number)[200].modes
    modelled = modes.response(r.frequency)
    axes[0].plot(r.frequency, np.abs(r.response[:, 0, 0]) * 1e6, label="measured, 200 mV", **_MEASURED)
    for values, name, look in (
        (modelled, f"{number} modes", {"color": _COLOURS[1], "linewidth": 0.8}),
        (r.response - modelled, "difference", {"color": _COLOURS[0], "linewidth": 0.5}),
        (r.total, "uncertainty", {"color": style.INK, "linewidth": 0.8, "linestyle": ":"}),
    ):
        axes[0].plot(r.frequency, np.abs(values[:, 0, 0]) * 1e6, label=name, **look)
    axes[0].set(yscale="log", xlim=(0, 3000), ylim=(1e-3, 2e3), xlabel="frequency in Hz", ylabel="|G| 11 in µm/V")
    style.power_ticks(axes[0].yaxis)
    axes[0].legend(loc="upper right", ncols=2)
    axes[1].plot(list(errors), [100 * e for e in errors.values()], marker="o", color=_COLOURS[0])
    axes[1].plot([chosen], [100 * errors[chosen]], marker="o", markersize=9, markerfacecolor="none", color=style.LIMIT)
    axes[1].set(xlabel="modes", ylabel="error on other realisations in %", ylim=(0, None))
    return figure


@style.styled
def levels() -> Figure:
    """Resonances against level: relative change of frequency, and damping."""
    figure, axes = style.grid_of_axes(2, height=4.8, sharex=True)
    found = mirror.level_changes()
    place = np.arange(len(found))
    for n, level in enumerate(LEVELS):
        x = place + 0.22 * (n - 1)
        shift = [100 * mode.shifts[n] for mode in found]
        bars = [200 * mode.shifts_std[n] for mode in found]
        axes[0].errorbar(x, shift, bars, fmt="o", markersize=4, color=_COLOURS[n], label=f"{level} mV", linewidth=1)
        damping = [100 * mode.dampings[n] for mode in found]
        spread = [200 * mode.dampings_std[n] for mode in found]
        axes[1].errorbar(x, damping, spread, fmt="o", markersize=4, color=_COLOURS[n], linewidth=1)
    predicted = [100 * shift for shift in hysteretic_shifts()]
    look = {"markersize": 6, "markerfacecolor": "none", "markeredgecolor": style.INK}
    axes[0].plot(place + 0.22, predicted, "s", label="300 mV, P-I model", **look)
    axes[0].axhline(0, color=style.MUTED, linewidth=0.7)
    axes[0].set_ylabel("frequency against 100 mV in %")
    axes[0].legend(loc="lower left", ncols=4)
    axes[1].set_ylabel("damping ratio in %")
    axes[1].set_xticks(place, [f"{mode.frequency:.0f}" for mode in found], rotation=45)
    axes[1].set_xlabel("mode, by its frequency at 100 mV in Hz")
    return figure


@style.styled
def comparisons() -> Figure:
    """Test errors of all models."""
    figure, axes = style.grid_of_axes(1, height=3.2)
    rows = [row for row in comparison() if max(row.relative) < 25]
    place = np.arange(len(rows))
    for n, level in enumerate(LEVELS):
        values = [row.relative[n] for row in rows]
        axes.barh(place + 0.27 * (n - 1), values, height=0.25, color=_COLOURS[n], label=f"{level} mV")
    axes.set_yticks(place, [row.name for row in rows])
    axes.invert_yaxis()
    axes.set(xlabel="test error in % of the output's rms")
    style.legend_above(figure, axes.get_legend_handles_labels()[0])
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    function.__name__: function  # type: ignore[attr-defined]
    for function in (loops, minor, tracking, breakdown, responses, fits, levels, comparisons)
}
