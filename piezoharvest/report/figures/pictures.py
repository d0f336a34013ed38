"""Figures of a page: each as a PNG and a PDF file beside it, and as inline SVG."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup
from matplotlib.figure import Figure

from piezoharvest.output import result_file
from piezoharvest.report.figures import style


class Picture(NamedTuple):
    """A figure with its file name, section of the page, heading and caption."""

    name: str
    section: str
    heading: str
    caption: str
    figure: Figure


def place_pictures(
    pictures: Iterable[Picture], sections: Sequence[str], directory: Path
) -> dict[str, list[dict[str, Any]]]:
    """Write figures into a directory, and return the data that a template needs.

    Parameters
    ----------
    pictures : iterable of Picture
    sections : sequence of str
        Sections of the page in their order, by which figures are numbered.
    directory : Path

    Returns
    -------
    dict
        For each section its figures, with name, heading, caption, files, svg and number.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    figures: dict[str, list[dict[str, Any]]] = {section: [] for section in sections}
    for picture in pictures:
        files = [f"{picture.name}.{ending}" for ending in ("png", "pdf")]
        for file, write in zip(files, (style.write_png, style.write_pdf), strict=True):
            with result_file(directory / file) as stream:
                write(picture.figure, stream)
        svg = Markup(style.inline_svg(picture.figure, picture.name, picture.heading))
        words = {"heading": picture.heading, "caption": picture.caption, "files": files, "name": picture.name}
        figures[picture.section].append({**words, "svg": svg})
    numbers = count(1)
    for section in figures.values():
        for figure in section:
            figure["number"] = next(numbers)
    return figures
