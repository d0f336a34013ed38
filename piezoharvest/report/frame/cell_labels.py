"""Tables that narrow screens show as cards: each cell is told the heading of its column."""

from __future__ import annotations

import re
from html import escape, unescape

_TABLE = re.compile(r"<table\b.*?</table>", re.S)
_HEAD = re.compile(r"<thead>(.*?)</thead>", re.S)
_ROW = re.compile(r"<tr\b.*?</tr>", re.S)
_CELL = re.compile(r"<t[dh]\b([^>]*)>")
_HEADING = re.compile(r"<th\b[^>]*>(.*?)</th>", re.S)
_TAG = re.compile(r"<[^>]*>")
_SPAN = re.compile(r'rowspan="(\d+)"')

LONGEST_WORDS = 40  # characters of a cell that stands at the right of its heading on a card


def with_labels(page: str) -> str:
    """A page of ours, in whose tables each cell of the body has the attribute data-label: its column's heading.

    A style sheet shows it beside the cell where the headings are not in sight, before one of the class `sentence`.
    Cells below one that spans several rows keep their own columns.
    """
    return _TABLE.sub(lambda table: _labelled(table.group()), page)


def _labelled(table: str) -> str:
    """A table with labels; one without a head stays as it is."""
    head = _HEAD.search(table)
    if head is None:
        return table
    headings = [unescape(re.sub(r"<[^>]*>|\u00ad|&shy;", "", text)).strip() for text in _HEADING.findall(head[1])]
    spans = [0] * len(headings)  # rows that a cell above still covers, by column
    body = _ROW.sub(lambda row: _labelled_row(row.group(), headings, spans), table[head.end() :])
    return table[: head.end()] + body


def _labelled_row(row: str, headings: list[str], spans: list[int]) -> str:
    """A row with labels; `spans` is brought to the next row."""
    columns = iter([n for n, rows in enumerate(spans) if rows == 0])
    spans[:] = [max(rows - 1, 0) for rows in spans]

    def label(cell: re.Match[str]) -> str:
        column = next(columns, None)
        if column is None:
            return cell.group()
        if span := _SPAN.search(cell[1]):
            spans[column] = int(span[1]) - 1
        if cell.group().startswith("<th") or not headings[column]:
            return cell.group()  # the name of a row needs no heading
        text = unescape(_TAG.sub("", row[cell.end() : row.index("</td>", cell.end())]))
        sentence = ' class="sentence"' if len(text) > LONGEST_WORDS and "class=" not in cell[1] else ""
        return f'{cell.group()[:-1]}{sentence} data-label="{escape(headings[column])}">'

    return _CELL.sub(label, row)
