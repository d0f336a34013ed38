"""The page of a study."""

from __future__ import annotations

import html
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bokeh.layouts import column
from bokeh.models import Button, ColumnDataSource, Div, Select

from piezoharvest.description.parameters import ParameterError
from piezoharvest.explore.study import StudyAnswer, StudyExplorer
from piezoharvest.explore.widgets import Coalesced, beside, page_of, plot, report_table
from piezoharvest.output import OutputError
from piezoharvest.report.units import engineering
from piezoharvest.study import StudyError

if TYPE_CHECKING:
    from bokeh.document import Document

_SIGNALS = {"displacement": "m", "drive": "N", "voltage": "V", "current": "A", "charge": "C"}


class StudyPage:
    """Sliders, figures and curves of a study in one window.

    Parameters
    ----------
    explorer : StudyExplorer
    document : Document
    saved : Path
        Where the button writes the study.
    """

    def __init__(self, explorer: StudyExplorer, document: Document, saved: Path):
        self._explorer, self._saved = explorer, saved
        shunts = explorer.study.shunts
        kinds: list[Any] = [(str(n), f"{n + 1}: {shunt.kind.replace('_', ' ')}") for n, shunt in enumerate(shunts)]
        self._choice = Select(title="circuit", options=kinds, value="0", sizing_mode="stretch_width")
        self._sliders: Any = column(sizing_mode="stretch_width")
        self._figures, self._message = Div(sizing_mode="stretch_width"), Div(sizing_mode="stretch_width")
        self._waves = ColumnDataSource({name: [] for name in ("time", *_SIGNALS)})
        self._update = Coalesced(document, self._show)
        save = Button(label="save study", sizing_mode="stretch_width")
        save.on_click(self._save)
        self._choice.on_change("value", lambda attr, old, new: self._choose())
        controls = [self._choice, self._sliders, save, self._message, self._figures]
        page_of(document, explorer.study.title or "study", beside(controls, self._plots()))
        self._choose()

    def _plots(self) -> list[Any]:
        """Waveforms and loops."""
        drive = "m/s^2" if "base" in self._explorer.study.excitation.kind else "N"
        units = {**_SIGNALS, "drive": drive, "time": "s"}
        pairs = [("time", "displacement"), ("time", "voltage"), ("time", "current"), ("displacement", "drive"),
                 ("displacement", "charge"), ("voltage", "charge")]  # fmt: skip
        return [plot(self._waves, x, y, units) for x, y in pairs]

    def _choose(self) -> None:
        """Show the sliders of the circuit that is chosen."""
        self._knobs = self._explorer.knobs(int(self._choice.value))
        sliders: list[Any] = [knob.slider() for knob in self._knobs]
        for slider in sliders:
            slider.on_change("value", lambda attr, old, new: self._update.request())
        self._sliders.children = sliders
        self._show()

    def _values(self) -> dict[str, float]:
        """Values of the sliders that were moved: the others keep theirs to the last digit."""
        pairs = list(zip(self._knobs, self._sliders.children, strict=True))
        return {
            knob.path: knob.from_slider(slider.value)
            for knob, slider in pairs if slider.value != knob.to_slider(knob.value)
        }  # fmt: skip

    def _show(self) -> None:
        """Compute and draw; where the values are not allowed, what was drawn stays."""
        try:
            answer = self._explorer.answer(int(self._choice.value), self._values())
        except ParameterError as error:
            self._say(str(error))
            return
        self._say(answer.response.message)
        self._figures.text = _figures(answer)
        waves = answer.response.waveforms
        if waves is not None:
            self._waves.data = {name: getattr(waves, name) for name in ("time", *_SIGNALS)}

    def _save(self) -> None:
        try:
            self._explorer.save(int(self._choice.value), self._values(), self._saved)
        except (ParameterError, StudyError, OutputError) as error:
            self._say(str(error))
        else:
            self._say(f"saved: {self._saved}")

    def _say(self, text: str) -> None:
        self._message.text = f'<p role="status">{html.escape(text)}</p>' if text else ""


def _figures(answer: StudyAnswer) -> str:
    """Table of the figures, with the bound."""
    found, bound = answer.response, answer.bound
    rows = {
        "harvested power": engineering(found.harvested_power, "W"),
        "attenuation": engineering(found.attenuation_db, "dB"),
        "displacement amplitude": engineering(found.displacement_amplitude, "m"),
        "voltage amplitude": engineering(found.voltage_amplitude, "V"),
        "dc voltage": engineering(found.dc_voltage, "V"),
        "efficiency": engineering(100 * found.efficiency, "%"),
    }
    if bound is not None:
        rows |= {
            "bound for passive linear circuits": engineering(bound.harvested_power, "W"),
            "bound for any circuit": engineering(bound.any_interface, "W"),
        }
        if bound.attenuation_db is not None:
            rows["bound for attenuation, linear"] = engineering(bound.attenuation_db, "dB")
        if bound.harvested_power:
            rows["share of the linear bound"] = engineering(100 * found.harvested_power / bound.harvested_power, "%")
    if not found.converged:
        rows["not converged"] = "these results are not to be trusted"
    return report_table(rows)
