"""Tables of numbers in text: CSV with comma, semicolon or tab, decimal point or comma; or delimited by blanks."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import ClassVar

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.readers.base import (
    MAX_NUMBERS,
    MissingColumnError,
    Reader,
    ReadError,
    check_count,
    cut,
    ends_within_a_line,
    fewer_than_promised,
)
from piezoharvest.readers.text_files.layout import ADVICE, MAX_HEADER_LINES, find_layout
from piezoharvest.readers.text_files.table import Table, decoded
from piezoharvest.readers.units import Unit, stated_unit, unit_of

_BLOCK = 1 << 22  # bytes read at a time
_HEAD = 1 << 18  # bytes, and lines, from which the layout is determined
_HEAD_LINES = 1000
# A line of a preamble with the number of samples, as Tektronix ("Record Length,2000"), Keysight ("Points:,2000").
_PROMISE = re.compile(
    r"""[#%!"\s]*(?:record length|(?:(?:number|no\.?) of )?(?:points|samples))["\s]*[:=,;\t ]["\s]*(\d+)\D*""",
    re.IGNORECASE,
)


class Text(Reader):
    """Text file with a table of numbers; columns are named by the line above it, or else "1", "2", ...

    Parameters
    ----------
    path : Path
    skip_rows : int
        Number of lines to skip at the beginning.
    header_row : int, optional
        Line, from 1, with the names; the table is the first one below it.

    Attributes
    ----------
    head : list of str
        The first lines; of those that are skipped only the last `lines_above` are kept, the others are empty.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".txt", ".dat", ".tsv")
    lines_above: ClassVar[int] = MAX_HEADER_LINES
    by_lines = True
    most_bytes = 32 * MAX_NUMBERS  # a number with 17 digits has up to 25 characters

    def __init__(self, path: Path, skip_rows: int = 0, header_row: int | None = None):
        super().__init__(path)
        self._encoding = _encoding(path)
        begin = max(skip_rows, header_row or 0)
        self.head = self.prepared(_head(self.blocks(), begin, self.lines_above))
        if len(self.head) < begin:
            key = "skip_rows" if begin == skip_rows else "header_row"
            raise ReadError(f"{key} is {begin}, but the file has only {counted(len(self.head), 'line')}")
        self.layout = find_layout(self.head, skip_rows, header_row)
        self.names = self.layout.names
        self._positions = {self._key(n): n for n in range(self.layout.width)}
        self.first_row = self.layout.above + 1

    def blocks(self) -> Iterator[bytes]:
        """Whole lines of the file, some megabytes at a time."""
        return _blocks(self.path, self._encoding)

    def prepared(self, head: list[str]) -> list[str]:
        """The first lines as the layout is found in them; those of some instruments hold more than columns."""
        return head

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        table = self._table(names, self.first_row)
        if not table.count:
            raise ReadError(f"found no samples, but a table of numbers is needed; {ADVICE}")
        self.numbering, self.left_out = table.numbering(), table.left_out
        self.cut_off = fewer_than_promised(table.count, self._promised(), "samples")
        if not self.cut_off and self._encoding is None:
            self.cut_off = ends_within_a_line(self.path)
        return table.finish()

    def read_rows(self, names: Sequence[str], rows: tuple[int, int]) -> dict[str, np.ndarray]:
        first, last = rows
        if first >= self.first_row:
            table = self._table(names, first, last)
            if table.last_row == last or (table.count and table.seen >= last and not table.below):
                self.numbering = table.numbering()
                return table.finish()
        end = self._table(names[:1], self.first_row).last_row
        raise ReadError(f"found {list(rows)}, allowed are rows from {self.first_row} to {end}", "rows")

    def _promised(self) -> int | None:
        """Number of samples that the preamble states; None if it states none."""
        found = (_PROMISE.fullmatch(line.strip()) for line in self.head[: self.layout.above])
        return next((int(match[1]) for match in found if match), None)

    def unit(self, name: str) -> Unit | None:
        of_row = self.layout.units[self._positions[name]]
        return unit_of(of_row) if of_row else stated_unit(name)[1]

    def resolve(self, column: str | int) -> str:
        try:
            found = super().resolve(column)
            return self._key(column - 1) if isinstance(column, int) else found
        except MissingColumnError as error:
            if self.layout.above < 2 and self.layout.named:
                raise
            where = f" in the table that begins in line {self.first_row}; {ADVICE}"
            raise MissingColumnError(error.message + where, error.column) from None

    def _table(self, names: Sequence[str], first: int, last: int | None = None) -> Table:
        """Columns of the rows from `first` to `last`, read block by block to limit memory."""
        table = Table(self.layout, {name: self._positions[name] for name in names})
        row = 1
        for block in self.blocks():
            lines = block.count(b"\n")
            if row + lines > first:
                table.add(_lines_of(block, first - row, None if last is None else last + 1 - row), max(row, first))
            row += lines
            check_count(table.count * len(names))
            if table.ended or (last is not None and row > last):
                break
        return table

    def _column(self, position: int) -> np.ndarray:
        """One whole column, whatever was read last."""
        key = self._key(position)
        return self._table([key], self.first_row).finish()[key]

    def _key(self, position: int) -> str:
        """Unique name of a column: its name, with its number if there are several of that name."""
        name = self.names[position]
        return name if self.names.count(name) == 1 else f"{name} ({position + 1})".strip()


def half_a_digit(number: str) -> float:
    """Half a unit of the last digit that is printed: the error of a rounded number; 0 of what is none."""
    try:
        exponent = Decimal(number.strip().replace(",", ".")).as_tuple().exponent
    except InvalidOperation:
        return 0.0
    return 0.5 * 10.0**exponent if isinstance(exponent, int) else 0.0


def _encoding(path: Path) -> str | None:
    """Encoding of a file that has to be decoded: UTF-16, which some instruments write. None for UTF-8 and Latin 1.

    Raises
    ------
    ReadError
        The file is not text.
    """
    with path.open("rb") as stream:
        start = stream.read(1 << 12)
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    # In UTF-16, every other byte is 0 for most letters.
    pairs = max(len(start) // 2, 1)
    for encoding, zeros, others in (("utf-16-le", start[1::2], start[::2]), ("utf-16-be", start[::2], start[1::2])):
        if zeros.count(0) > 0.9 * pairs and others.count(0) == 0:
            return encoding
    if 0 in start:
        row = start[: start.index(0)].count(b"\n") + 1
        raise ReadError("found binary data, but a text file is needed (UTF-8, UTF-16 or Latin 1)", row=row)
    return None


def _blocks(path: Path, encoding: str | None) -> Iterator[bytes]:
    """Whole lines of a file, some megabytes at a time, decoded to UTF-8 if needed, all ending in a line feed."""
    decoder = codecs.getincrementaldecoder(encoding or "latin-1")("replace") if encoding else None
    rest, first = b"", True
    with path.open("rb") as stream:
        while True:
            data = stream.read(_BLOCK)
            final = not data
            if decoder is not None:
                data = decoder.decode(data, final).encode()
            if first:
                data, first = data.removeprefix(codecs.BOM_UTF8), False
            data = rest + data
            if b"\r" in data:
                pending = b"\r" if data.endswith(b"\r") and not final else b""  # its line feed may be in the next block
                data = data[: len(data) - len(pending)].replace(b"\r\n", b"\n").replace(b"\r", b"\n") + pending
            end = len(data) if final else data.rfind(b"\n") + 1
            if end:
                yield data[:end] if data[:end].endswith(b"\n") else data[:end] + b"\n"
            rest = data[end:]
            if final:
                return
            if len(rest) > 4 * _BLOCK:
                what = f"found a line of {len(rest) >> 20} MiB or more that begins with {cut(decoded(rest[:200]))!r}"
                raise ReadError(f"{what}, but a table of numbers is needed")


def _head(blocks: Iterator[bytes], begin: int, above: int) -> list[str]:
    """The first lines of a file, which show its layout; skipped lines, except the last `above`, are returned empty."""
    head: list[str] = []
    size = 0
    for block in blocks:
        for line in block.split(b"\n")[:-1]:
            head.append(decoded(line) if len(head) >= begin - above else "")
            size += len(line) if len(head) > begin else 0
            if size > _HEAD or len(head) > begin + _HEAD_LINES:
                return head
    return head


def _lines_of(block: bytes, begin: int, end: int | None) -> bytes:
    """Lines of a block, by their numbers in it from 0."""
    lines = block.count(b"\n")
    if begin <= 0 and (end is None or end >= lines):
        return block
    return b"".join(line + b"\n" for line in block.split(b"\n")[:-1][max(begin, 0) : end])
