"""Traces of the impedance analyser 4294A as text: two tables one below the other, for trace A and trace B.

Format: Agilent 4294A Operation Manual (04294-90060), chapter 8, on what the trace data holds; the lines are those that
programs of its users expect: settings in quotation marks, and for each trace `"TRACE: A"`, `"FORMAT: ..."`, an empty
line, the names `"Frequency"`, `"Real"`, `"Imag"` and the table. What is shown as one real number, as |Z| or the phase,
stands under Real. What FORMAT says is not used: a record names the columns itself.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from piezoharvest.readers.base import Reader, ReadError, cut

_TITLE = re.compile(r'"?TRACE: ([A-Z])"?\s*')
_NAMES = ("Real", "Imag")


class Agilent4294A(Reader):
    """All traces side by side: columns "Frequency", "A Real", "A Imag", "B Real", "B Imag"."""

    suffixes: ClassVar[tuple[str, ...]] = ()
    most_bytes = 1 << 22  # 1601 points of two traces are less than 200 kB

    def __init__(self, path: Path):
        super().__init__(path)
        tables = _tables(path.read_text("latin-1").splitlines())
        frequencies = [table[:, 0] for _, _, table in tables]
        if not all(np.array_equal(each, frequencies[0]) for each in frequencies[1:]):
            raise ReadError("the traces do not have the same frequencies")
        self._columns = {"Frequency": frequencies[0]}
        self._columns |= {
            f"{title} {name}": table[:, n] for title, _, table in tables for n, name in enumerate(_NAMES, start=1)
        }
        self.names = tuple(self._columns)
        self.first_row = self.numbering = tables[0][1]

    @classmethod
    def recognises(cls, start: bytes) -> bool:
        return start.startswith(b'"4294A')

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        self.numbering = self.first_row
        return {name: self._columns[name] for name in names}


def _tables(lines: Sequence[str]) -> list[tuple[str, int, np.ndarray]]:
    """Title, line of the first row, and rows (n, 3) of each trace."""
    found: list[tuple[str, int, list[list[float]]]] = []
    title = ""
    for row, line in enumerate(lines, start=1):
        if match := _TITLE.fullmatch(line):
            title = match[1]
        cells = line.split()
        if not title or not cells or line.startswith('"'):
            continue
        if not found or found[-1][0] != title:
            found.append((title, row, []))
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            values = []
        if len(values) != 1 + len(_NAMES):
            raise ReadError(f"found {cut(line)!r} in trace {title}, allowed are three numbers", row=row)
        found[-1][2].append(values)
    if not found:
        raise ReadError('found no trace, which begins with "TRACE: A"')
    return [(title, row, np.array(rows)) for title, row, rows in found]
