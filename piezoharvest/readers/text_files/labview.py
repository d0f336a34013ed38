"""LabVIEW measurement files (.lvm, or exported as .txt).

Format: National Instruments, "Specification for the LabVIEW Measurement File (.lvm)", ni.com/tutorial/4139. A file
header and a header of the segment, each ended by `***End_of_Header***`, hold tags in the first column and, in that of
the segment, a value above each column; a line of names and the table follow. `X_Columns` says whether the table has
no column of times, one, or one for each channel; there are further segments if data was appended.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from piezoharvest.readers.base import ReadError
from piezoharvest.readers.text_files.layout import Dialect
from piezoharvest.readers.text_files.table import Table
from piezoharvest.readers.text_files.text import Text, half_a_digit
from piezoharvest.readers.units import Unit, unit_of

MAGIC = b"LabVIEW Measurement"  # begins the file, by the specification
_END_OF_HEADER = "***End_of_Header***"
_TIMES = "X_Value"  # name of the columns of times


class LabView(Text):
    """A segment of a LabVIEW measurement file; times are those of the file's own columns, or X0 + n Delta_X."""

    suffixes: ClassVar[tuple[str, ...]] = (".lvm",)
    lines_above: ClassVar[int] = 100  # a segment's header has 9 lines, and maybe special blocks of some more

    def __init__(self, path: Path, skip_rows: int = 0, header_row: int | None = None):
        with path.open("rb") as stream:
            if not self.recognises(stream.read(len(MAGIC) + 3)):
                raise ReadError(f"the file does not begin with {MAGIC.decode()!r}, as files of LabVIEW do")
        super().__init__(path, skip_rows, header_row)
        self._chosen = bool(skip_rows or header_row)
        self._next = next((row for row in self._ends_of_headers() if row > self.first_row), None)
        self._tags = _segment_tags(self.head[: self.layout.above], self.layout.dialect)
        step = self._tag("Delta_X", self._first_channel())
        self.step_error = 0.0 if _TIMES in self._filled() else half_a_digit(step) / abs(self._number(step) or 1.0)

    @classmethod
    def recognises(cls, start: bytes) -> bool:
        return start.removeprefix(b"\xef\xbb\xbf").startswith(MAGIC)

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        if self._next is not None and not self._chosen:
            found = f"found a further segment of data, whose header ends in line {self._next}"
            raise ReadError(f"{found}; header_row (line of the names, {_TIMES} ...) tells which segment is the record")
        return super().read(names)

    def _promised(self) -> int | None:
        found = (cell for cell in self._tags.get("Samples", ())[1:] if cell.isdigit())
        return max(map(int, found), default=None)

    def _table(self, names: Sequence[str], first: int, last: int | None = None) -> Table:
        """The table up to the header of the next segment, whose lines may be the same as those above."""
        table = super()._table(names, first, last if self._next is None else min(last or self._next, self._next))
        table.left_out = None if self._next is not None else table.left_out
        return table

    def unit(self, name: str) -> Unit | None:
        return unit_of(self._tag("Y_Unit_Label", self._positions[name])) or super().unit(name)

    def time_of(self, name: str) -> np.ndarray | None:
        """Times of a channel: the nearest column of times on its left, or X0 + n Delta_X where that is empty."""
        place, filled = self._positions[name], self._filled()
        times = [n for n, title in enumerate(self.names[:place]) if title == _TIMES and _TIMES in filled]
        if times:
            return self._column(times[-1])
        first, step = (self._number(self._tag(tag, place)) for tag in ("X0", "Delta_X"))
        if not step:
            return None
        return (first or 0.0) + step * np.arange(len(self._column(place)))

    def _ends_of_headers(self) -> Iterator[int]:
        """Lines that end a header."""
        row = 0
        for block in self.blocks():
            if _END_OF_HEADER.encode() in block:
                lines = enumerate(block.split(b"\n"), row + 1)
                yield from (n for n, line in lines if line.startswith(_END_OF_HEADER.encode()))
            row += block.count(b"\n")

    def _filled(self) -> set[str]:
        """Names of the columns with numbers: that of the times is there, and empty, if `X_Columns` is "No"."""
        return {self.names[n] for n in self.layout.numeric}

    def _first_channel(self) -> int:
        return next((n for n in self.layout.numeric if self.names[n] != _TIMES), 0)

    def _tag(self, name: str, place: int) -> str:
        """Value of a tag of the segment's header above a column; "" if there is none."""
        cells = self._tags.get(name, ())
        return cells[place] if place < len(cells) else ""

    def _number(self, text: str) -> float | None:
        return Dialect(None, ".").number(text.replace(",", ".")) if text else None


def _segment_tags(lines: Sequence[str], dialect: Dialect) -> dict[str, list[str]]:
    """Cells of the lines of the last header above the table, by their tags."""
    ends = [n for n, line in enumerate(lines) if line.startswith(_END_OF_HEADER)]
    begin, end = (ends[-2], ends[-1]) if len(ends) > 1 else (0, ends[-1] if ends else 0)
    rows = (dialect.split(line) for line in lines[begin:end])
    return {cells[0]: cells for cells in rows if cells and cells[0]}
