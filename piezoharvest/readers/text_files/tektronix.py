"""CSV files of Tektronix oscilloscopes that write their settings beside the first samples.

As the TDS1000 to TDS3000 write it, a file has no line of names: each of the first rows holds a setting in its first
cells (`Record Length,2.500000e+03,`, `Source,CH1,`, `Vertical Units,V,`, `Horizontal Units,s,`), and behind them the
time and the value of a sample.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from piezoharvest.readers.text_files.text import Text

_FIRST_LINE = re.compile(rb'(?:\xef\xbb\xbf)?"?Record Length"?[,;\t][^\r\n]*\d[,;\t]? *[\r\n]', re.IGNORECASE)
_SETTINGS = 40  # lines that may hold one; a TDS2000 writes 16


class Tektronix(Text):
    """Samples with the names and units that the settings beside them state; columns of settings have no names."""

    suffixes: ClassVar[tuple[str, ...]] = ()
    lines_above: ClassVar[int] = 1 << 30  # whatever is skipped, the settings are needed

    def __init__(self, path: Path, skip_rows: int = 0, header_row: int | None = None):
        super().__init__(path, skip_rows, header_row)
        split = self.layout.dialect.split
        rows = [cells for cells in map(split, self.head[:_SETTINGS]) if len(cells) >= 2 and cells[0]]
        self._settings: Mapping[str, str] = {cells[0].lower(): cells[1] for cells in rows}
        if self.layout.named or len(self.layout.numeric) != 2 or self.layout.numeric[0] < 2:
            return
        time, value = self.layout.numeric
        names, units = ([""] * self.layout.width for _ in range(2))
        names[time], names[value] = "Time", self._settings.get("source", "") or str(value + 1)
        units[time] = self._settings.get("horizontal units", "s")
        units[value] = self._settings.get("vertical units", "")
        self.layout = replace(self.layout, names=tuple(names), units=tuple(units), named=True)
        self.names = self.layout.names
        self._positions = {self._key(n): n for n in range(self.layout.width)}

    @classmethod
    def recognises(cls, start: bytes) -> bool:
        return _FIRST_LINE.match(start) is not None

    def _promised(self) -> int | None:
        stated = self.layout.dialect.number(self._settings.get("record length", "x"))
        return None if self.layout.above or stated is None else int(stated)
