"""What the pages have in common: curves, tables, the arrangement, and updates that do not pile up."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bokeh.layouts import column, row
from bokeh.models import CustomJSHover, CustomJSTickFormatter, Div, HoverTool
from bokeh.plotting import figure

from piezoharvest.explore.knobs import DIGITS
from piezoharvest.report.units import pretty_unit, takes_prefix

if TYPE_CHECKING:
    from bokeh.document import Document
    from bokeh.models import ColumnDataSource, UIElement

_COLOUR, _SECOND = "#1f5fa8", "#c4541a"
_HEIGHT = 230  # pixels of a plot
_TICKS = 5  # about, of an axis
# A number with its unit, which has an SI prefix if it takes one.
_SHOWN = """
const shown = value => {
  const power = prefixed && value ? Math.max(-5, Math.min(4, Math.floor(Math.log10(Math.abs(value)) / 3 + 1e-9))) : 0;
  const prefix = ["f", "p", "n", "µ", "m", "", "k", "M", "G", "T"][power + 5];
  return `${Number((value / 10 ** (3 * power)).toPrecision(digits))} ${prefix}${unit}`.trim();
};
"""
# A telephone shows the page at its own width.
_HEAD = """{% block preamble %}<meta name="viewport" content="width=device-width, initial-scale=1">
<style>body { font-family: sans-serif; margin: 8px; } h1 { font-size: 1.1em; }</style>{% endblock %}"""
# Columns stand side by side where the window is wide enough for two, and below each other on a telephone.
_WRAPS = ":host { display: flex; flex-flow: row wrap; gap: 12px; }"


class Coalesced:
    """Runs a function once after any number of requests, when the messages that have arrived are all read."""

    def __init__(self, document: Document, run: Callable[[], None]):
        self._document, self._run, self._waiting = document, run, False

    def request(self) -> None:
        """Ask for a run."""
        if not self._waiting:
            self._waiting = True
            self._document.add_next_tick_callback(self._now)

    def _now(self) -> None:
        self._waiting = False
        self._run()


def plot(
    source: ColumnDataSource, x: str, y: str, units: Mapping[str, str], *, of: str | None = None, **options: Any
) -> figure:
    """Curve of one column over another, and of a second one where it is given; the pointer reads its values."""
    drawn: Any = figure(
        height=_HEIGHT, sizing_mode="stretch_width", tools="pan,box_zoom,reset,save", toolbar_location="above",
        min_border_right=24,  # half of a label at the end of the axis
        **options,
    )  # fmt: skip
    for axis in (drawn.xaxis, drawn.yaxis):
        axis.ticker.desired_num_ticks = _TICKS
        axis.formatter = number_formatter("")
    names = {"legend_label": y} if of else {}
    curve = drawn.line(x, y, source=source, color=_COLOUR, line_width=1.5, **names)
    if of:
        drawn.line(x, of, source=source, color=_SECOND, line_width=1.5, legend_label=of)
        drawn.legend.update(orientation="horizontal", padding=2, border_line_color=None)
        drawn.add_layout(drawn.legend[0], "above")
    drawn.toolbar.logo = None
    shown = [name for name in (x, y, of) if name]
    tips: list[Any] = [(name, f"@{name}{{custom}}") for name in shown]
    code = f"{_SHOWN}return shown(value);"
    read: Any = {f"@{name}": CustomJSHover(code=code, tags=["x" if name == x else "y"]) for name in shown}
    mode: Any = "vline" if x in ("time", "x") else "mouse"
    drawn.add_tools(HoverTool(tooltips=tips, formatters=read, renderers=[curve], mode=mode))
    for axis, name in (("x", x), ("y", y)):
        name_axis(drawn, axis, name, units[name])
    return drawn


def name_axis(drawn: Any, which: str, name: str, unit: str) -> None:
    """Name the "x" or "y" axis of a plot, and give its ticks and what the pointer reads there the SI unit."""
    axis, args = getattr(drawn, f"{which}axis")[0], _unit_args(unit)
    axis.axis_label, axis.formatter.args = name, args
    for hover in drawn.select(type=HoverTool):
        for reader in hover.formatters.values():
            if reader.tags == [which]:
                reader.args = args


def number_formatter(unit: str, *, logarithm: bool = False) -> CustomJSTickFormatter:
    """Formatter of numbers with an SI unit, or of logarithms as the numbers that they stand for."""
    code = f"{_SHOWN}return shown({'10 ** tick' if logarithm else 'tick'});"
    return CustomJSTickFormatter(code=code, args=_unit_args(unit))


def _unit_args(unit: str) -> dict[str, Any]:
    return {"unit": pretty_unit(unit), "prefixed": takes_prefix(unit), "digits": DIGITS}


def report_table(rows: Mapping[str, str]) -> str:
    """Table of two columns, as HTML."""
    cells = (f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in rows.items())
    style = "<style>th { text-align: left; font-weight: normal; padding-right: 1em } td { font-weight: bold }</style>"
    return f"{style}<table>{''.join(cells)}</table>"


def beside(controls: Sequence[UIElement], plots: Sequence[UIElement]) -> UIElement:
    """Controls, and the plots two abreast where there is room."""
    left = column(*controls, sizing_mode="stretch_width", styles={"flex": "1 1 300px", "max-width": "420px"})
    cells = [column(one, sizing_mode="stretch_width", styles={"flex": "1 1 320px", "min-width": "0"}) for one in plots]
    right = row(*cells, sizing_mode="stretch_width", stylesheets=[_WRAPS], styles={"flex": "3 1 340px"})
    return row(left, right, sizing_mode="stretch_width", stylesheets=[_WRAPS])


def page_of(document: Document, title: str, content: UIElement) -> None:
    """Put the content into the window's document."""
    document.template = _HEAD  # pyright: ignore[reportAttributeAccessIssue]
    document.title = f"piezoharvest: {title}"
    heading = Div(text=f"<h1 style='margin: 0; font-size: 1.25rem'>{html.escape(title)}</h1>")
    document.add_root(column(heading, content, sizing_mode="stretch_width"))
