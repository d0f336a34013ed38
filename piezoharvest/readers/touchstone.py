"""Touchstone files of one port (.s1p, .z1p, .y1p), as impedance and network analysers write them, as an impedance.

Format: IBIS Open Forum, "Touchstone File Format Specification", version 2.0 (2009): an option line `# HZ S MA R 50`
with the unit of the frequency, the parameter (S, Y or Z), the form of the numbers (MA, DB or RI, angles in degrees) and
the reference resistance, in any order; Y and Z of version 1 are divided by it, those of version 2 are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from piezoharvest.readers.base import Reader, ReadError, check_count, cut, ends_within_a_line, fewer_than_promised

_HERTZ = {"HZ": 1.0, "KHZ": 1e3, "MHZ": 1e6, "GHZ": 1e9}
_FORMS = ("MA", "DB", "RI")
_PARAMETERS = ("S", "Y", "Z")
_COLUMNS = ("frequency_Hz", "impedance")  # the defaults of a record of an impedance


class Touchstone(Reader):
    """Columns "frequency_Hz" and, complex and in ohm, "impedance"; S is converted by the reference resistance."""

    suffixes: ClassVar[tuple[str, ...]] = (".s1p", ".z1p", ".y1p")
    names = _COLUMNS

    def __init__(self, path: Path):
        super().__init__(path)
        self._scale, self._parameter, self._form, self._reference = 1e9, "S", "MA", 50.0  # where no option line is
        self._version = 1.0
        self._promised: int | None = None
        rows: list[list[float]] = []
        numbering: list[int] = []
        for row, line in enumerate(path.read_text("latin-1").splitlines(), start=1):
            words = line.partition("!")[0].upper().split()
            if not words:
                continue
            if words[0].startswith("#"):
                self._take_options([word for word in (words[0][1:], *words[1:]) if word], row)
            elif words[0].startswith("["):
                self._take_keyword(" ".join(words), row)
            else:
                rows.append(_numbers(words, line, row))
                numbering.append(row)
        if not rows:
            raise ReadError("found no rows of numbers, but a frequency and two numbers are needed in each")
        check_count(3 * len(rows))
        table = np.array(rows)
        columns = self._scale * table[:, 0], self._impedance(table[:, 1:])
        self._values: dict[str, np.ndarray] = dict(zip(_COLUMNS, columns, strict=True))
        self._rows = np.array(numbering)
        self.cut_off = fewer_than_promised(len(rows), self._promised, "frequencies") or ends_within_a_line(path)
        self.first_row = numbering[0]

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        self.numbering = self._rows
        return {name: self._values[name] for name in names}

    def _take_options(self, words: Sequence[str], row: int) -> None:
        """Set what the option line says."""
        left = list(words)
        while left:
            word = left.pop(0)
            if word in _HERTZ:
                self._scale = _HERTZ[word]
            elif word in _FORMS:
                self._form = word
            elif word in _PARAMETERS:
                self._parameter = word
            elif word == "R" and left:
                self._reference = _resistance(left.pop(0), row)
            else:
                allowed = f"{', '.join((*_HERTZ, *_PARAMETERS, *_FORMS))} and R with a resistance"
                raise ReadError(f"found {cut(word)!r} in the option line, allowed are {allowed}", row=row)

    def _take_keyword(self, line: str, row: int) -> None:
        """Set what a keyword of version 2 says."""
        keyword, _, value = line[1:].partition("]")
        if keyword == "VERSION":
            self._version = 2.0 if value.strip().startswith("2") else 1.0
        elif keyword == "REFERENCE" and value.strip():
            self._reference = _resistance(value.split()[0], row)
        elif keyword == "NUMBER OF FREQUENCIES" and value.strip().isdigit():
            self._promised = int(value)
        elif keyword == "NUMBER OF PORTS" and value.strip() != "1":
            found = f"found {cut(value.strip()) or 'no number of'} ports"
            raise ReadError(f"{found}, there must be one port, the leads of the transducer", row=row)

    def _impedance(self, pairs: np.ndarray) -> np.ndarray:
        """Impedance in ohm from the two numbers of each row."""
        first, second = pairs.T
        unit = self._reference if self._version < 2 or self._parameter == "S" else 1.0
        # S = 1 and Y = 0 are open leads, and a level may be too large for a number: checks find them.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            if self._form == "RI":
                value = first + 1j * second
            else:
                size = 10 ** (first / 20) if self._form == "DB" else first
                value = size * np.exp(1j * np.radians(second))
            if self._parameter == "S":
                return unit * (1 + value) / (1 - value)
            return unit * value if self._parameter == "Z" else unit / value


def _numbers(words: Sequence[str], line: str, row: int) -> list[float]:
    """Frequency and two numbers of a row; raises `ReadError`."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != 3:
        raise ReadError(f"found {cut(line)!r}, allowed are a frequency and two numbers (of one port)", row=row)
    return values


def _resistance(word: str, row: int) -> float:
    """Reference resistance in ohm; raises `ReadError`."""
    try:
        value = float(word)
    except ValueError:
        value = 0.0
    if not 0 < value < np.inf:
        raise ReadError(f"found the reference resistance {cut(word)!r}, must be a number above 0 (ohm)", row=row)
    return value
