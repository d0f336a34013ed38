"""Traces of the impedance analyser 4294A as text: two tables one below the other, for trace A and trace B.

Format: Agilent 4294A Operation Manual (04294-90060), chapter 8, on what the trace data holds; the lines are those that
programs of its users expect: settings in quotation marks, and for each trace `"TRACE: A"`, `"FORMAT: ..."`, an empty
line, the names `"Frequency"`, `"Real"`, `"Imag"` and the table. What is shown as one real number, as |Z| or the phase,
stands under Real, and 0 under Imag. FORMAT names the measurement parameter that is shown: of the manual's list |Z|,
theta, R, X, |Y|, G, B, Ls, Lp, Cs, Cp, Rs, Rp, D, Q, and Z and Y as complex numbers. No file of the instrument was
seen, so a FORMAT that is none of these is passed over, and the record names the columns itself.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, NamedTuple

import numpy as np

from piezoharvest.readers.base import Reader, ReadError, cut

_TITLE = re.compile(r'"?TRACE: ([A-Z])"?\s*')
_FORMAT = re.compile(r'"?FORMAT: *([^"]*)"?\s*')
_NAMES = ("Real", "Imag")
# Measurement parameters, in lower case without blanks, and the columns that a record of an impedance reads without
# being told, in SI units.
_PARAMETERS: Mapping[str, str] = MappingProxyType({
    "|z|": "impedance_ohm", "r": "resistance_ohm", "rs": "resistance_ohm", "x": "reactance_ohm", "|y|": "admittance_S",
    "g": "conductance_S", "b": "susceptance_S", "ls": "series_inductance_H", "lp": "parallel_inductance_H",
    "cs": "series_capacitance_F", "cp": "parallel_capacitance_F", "rp": "parallel_resistance_ohm",
    "d": "loss_factor", "q": "quality_factor",
})  # fmt: skip
_COMPLEX = MappingProxyType({"z": ("resistance_ohm", "reactance_ohm"), "y": ("conductance_S", "susceptance_S")})
_ANGLES = re.compile(r"(?:theta|\u03b8|\u00e8|phase)-?[zy]?")  # Greek letters of the instrument's own character set
_TURN = 2 * np.pi  # rad; a phase beyond is in degrees, which the instrument shows unless it is set to radians


class _Trace(NamedTuple):
    """A table of the file: its letter, what it shows, line of the first row, and rows (n, 3)."""

    title: str
    shown: str
    first_row: int
    rows: np.ndarray


class Agilent4294A(Reader):
    """All traces side by side, and what they show: "Frequency", "A Real", "A Imag", "B Real", ..., "impedance_ohm"."""

    suffixes: ClassVar[tuple[str, ...]] = ()
    measures: ClassVar[str] = "impedance"
    most_bytes = 1 << 22  # 1601 points of two traces are less than 200 kB

    def __init__(self, path: Path):
        super().__init__(path)
        traces = _traces(path.read_text("latin-1").splitlines())
        frequencies = [trace.rows[:, 0] for trace in traces]
        if not all(np.array_equal(each, frequencies[0]) for each in frequencies[1:]):
            raise ReadError("the traces do not have the same frequencies")
        self._columns = {"Frequency": frequencies[0]}
        self._columns |= {
            f"{trace.title} {name}": trace.rows[:, n] for trace in traces for n, name in enumerate(_NAMES, start=1)
        }
        self._columns |= dict(_shown(traces))
        self.names = tuple(self._columns)
        self.first_row = self.numbering = traces[0].first_row

    @classmethod
    def recognises(cls, start: bytes) -> bool:
        return start.startswith(b'"4294A')

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        self.numbering = self.first_row
        return {name: self._columns[name] for name in names}


def _traces(lines: Sequence[str]) -> list[_Trace]:
    """Each trace of the file, in its order."""
    found: list[tuple[str, str, int, list[list[float]]]] = []
    title = shown = ""
    for row, line in enumerate(lines, start=1):
        if match := _TITLE.fullmatch(line):
            title, shown = match[1], ""
        elif match := _FORMAT.fullmatch(line):
            shown = re.sub(r"\s", "", match[1]).lower()
        cells = line.split()
        if not title or not cells or line.startswith('"'):
            continue
        if not found or found[-1][0] != title:
            found.append((title, shown, row, []))
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            values = []
        if len(values) != 1 + len(_NAMES):
            raise ReadError(f"found {cut(line)!r} in trace {title}, allowed are three numbers", row=row)
        found[-1][3].append(values)
    if not found:
        raise ReadError('found no trace, which begins with "TRACE: A"')
    return [_Trace(title, shown, row, np.array(rows)) for title, shown, row, rows in found]


def _shown(traces: Sequence[_Trace]) -> Iterator[tuple[str, np.ndarray]]:
    """Columns by the names of what the traces show; none where FORMAT or the unit of a phase is not certain."""
    beside = {trace.shown for trace in traces}
    for shown, real, imaginary in ((trace.shown, trace.rows[:, 1], trace.rows[:, 2]) for trace in traces):
        if shown in _COMPLEX:
            if imaginary.any():
                yield from zip(_COMPLEX[shown], (real, imaginary), strict=True)
        elif imaginary.any():  # not one real number, as the parameter is
            continue
        elif shown in _PARAMETERS:
            yield _PARAMETERS[shown], real
        elif _ANGLES.fullmatch(shown) and np.abs(real).max() > _TURN:
            admittance = shown.endswith("y") or "|y|" in beside
            yield "admittance_phase_rad" if admittance else "phase_rad", np.deg2rad(real)
