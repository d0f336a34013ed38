"""Parser of a table of numbers in blocks of lines: a regular block at once, any other line by line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.readers.base import ReadError, cut
from piezoharvest.readers.text_files.layout import COMMENT, TextLayout

_END = "END"  # ends a block in files of impedance analysers


class Table:
    """Selected columns of a table that is read block by block.

    Blank lines, comments and repeated headers are skipped. Text below the table ends it. Text
    among its rows is an error.

    Parameters
    ----------
    layout : TextLayout
    where : mapping of str to int
        Positions of the selected columns.

    Attributes
    ----------
    count : int
        Rows so far.
    last_row, seen : int
        Line of the file with the last of these rows, and the last line that was read.
    ended : bool
        True if another table has begun.
    left_out : tuple of (row, text) or None
        The first line below the table with numbers.
    """

    def __init__(self, layout: TextLayout, where: Mapping[str, int]):
        self.layout, self.where = layout, dict(where)
        self.count, self.last_row, self.seen, self.ended = 0, 0, 0, False
        self.left_out: tuple[int, str] | None = None
        self._columns = {name: np.empty(0) for name in where}
        self._pieces: list[tuple[int, int]] = []  # index and row at which the numbering restarts
        self._lines: list[tuple[int, list[float]]] = []  # rows read line by line
        self._text: tuple[int, list[str]] | None = None  # the first line of text below the last row
        self._titled = False  # True if names of columns followed that text
        self._empty: list[int] = []  # rows below the last one with delimiters only

    def add(self, block: bytes, row: int) -> None:
        """Read whole lines, the first of which is line `row` of the file.

        Raises
        ------
        ReadError
            A line is not a row of the table.
        """
        self.seen = row + block.count(b"\n") - 1
        found = self._at_once(block) if self._text is None and not self._empty else None
        if found is not None:
            self._append(found, row, len(found[0]))
            return
        for n, line in enumerate(block.split(b"\n")[:-1], row):
            self._take(decoded(line), n)
            if self.ended:
                break
        self._flush()

    @property
    def below(self) -> bool:
        """True if there is text below the last row."""
        return self._text is not None

    def finish(self) -> dict[str, np.ndarray]:
        """The columns, after all lines have been read."""
        for column in self._columns.values():
            column.resize(self.count, refcheck=False)
        return self._columns

    def numbering(self) -> int | np.ndarray:
        """Row of the first sample, or the rows of all samples if they are not consecutive."""
        if len(self._pieces) == 1:
            return self._pieces[0][1]
        starts = [index for index, _ in self._pieces]
        offsets = [row - index for index, row in self._pieces]
        return np.arange(self.count) + np.repeat(offsets, np.diff([*starts, self.count]))

    def _at_once(self, block: bytes) -> list[np.ndarray] | None:
        """Selected columns of a block; None if a line is not a row of the table, or does not begin with a number."""
        import pyarrow
        from pyarrow import csv

        dialect, lead = self.layout.dialect, self.layout.numeric[0]
        lines = block.count(b"\n")
        if dialect.delimiter is None:
            block = b"".join(b" ".join(line.split()) + b"\n" for line in block.split(b"\n")[:-1])
        if block.startswith(b"\n") or b"\n\n" in block:
            return None
        labels = [str(n) for n in range(self.layout.width)]
        types = {labels[n]: pyarrow.float64() for n in {lead, *self.where.values()}}
        try:
            table = csv.read_csv(
                pyarrow.BufferReader(block),
                # Threads would save almost no time.
                csv.ReadOptions(column_names=labels, block_size=max(len(block), 2), use_threads=False),
                csv.ParseOptions(delimiter=dialect.delimiter or " "),
                csv.ConvertOptions(
                    include_columns=list(types), column_types=types, decimal_point=dialect.decimal, check_utf8=False
                ),
            )
        except pyarrow.ArrowInvalid:  # which says neither row nor column
            return None
        if table.num_rows != lines or table.column(labels[lead]).null_count:
            return None
        return [table.column(labels[n]).to_numpy() for n in self.where.values()]

    def _append(self, columns: Sequence[np.ndarray], row: int, count: int) -> None:
        """Append rows that are consecutive in the file."""
        total = self.count + count
        for column, values in zip(self._columns.values(), columns, strict=True):
            if len(column) < total:
                column.resize(max(len(column) * 5 // 4, total), refcheck=False)  # in place
            column[self.count : total] = values
        if not self._pieces or row != self.last_row + 1:
            self._pieces.append((self.count, row))
        self.count, self.last_row = total, row + count - 1

    def _flush(self) -> None:
        """Append the rows that were read line by line."""
        rows = np.array([row for row, _ in self._lines], int)
        values = np.array([values for _, values in self._lines], float).reshape(len(rows), len(self.where))
        self._lines = []
        for piece in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) != 1) + 1):
            if len(piece):
                self._append(list(values[piece].T), int(rows[piece[0]]), len(piece))

    def _take(self, line: str, row: int) -> None:
        """Read one line of any kind."""
        bare = line.strip()
        if not bare or bare.startswith(COMMENT) or bare == _END:
            return
        if bare in self.layout.header:
            self._titled = self._text is not None
            return
        cells = self._cells(line)
        if not any(cells):
            self._empty.append(row)
            return
        dialect, whole = self.layout.dialect, len(cells) == self.layout.width
        values = [dialect.number(cells[n]) for n in self.where.values()] if whole else []
        # Below text, a row with an empty first cell holds statistics.
        begun = self._leads(cells) and (self._text is None or cells[self.layout.numeric[0]] != "") if whole else False
        if not begun or None in values:
            self._no_row(cells, values, row)
            return
        if self._text is not None:
            self._go_on(row, line)
            return
        nothing = [float("nan")] * len(values)  # rows of delimiters alone are missing if others follow
        self._lines += [(empty, nothing) for empty in self._empty] + [(row, [v for v in values if v is not None])]
        self._empty = []

    def _cells(self, line: str) -> list[str]:
        """Cells of a line, without empty cells, or comments if the header has a column for them, beyond the table."""
        cells = self.layout.dialect.split(line)
        while len(cells) > self.layout.width and (not cells[-1] or self.layout.remarks):
            cells.pop()
        return cells

    def _leads(self, cells: Sequence[str]) -> bool:
        """True if a line of the table's width begins with a number; text there is a title or names a statistic."""
        lead = cells[self.layout.numeric[0]]
        return self.layout.dialect.is_number(lead)

    def _no_row(self, cells: Sequence[str], values: Sequence[float | None], row: int) -> None:
        """Record a line that ends the table, or raise an error if it is a damaged row."""
        dialect, layout = self.layout.dialect, self.layout
        if self._text is None:
            if values and self._leads(cells):
                name, n = next(
                    (name, n) for (name, n), value in zip(self.where.items(), values, strict=True) if value is None
                )
                raise ReadError(f"found {cut(cells[n])!r}, must be a number", name, row)
            if len(cells) != layout.width and (dialect.is_cut(cells) or dialect.number(cells[0] or "x") is not None):
                raise ReadError(f"found {counted(len(cells), 'column')}, but {layout.width} in the rows above", row=row)
            self._text = row, list(cells)
        numbers = any(cell and dialect.is_number(cell) for cell in cells)
        self._titled |= len(cells) > 1 and not numbers
        if numbers:
            self.left_out = self.left_out or (row, cut(" ".join(cells)))
            self.ended |= self._titled and dialect.is_cut(cells)  # the rows of a table of another width

    def _go_on(self, row: int, line: str) -> None:
        """Record the beginning of another table, or raise an error for text among the rows."""
        assert self._text is not None
        if self._titled:
            self.left_out, self.ended = self.left_out or (row, cut(line.strip())), True
            return
        first, cells = self._text
        lead = self.layout.numeric[0]
        text, name = " ".join(cells), ""
        if len(cells) == self.layout.width:
            text, name = cells[lead], next((name for name, n in self.where.items() if n == lead), "")
        raise ReadError(f"found {cut(text)!r} among the rows of the table, must be a number", name, first)


def decoded(line: bytes) -> str:
    """A line as text, in UTF-8 or else Latin 1; numbers are the same in both."""
    try:
        return line.decode()
    except UnicodeDecodeError:
        return line.decode("latin-1")
