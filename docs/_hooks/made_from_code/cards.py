"""Tables of keys that a narrow window shows as cards: each cell knows the heading of its column."""

from __future__ import annotations

import html
import re

_TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
_HEADING = re.compile(r"<th[^>]*>(.*?)</th>", re.DOTALL)
_BODY_ROW = re.compile(r"<tr>\s*<td.*?</tr>", re.DOTALL)
_LEAST = 3  # columns: two fit beside each other in any window


def with_headings(page: str) -> str:
    """A page whose tables of three columns and more have the attribute data-cards, and their cells data-heading."""
    return _TABLE.sub(lambda table: _labelled(table[0]), page)


def _labelled(table: str) -> str:
    headings = [html.escape(re.sub(r"<.*?>", "", heading), quote=True) for heading in _HEADING.findall(table)]
    if len(headings) < _LEAST:
        return table

    def row(found: re.Match[str]) -> str:
        names = iter(headings)
        return re.sub(r"<td(?=[ >])", lambda _: f'<td data-heading="{next(names, "")}"', found[0])

    return _BODY_ROW.sub(row, table).replace("<table>", "<table data-cards>", 1)
