"""Tables of numbers in text: CSV with comma, semicolon or tab, decimal point or comma; columns apart by blanks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from piezoharvest.readers.base import Reader, ReadError, numbers

_COMMENT = ("#", "%")
_BLOCK = 1 << 22  # bytes read at a time
_HEAD = 200  # lines that tell how the file is laid out
_MISSING = {"", "n/a", "na", "#n/a", "null", "-nan", "1.#ind", "-1.#ind", "1.#qnan", "-1.#qnan"}
_ALLOWED = "allowed is a table of numbers with at most one line of names above it"


@dataclass(frozen=True)
class Layout:
    """How a text file is laid out: names of the columns, what parts them, decimal mark, lines above the numbers."""

    names: tuple[str, ...]
    delimiter: str | None
    decimal: str
    lines_above: int

    def split(self, line: str) -> list[str]:
        """Cells of a line."""
        return [cell.strip() for cell in line.strip("\r\n").split(self.delimiter)]

    def is_row(self, line: str) -> bool:
        """Whether a line is one of the table: at least half of its cells are numbers (others may be remarks, dates)."""
        cells = self.split(line)
        return 2 * sum(self.is_number(cell) for cell in cells if cell) >= len([cell for cell in cells if cell]) > 0

    def is_number(self, cell: str) -> bool:
        """Whether a cell is a number, or says that there is none."""
        if cell.lower() in _MISSING:
            return True
        try:
            float(cell.replace(self.decimal, "."))
        except ValueError:
            return False
        return "_" not in cell  # which Python takes for a mark of thousands


class Text(Reader):
    """Text file with a header, or without one: its columns are then named "1", "2", ..."""

    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".txt", ".dat", ".tsv")

    def __init__(self, path: Path):
        super().__init__(path)
        self.layout = _layout(path)
        self.names = self.layout.names
        self.first_row = self.layout.lines_above + 1

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        where = {name: self._position(name) for name in names}
        try:
            columns = (self._by_blanks if self.layout.delimiter is None else self._by_delimiter)(list(where.values()))
        except ValueError as error:  # of numpy, and of pyarrow: neither says in which row
            self._blame(where)
            raise ReadError(f"found no table of numbers ({error}), {_ALLOWED}") from None
        if not len(columns[0]):
            raise ReadError(f"found no samples, {_ALLOWED}")
        return dict(zip(where, columns, strict=True))

    def _position(self, name: str) -> int:
        if self.names.count(name) > 1:
            raise ReadError("found several columns of this name, allowed is one (or its number)", name)
        return self.names.index(name)

    def _by_delimiter(self, positions: list[int]) -> list[np.ndarray]:
        """Read block by block, so that never more than the columns themselves and one block are in memory."""
        import pyarrow
        from pyarrow import csv

        labels = [str(n) for n in range(len(self.names))]
        wanted = {labels[n]: pyarrow.float64() for n in positions}
        stream = csv.open_csv(
            self.path,
            # Without threads, which would have many blocks in memory and gain next to nothing.
            csv.ReadOptions(
                column_names=labels, skip_rows=self.layout.lines_above, block_size=_BLOCK, use_threads=False
            ),
            csv.ParseOptions(delimiter=self.layout.delimiter),
            csv.ConvertOptions(
                include_columns=list(wanted), column_types=wanted, decimal_point=self.layout.decimal, check_utf8=False
            ),
        )
        columns = {label: np.empty(0) for label in wanted}
        count = 0
        for batch in stream:
            for label, column in columns.items():
                if len(column) < count + len(batch):
                    column.resize(max(len(column) * 5 // 4, count + len(batch)), refcheck=False)  # in place
                column[count : count + len(batch)] = batch.column(label).to_numpy(zero_copy_only=False)
            count += len(batch)
        for column in columns.values():
            column.resize(count, refcheck=False)
        return [columns[labels[n]] for n in positions]

    def _by_blanks(self, positions: list[int]) -> list[np.ndarray]:
        above = self.layout.lines_above
        table = np.loadtxt(self.path, comments=_COMMENT, skiprows=above, usecols=positions, ndmin=2, encoding="latin-1")
        return [numbers(column, "") for column in table.T]

    def _blame(self, where: dict[str, int]) -> None:
        """Raise the error of the first row that is not one of the table."""
        for row, line in _lines(self.path):
            if row < self.first_row or not line.strip():
                continue
            cells = self.layout.split(line)
            if len(cells) != len(self.names):
                raise ReadError(f"found {len(cells)} columns, allowed are {len(self.names)} as above", row=row)
            for name, n in where.items():
                if not self.layout.is_number(cells[n]):
                    raise ReadError(f"found {cells[n][:40]!r}, allowed is a number", name, row)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines with their numbers from 1. Numbers look the same in any encoding; names are in UTF-8, or else Latin 1."""
    with path.open("rb") as stream:
        for row, line in enumerate(stream, 1):
            try:
                text = line.decode("utf-8-sig" if row == 1 else "utf-8")
            except UnicodeDecodeError:
                text = line.decode("latin-1")
            yield row, text


def _layout(path: Path) -> Layout:
    """Find out how a file is laid out from its first lines.

    Raises
    ------
    ReadError
        It is not text, or has no line of numbers.
    """
    head, comment, header = list(islice(_lines(path), _HEAD)), "", ""
    for row, line in head:
        if "\0" in line:
            raise ReadError("found binary data (or UTF-16), allowed is text in UTF-8 or Latin 1", row=row)
        if not line.strip() or line.lstrip().startswith(_COMMENT):
            comment = line.strip().lstrip("#% ") or comment
            continue
        guess = _guess(line, [later for _, later in head[row - 1 :]])
        if guess.is_row(line):
            return _named(guess, guess.split(line), header or comment, bool(header), row - 1)
        if header:
            raise ReadError(f"found no row of numbers below {header.strip()[:60]!r}, {_ALLOWED}", row=row)
        header = line
    raise ReadError(f"found no samples, {_ALLOWED}")


def _guess(line: str, table: Sequence[str]) -> Layout:
    """Delimiter by what the line holds; where that is a semicolon or tab, a comma in the table is a decimal mark."""
    delimiter: Any = next((mark for mark in (";", "\t", ",") if mark in line), None)
    comma = delimiter in (";", "\t") and any("," in row for row in table)
    return Layout((), delimiter, "," if comma else ".", 0)


def _named(guess: Layout, cells: list[str], header: str, required: bool, above: int) -> Layout:
    """Layout with names: those of the header, or numbers where there is none (a comment need not be a header)."""
    names = [name.strip().strip('"') for name in header.strip("\r\n").split(guess.delimiter)]
    surplus = len(cells) - len(names)
    if required and surplus > 0 and not any(cells[len(names) :]):  # a delimiter ends every row of numbers
        names += [""] * surplus
    if len(names) != len(cells) or not any(names):
        if required:
            raise ReadError(f"found {len(cells)} columns, allowed are {len(names)} as in the header", row=above + 1)
        names = [str(n) for n in range(1, len(cells) + 1)]
    return Layout(tuple(names), guess.delimiter, guess.decimal, above)
