"""Figures of the story: the voltage that the first simulation got wrong, and the powers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from piezoharvest.demo.story import Story
from piezoharvest.engine.response import Response
from piezoharvest.report.figures import style
from piezoharvest.report.figures.pictures import Picture
from piezoharvest.report.units import engineering

SHOWN = 1.5  # periods
SIMULATED, MEASURED, EXTENDED = style.PALETTE[0], style.INK, style.PALETTE[1]


def pictures(story: Story) -> Iterator[Picture]:
    """All figures, one after the other."""
    caption = (
        "Electrode voltage at the end of the record of the first measurement (dots), as simulated by the design, and "
        "as simulated by the model with the cause included. This record was not used in any fit."
    )
    yield Picture("voltage", "wrong", "Simulated and measured voltage", caption, _voltage(story))
    caption = (
        "Power of the load at the excitation of the design. Filled: simulated; open: measured on the virtual bench. "
        "The second and third bars are predictions of the first measurement, by models fitted to other records."
    )
    yield Picture("powers", "gain", "Powers, simulated and measured", caption, _powers(story))


@style.styled
def _voltage(story: Story) -> Any:
    figure, axes = style.grid_of_axes(1, height=2.8)
    period, record = story.study.excitation.period or 1.0, story.first.record
    begin = period * np.floor(record["time"][-1] / period - SHOWN)
    time = record["time"] - begin
    shown = (time >= 0.0) & (time <= SHOWN * period)
    handles = []
    for response, colour, label in (
        (story.designed.response, SIMULATED, "simulated by the design"),
        (story.extended, EXTENDED, "simulated with the cause"),
    ):
        handles += axes.plot(*_repeated(response, period), color=colour, label=label)
    marks = {"marker": "o", "markersize": 3.2, "linestyle": "none", "markerfacecolor": style.PAPER, "zorder": 4}
    handles += axes.plot(1e3 * time[shown], record["voltage"][shown], color=MEASURED, label="measured", **marks)
    axes.set(xlabel="time in ms", ylabel="voltage in V", xlim=(0.0, 1e3 * SHOWN * period))
    style.legend_above(figure, handles)
    return figure


def _repeated(response: Response | None, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Time in ms and voltage of a steady state, for two periods from where the drive rises through zero."""
    assert response is not None and response.waveforms is not None
    waves = response.waveforms
    return 1e3 * np.append(waves.time, waves.time + period), np.tile(waves.voltage, 2)


@style.styled
def _powers(story: Story) -> Any:
    rows = [
        ("first design, simulated", story.designed.harvested_power, SIMULATED, True),
        ("predicted: original model, fitted", story.fitted.harvested_power, SIMULATED, True),
        ("predicted: with the cause", story.extended.harvested_power, EXTENDED, True),
        ("first design, measured", story.first.power, MEASURED, False),
        ("second design, simulated", story.redesigned.harvested_power, EXTENDED, True),
        ("second design, measured", story.second.power, MEASURED, False),
    ]
    figure, axes = style.grid_of_axes(1, height=2.5)
    for place, (_, power, colour, filled) in enumerate(rows):
        fill = {"color": colour} if filled else {"facecolor": "none", "edgecolor": colour, "linewidth": 1.3}
        axes.barh(place, 1e6 * power, height=0.62, **fill)
        axes.text(1e6 * power, place, f" {engineering(power, 'W')}", va="center", fontsize=8.5)
    axes.set_yticks(range(len(rows)), [row[0] for row in rows])
    axes.invert_yaxis()
    axes.margins(x=0.12)
    axes.set_xlabel("power of the load in µW")
    axes.grid(axis="y", visible=False)
    return figure
