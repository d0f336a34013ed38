"""The folder of a report: a page, and the figures that it names."""

from __future__ import annotations

import html
import re
from contextlib import AbstractContextManager
from pathlib import Path

from piezoharvest.whole_folder import whole_folder

NAME = "report.html"
_MARK = '<meta name="generator" content="piezoharvest'  # frame.html.j2
_SUFFIXES = (".png", ".pdf")
_FIGURE = re.compile(r'<span class="file">([^<]+)</span>')  # parts.html.j2


def report_folder(directory: str | Path) -> AbstractContextManager[Path]:
    """Folder to write a page and its figures into, which as a whole replaces an earlier report (see `whole_folder`).

    An earlier report is a page `NAME` that this package has written, with the figures that it names. Anything else in
    the directory stays.

    Raises
    ------
    OutputError
        The directory or a file in it cannot be written.
    """
    return whole_folder(directory, NAME, _own)


def _own(folder: Path) -> set[str]:
    """Names of the files of the report in a folder; none where its page is of somebody else."""
    try:
        page = (folder / NAME).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return set()
    if _MARK not in page:
        return set()
    named = {html.unescape(name) for name in _FIGURE.findall(page)}
    return {
        NAME,
        *(path.name for path in folder.iterdir() if path.suffix in _SUFFIXES and path.name in named and path.is_file()),
    }
