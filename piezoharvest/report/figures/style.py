"""Common style of all figures: size, fonts, colours, and file output."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable, Sequence
from functools import wraps
from html import escape
from io import BytesIO
from typing import Any, BinaryIO, TypeVar
from unittest import mock

import numpy as np
from fontTools import subset  # matplotlib writes PDF files by it
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, FuncFormatter, LogFormatterSciNotation, LogLocator, NullFormatter

from piezoharvest.report.frame.axis_scales import axis_scales

_Draw = TypeVar("_Draw", bound=Callable[..., Any])
WIDTH = 6.2  # inches: at 390 px its fonts are still 8 px high, at the page's width 15 px
INK, MUTED, GRID, PAPER = "#1d232b", "#68717d", "#d9dde3", "#fffffe"
LIMIT = "#b3123f"
# Okabe & Ito 2008, "Color Universal Design": distinct with any colour vision; without its yellow and black.
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
DASHES = ("-", (0, (5, 1.6)))
# Colours that follow the light or dark scheme of the page that contains the figure.
THEMED = {
    INK: "currentColor", MUTED: "var(--muted)", GRID: "var(--grid)", PAPER: "var(--paper)", LIMIT: "var(--limit)",
    **{colour: f"var(--series-{n})" for n, colour in enumerate(PALETTE, 1)},
}  # fmt: skip
_DPI = 180
_SUBSET_OPTIONS = subset.Options
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans", "font.size": 9.0, "axes.titlesize": 9.0, "axes.labelsize": 9.0,
    "xtick.labelsize": 8.5, "ytick.labelsize": 8.5, "legend.fontsize": 8.5, "axes.titlelocation": "left",
    "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": MUTED, "xtick.color": MUTED, "ytick.color": MUTED,
    "xtick.labelcolor": INK, "ytick.labelcolor": INK, "axes.linewidth": 0.7, "xtick.major.width": 0.7,
    "ytick.major.width": 0.7, "xtick.minor.width": 0.5, "ytick.minor.width": 0.5, "axes.spines.top": False,
    "axes.spines.right": False, "axes.grid": True, "axes.axisbelow": True, "grid.color": GRID, "grid.linewidth": 0.6,
    "lines.linewidth": 1.5, "legend.frameon": False, "legend.handlelength": 2.4, "axes.unicode_minus": True,
    "axes.facecolor": "none", "svg.fonttype": "path", "svg.hashsalt": "piezoharvest", "path.simplify_threshold": 0.2,
    "axes.formatter.useoffset": False,
    "text.parse_math": False,  # a $ in a file name is a dollar sign
}  # fmt: skip


def styled(draw: _Draw) -> _Draw:
    """Make a function draw in this style, without changing matplotlib's own settings."""

    @wraps(draw)
    def wrapped(*arguments: Any, **options: Any) -> Any:
        with rc_context(_SETTINGS), warnings.catch_warnings():
            # File names may have characters that are not in the font, which are drawn as boxes.
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            return draw(*arguments, **options)

    return wrapped  # pyright: ignore[reportReturnType]


def plain(text: str) -> str:
    """User text as one line: characters that cannot be printed are escaped as in Python."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def line_style(n: int) -> dict[str, Any]:
    """Colour and dashes of the n-th line: every other one is dashed and on top, so that coinciding lines show."""
    dashed = n % 2
    return {"color": PALETTE[n % len(PALETTE)], "linestyle": DASHES[dashed], "zorder": 2.2 + 0.1 * dashed}


def grid_of_axes(rows: int, columns: int = 1, *, height: float, **options: Any) -> tuple[Figure, Any]:
    """Figure of page width with a grid of axes; `height` in inches.

    Returns
    -------
    Figure
    Axes or array of Axes
        One for a single cell, else of shape (rows,), (columns,) or (rows, columns).
    """
    figure = Figure(figsize=(WIDTH, height), layout="constrained", facecolor="none")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, **options)


def legend_above(figure: Figure, handles: Sequence[Any], columns: int = 4) -> None:
    """Legend in a strip above all axes, where it cannot cover data."""
    if handles:
        figure.legend(handles=list(handles), loc="outside upper left", ncols=_columns_that_fit(handles, columns))


def _columns_that_fit(handles: Sequence[Any], most: int) -> int:
    """Columns of a legend as wide as the page at most; it is filled column by column, each as wide as its longest."""
    size = _SETTINGS["legend.fontsize"]
    # Letters of DejaVu Sans are 0.6 of their height wide on average; 5.2 heights are the line and the gaps about it.
    widths = [size * (0.6 * len(str(handle.get_label())) + 5.2) for handle in handles]
    for columns in range(min(most, len(handles)), 1, -1):
        each = np.array_split(widths, columns)  # as matplotlib splits them
        if sum(map(np.max, each)) <= 72 * WIDTH:
            return columns
    return 1


def log_axis(axis: Axis, unit: str = "") -> None:
    """Logarithmic axis with tick labels in engineering form, such as "10 kΩ", and enough of them.

    Call it after drawing the data.
    """
    axis._set_axes_scale("log")  # pyright: ignore[reportAttributeAccessIssue]
    low, high = axis.get_view_interval()
    subs = (1.0,) if high > 60 * low else (1.0, 2.0, 5.0) if high > 3 * low else tuple(range(1, 10))
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(EngFormatter(unit=unit, sep="\u202f"))
    axis.set_minor_formatter(NullFormatter())


class Powers(LogFormatterSciNotation):
    """Tick labels of a logarithmic axis such as 2×10⁻⁹, in plain text."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Label of a tick."""
        text = super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$").replace(r"\times", "×")
        return re.sub(r"\^\{([-\d]+)\}", lambda power: power[1].translate(_RAISED), text)


class Scaled(FuncFormatter):
    """Tick labels in a multiple of the data's unit."""

    def __init__(self, factor: float):
        super().__init__(lambda value, _: f"{value / factor:.10g}")
        self.factor = factor


def power_ticks(axis: Axis) -> None:
    """Label a logarithmic axis by powers of ten, for units without an engineering prefix."""
    axis.set_major_formatter(Powers())
    axis.set_minor_formatter(Powers(labelOnlyBase=False))


def frequency_axis(axes: Axes, logarithmic: bool, label: str = "frequency") -> None:
    """Frequency axis with tick labels in engineering form."""
    if logarithmic:
        log_axis(axes.xaxis, "Hz")
        axes.set_xlabel(label)
        return
    low, high = axes.get_xlim()
    factor, unit = (1e3, "kHz") if high >= 1e4 else (1.0, "Hz")
    axes.xaxis.set_major_formatter(Scaled(factor))
    axes.set_xlim(low, high)
    axes.set_xlabel(f"{label} in {unit}")


def mark(axes: Axes, x: float, y: float, style: dict[str, Any]) -> None:
    """Draw the marker of a tuned point."""
    edge = {"markeredgecolor": PAPER, "markeredgewidth": 1.0, "linestyle": "none"}
    axes.plot([x], [y], marker="o", markersize=6, markerfacecolor=style["color"], zorder=5, **edge)


@styled
def write_png(figure: Figure, stream: BinaryIO) -> None:
    """Write a figure on a white background; its layout stays fixed afterwards."""
    before = {"dpi": figure.dpi, "facecolor": figure.get_facecolor()}
    figure.set(dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure).print_png(stream)  # `savefig` would draw it twice
    figure.set_layout_engine("none")
    figure.set(**before)


def _without_layout(**options: Any) -> Any:
    """Options of a subset of a font without tables that tell how letters are joined, half of the time of a PDF file.

    Matplotlib has placed every letter itself, so that no reader of the file needs them.
    """
    found = _SUBSET_OPTIONS(**options)
    found.drop_tables += ["GSUB", "GPOS", "GDEF"]
    return found


@styled
def write_pdf(figure: Figure, stream: BinaryIO) -> None:
    """Write a figure, whose layout `write_png` has fixed, for papers: on white, text as text."""
    before = figure.get_facecolor()
    figure.set_facecolor("white")
    with rc_context({"pdf.fonttype": 42}), mock.patch.object(subset, "Options", _without_layout):
        FigureCanvasPdf(figure).print_pdf(stream, metadata={"CreationDate": None})  # the same figure, the same file
    figure.set_facecolor(before)


@styled
def inline_svg(figure: Figure, name: str, label: str) -> str:
    """Figure as SVG for an HTML page: transparent, in the page's colours, without external references.

    Parameters
    ----------
    figure : Figure
    name : str
        Unique on the page: prefix of every id.
    label : str
        Description of the figure, for readers who cannot see it.
    """
    stream = BytesIO()
    metadata = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    FigureCanvasSVG(figure).print_svg(stream, metadata=metadata)
    text = stream.getvalue().decode()
    body = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") + 4 :], flags=re.S)
    opening, body = body.split(">", 1)
    box = re.search(r'viewBox="[^"]*"', opening)
    for colour, themed in THEMED.items():
        body = body.replace(colour, themed)
    body = re.sub(r'\bid="', f'id="{name}-', body)
    body = re.sub(r'xlink:href="#', f'href="#{name}-', body).replace("url(#", f"url(#{name}-")
    # A hundredth of a point is finer than any screen, and saves two thirds of the page.
    body = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path.group()), body)
    scales = escape(json.dumps(axis_scales(figure)))
    return f'<svg {box.group() if box else ""} role="img" aria-label="{escape(label)}" data-axes="{scales}">{body}'
