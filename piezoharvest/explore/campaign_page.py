"""The page of a campaign."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, Div, MultiChoice, Select

from piezoharvest.description.parameters import ParameterError
from piezoharvest.explore.campaign import CampaignExplorer, Seen, telling, with_values
from piezoharvest.explore.knobs import Knob
from piezoharvest.explore.widgets import Coalesced, beside, name_axis, page_of, plot, report_table
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.reading.channels import UNITS
from piezoharvest.report.units import engineering

if TYPE_CHECKING:
    from bokeh.document import Document

_PARTS = 500  # of a plot, each with its extrema
_MOST_EFFECTS = 4  # at once: more make no sense to the eye


class CampaignPage:
    """A record beside the model, and effects that are switched on, in one window.

    Parameters
    ----------
    explorer : CampaignExplorer
    document : Document
    """

    def __init__(self, explorer: CampaignExplorer, document: Document):
        self._explorer = explorer
        self._knobs: dict[str, list[Knob]] = {}
        names: list[Any] = [(str(n), f"{record.name} ({record.role})") for n, record in enumerate(explorer.records)]
        self._record = Select(title="record", options=names, value="0", sizing_mode="stretch_width")
        self._channel = Select(title="channel", sizing_mode="stretch_width")
        self._effects = MultiChoice(
            title="effects switched on", options=[(label, label.replace("_", " ")) for label in explorer.effects],
            value=list(explorer.identified), max_items=_MOST_EFFECTS, sizing_mode="stretch_width", name="effects",
            placeholder="none: choose effects",
        )  # fmt: skip
        self._sliders: Any = column(sizing_mode="stretch_width")
        self._figures, self._message = Div(sizing_mode="stretch_width"), Div(sizing_mode="stretch_width")
        self._curves = ColumnDataSource({"x": [], "measured": [], "predicted": [], "residual": []})
        self._update = Coalesced(document, self._show)
        self._record.on_change("value", lambda attr, old, new: self._choose())
        self._effects.on_change("value", lambda attr, old, new: self._choose(keep=True))
        self._channel.on_change("value", lambda attr, old, new: self._update.request())
        controls = [self._record, self._channel, self._effects, self._sliders, self._message, self._figures]
        page_of(document, explorer.found.campaign.title, beside(controls, self._plots()))
        self._choose()

    def _plots(self) -> list[Any]:
        """Measured and predicted values, and what is left."""
        units = {"x": "", "measured": "", "residual": ""}
        both = plot(self._curves, "x", "measured", units, of="predicted")
        self._drawn = [both, plot(self._curves, "x", "residual", units, x_range=both.x_range)]
        return self._drawn

    def _name_axes(self, channel: str, shown: Seen) -> None:
        """What the axes show: of a frequency response dB."""
        for drawn, name in zip(self._drawn, (channel, "residual"), strict=True):
            name_axis(drawn, "x", *(("time", "s") if shown.rms else ("frequency", "Hz")))
            name_axis(drawn, "y", name, UNITS[channel] if shown.rms else "dB")

    def _choose(self, keep: bool = False) -> None:
        """Sliders of the effects that are on; those of the same record keep their values."""
        number, chosen = int(self._record.value), list(self._effects.value)[:_MOST_EFFECTS]
        kept = {slider.name: slider for slider in self._sliders.children} if keep else {}
        self._knobs = {label: self._explorer.knobs(label, number) for label in chosen}
        sliders = []
        for knob in (knob for knobs in self._knobs.values() for knob in knobs):
            slider = kept.get(knob.path)
            if slider is None:
                slider = knob.slider(title=knob.path.replace(".", ": ").replace("_", " "))
                slider.on_change("value", lambda attr, old, new: self._update.request())
            sliders.append(slider)
        self._sliders.children = sliders
        self._show()

    def _show(self) -> None:
        """Predict and draw; where the model cannot follow, what was drawn stays."""
        knobs = {knob.path: knob for knobs in self._knobs.values() for knob in knobs}
        values = {slider.name: knobs[slider.name].from_slider(slider.value) for slider in self._sliders.children}
        effects = self._explorer.effects
        try:
            on = [with_values(effects[label], label, values) for label, own in self._knobs.items() if own]
            shown = self._explorer.seen(int(self._record.value), on)
        except (ParameterError, PredictionError, ArithmeticError, np.linalg.LinAlgError) as error:
            self._say(str(error))
            return
        silent = [label for label, own in self._knobs.items() if not own]
        self._say(f"this record does not show: {', '.join(silent)}" if silent else "")
        channels: list[Any] = list(shown.measured)
        if self._channel.options != channels:
            self._channel.options, self._channel.value = channels, channels[0]
        channel = self._channel.value
        self._name_axes(channel, shown)
        at = telling(shown, channel, _PARTS)
        parts = {name: getattr(shown, name)[channel][at] for name in ("measured", "predicted", "residual")}
        self._curves.data = {"x": shown.x[at], **parts}
        self._figures.text = report_table({
            f"{name}: residual, noise": " and ".join(
                engineering(value, UNITS[name]) for value in (shown.rms[name], shown.noise.get(name, np.nan))
            ) for name in shown.rms
        })  # fmt: skip

    def _say(self, text: str) -> None:
        self._message.text = f'<p role="status">{html.escape(text)}</p>' if text else ""
