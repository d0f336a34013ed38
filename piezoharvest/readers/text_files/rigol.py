"""CSV files of Rigol's oscilloscopes that have no column of times.

As the DS1000Z and its kin write it, the first line names the columns and ends in `Start,Increment`; the second holds
`Sequence`, the unit of each channel, and there the time of the first sample and the step, in s. As the MSO5000 and the
DHO800 write it, the only line above the samples is `CH1V,CH2A,t0 =-2.500000e-03, tInc = 5.000000e-09,`: names that end
in the unit of the channel, and the two times.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

import numpy as np

from piezoharvest.readers.text_files.layout import Dialect
from piezoharvest.readers.text_files.text import Text, half_a_digit
from piezoharvest.readers.units import Unit, unit_of

_TIMES = re.compile(r",\s*t0\s*=\s*([^,]*),\s*tInc\s*=\s*([^,]*)[,\s]*$", re.IGNORECASE)
_CHANNEL = re.compile(r"(?:CH|MATH|REF|D)\d+(?P<unit>\D+)", re.IGNORECASE)
_FIRST_LINES = re.compile(rb"(?:\xef\xbb\xbf)?X,[^\r\n]*,Start,Increment,*\s*[\r\n]+Sequence,", re.IGNORECASE)


class Rigol(Text):
    """Samples of an oscilloscope with their times: Start + number Increment."""

    suffixes: ClassVar[tuple[str, ...]] = ()
    lines_above: ClassVar[int] = 1 << 30  # whatever is skipped, the first two lines are needed

    def __init__(self, path: Path, skip_rows: int = 0, header_row: int | None = None):
        self._stated: dict[str, str] = {}
        super().__init__(path, skip_rows, header_row)
        start, step = (self._stated.get(name, "") for name in ("start", "increment"))
        self._start, self._step = (_number(text, self.layout.dialect) for text in (start, step))
        self._timed = bool(np.isfinite(self._start) and 0.0 < self._step < np.inf)
        self.step_error = half_a_digit(step) / self._step if self._timed else 0.0

    def prepared(self, head: list[str]) -> list[str]:
        """Lines whose first two name only the columns, not start and step, which no other row has."""
        titles, values = (line.split(",") for line in head[:2])
        self._stated = {title.strip().lower(): value for title, value in zip(titles, values, strict=False)}
        columns = next((n for n, title in enumerate(titles) if title.strip().lower() == "start"), len(titles))
        return [",".join(titles[:columns]), ",".join(values[:columns]), *head[2:]]

    @classmethod
    def recognises(cls, start: bytes) -> bool:
        return _FIRST_LINES.match(start) is not None

    def time_of(self, name: str) -> np.ndarray | None:
        return self._start + self._step * self._column(0) if self._timed else None


class RigolRows(Text):
    """Samples of an oscilloscope with their times: t0 + row tInc."""

    suffixes: ClassVar[tuple[str, ...]] = ()
    lines_above: ClassVar[int] = 1 << 30  # whatever is skipped, the first line is needed

    def __init__(self, path: Path, skip_rows: int = 0, header_row: int | None = None):
        self._stated = ("", "")
        super().__init__(path, skip_rows, header_row)
        self._start, self._step = (_number(text, self.layout.dialect) for text in self._stated)
        self._timed = bool(np.isfinite(self._start) and 0.0 < self._step < np.inf)
        self.step_error = half_a_digit(self._stated[1]) / self._step if self._timed else 0.0

    def prepared(self, head: list[str]) -> list[str]:
        """Lines whose first one names only the channels, not the times behind them."""
        if (times := _TIMES.search(head[0])) is None:
            return head
        self._stated = times[1].strip(), times[2].strip()
        return [head[0][: times.start()], *head[1:]]

    @classmethod
    def recognises(cls, start: bytes) -> bool:
        return _TIMES.search(start.decode("latin-1").splitlines()[0]) is not None if start.strip() else False

    def unit(self, name: str) -> Unit | None:
        channel = _CHANNEL.fullmatch(name)
        return super().unit(name) if channel is None else unit_of(channel["unit"])

    def time_of(self, name: str) -> np.ndarray | None:
        below = self.first_row - 2  # samples above those that are read
        return self._start + self._step * (below + np.arange(len(self._column(0)))) if self._timed else None


def _number(text: str, dialect: Dialect) -> float:
    """Number in a cell; NaN if there is none."""
    value = dialect.number(text)
    return np.nan if value is None else value
