"""Base class of the readers: an open data file with named columns."""

from __future__ import annotations

import unicodedata
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from piezoharvest.near_names import did_you_mean
from piezoharvest.readers.units import Unit, stated_unit

_END = 1 << 13  # bytes at the end of a text file in which its last lines are looked at
_LINES_BEFORE, _SHORT = 20, 0.9  # lines with which the last one is compared, and their share that is short
_MAX_QUOTED = 60  # characters of a file's text that a message quotes
# Numbers that may be read for one campaign: 1 GiB as float64, 45 minutes of time and four channels at 10 kHz. A fit
# takes up to ten times that (2 GiB have been measured for 6 million samples of four channels).
MAX_NUMBERS = 1 << 27
LOCKED = "cannot be read while another program has the file open for writing: close it there, or read a copy"


class ReadError(ValueError):
    """A data file cannot be read.

    Attributes
    ----------
    message : str
        What was found, and what is allowed.
    column : str
        Empty if the whole file is meant.
    row : int or None
        Row counted from 1, in a text file the line.
    """

    def __init__(self, message: str, column: str = "", row: int | None = None):
        self.message, self.column, self.row = " ".join(message.split()), column, row  # libraries write several lines
        super().__init__(self.message)


class MissingColumnError(ReadError):
    """The file has no such column; the message lists those that it has."""


class Reader(ABC):
    """A data file of one format. Subclasses give `suffixes` and are found by scanning the package.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    names : sequence of str
        Columns that the file has.
    first_row : int
        Row of the first sample, counted from 1: the line of a text file, else 1.
    numbering : int or (n,) array of int
        Row of the first of the samples that were last read, or of each sample if their rows are not consecutive.
    left_out : tuple of (row, text) or None
        The first line with numbers below the table that was not read.
    cut_off : str
        Why what was last read is likely not the whole of what the instrument wrote; empty if nothing says so.
    magic : tuple of bytes
        One of these begins each file of the format, if there are any.
    step_error : float
        Relative error of the sampling interval that the format itself states (`time_of`), where it is rounded.
    by_lines : bool
        True if rows are lines, of which some may be skipped.
    unsafe : tuple of str
        Libraries that may crash on a damaged file: if there are any, the files are read in a separate process.
    extra : str
        Extra of this package that installs these libraries, if they are not always there.
    most_bytes : int
        Largest allowed file size.
    channels : mapping of str to str
        Channels that columns of the format hold, by their names in lower case, where these are always the same.
    measures : str
        "impedance" if files of the format hold nothing else; empty if they may hold anything.
    whole, part : str
        What messages call the data and one of its columns.

    Raises
    ------
    ReadError
        The file is not of this format, or damaged.
    """

    suffixes: ClassVar[tuple[str, ...]]
    names: Sequence[str]
    first_row: int = 1
    numbering: int | np.ndarray = 1
    left_out: tuple[int, str] | None = None
    cut_off: str = ""
    magic: ClassVar[tuple[bytes, ...]] = ()
    step_error: float = 0.0
    by_lines: ClassVar[bool] = False
    unsafe: ClassVar[tuple[str, ...]] = ()
    extra: ClassVar[str] = ""
    most_bytes: ClassVar[int] = 1 << 62
    channels: ClassVar[Mapping[str, str]] = MappingProxyType({})
    measures: ClassVar[str] = ""
    whole: str = "the file"
    part: str = "column"

    def __init__(self, path: Path):
        self.path = path

    @classmethod
    def recognises(cls, start: bytes) -> bool:
        """True if a text file, whatever its ending, is one of this instrument, because it begins like this."""
        return False

    @abstractmethod
    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Values of columns by their full names, (n,) arrays of float or complex.

        Raises
        ------
        ReadError
            A column holds something that is not a number.
        """

    def read_rows(self, names: Sequence[str], rows: tuple[int, int]) -> dict[str, np.ndarray]:
        """Values of columns in the rows from `rows[0]` to `rows[1]`; other rows are not checked.

        Raises
        ------
        ReadError
            There are no such rows; the error's `column` is then "rows".
        """
        values = self.read(names)
        count, (begin, end) = min(map(len, values.values())), (row - self.first_row for row in rows)
        if begin < 0 or end >= count:
            allowed = f"allowed are rows from {self.first_row} to {self.first_row + count - 1}"
            raise ReadError(f"found {list(rows)}, {allowed}", "rows")
        self.numbering = rows[0]
        return {name: array[begin : end + 1] for name, array in values.items()}

    def unit(self, name: str) -> Unit | None:
        """Unit that the file states for a column."""
        return stated_unit(last_part(name))[1]

    def time_of(self, name: str) -> np.ndarray | None:
        """Time in s of a column's samples, (n,), if the format itself stores it."""
        return None

    def resolve(self, column: str | int) -> str:
        """Full name of a column given by its name, the last part of its path, or its number from 1.

        Raises
        ------
        MissingColumnError
            There is no such column.
        ReadError
            There are several columns of this name.
        """
        if isinstance(column, int):
            if column <= len(self.names):
                return self.names[column - 1]
            found = f"{self.whole} has {len(self.names)} {self.part}s, no {self.part} {column}"
            raise MissingColumnError(found, str(column))
        named = [name for name in self.names if name == column]
        found = named or [name for name in self.names if last_part(name) == column]
        found = found or [name for name in self.names if _plain(column) in (_plain(name), _plain(_without_unit(name)))]
        if len(found) > 1:
            places = " or ".join(str(n) for n, name in enumerate(self.names, start=1) if name in found)
            twice = f"found {len(found)} {self.part}s {cut(column)!r} ({shown(found)})"
            raise ReadError(f"{twice}, give the number of one instead of its name: column = {places}", column)
        if not found:
            hint = did_you_mean(column[:_MAX_QUOTED], [name[:_MAX_QUOTED] for name in self.names])
            others = f"its {self.part}s are {shown(self.names)}" if self.names else "it is empty"
            raise MissingColumnError(f"{self.whole} has no {self.part} {cut(column)!r}{hint}, {others}", column)
        return found[0]

    def close(self) -> None:  # noqa: B027 - most files have nothing to be closed
        """Close the file."""

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def fewer_than_promised(count: int, promised: int | None, what: str) -> str:
    """What says that a file is cut off, where its header promises more than there is: for `Reader.cut_off`."""
    if promised is None or count >= promised:
        return ""
    return f"found {count} {what}, but the header of the file promises {promised}"


def ends_within_a_line(path: Path) -> str:
    """What says that a text file is cut off within its last line: for `Reader.cut_off`.

    Many programs end a file without a line feed; then the last line is as long as those before it.
    """
    with path.open("rb") as stream:
        stream.seek(max(stream.seek(0, 2) - _END, 0))
        lines = stream.read().replace(b"\r\n", b"\n").split(b"\n")
    before = lines[1:-1][-_LINES_BEFORE:]  # the first one may be a part of a line
    if len(before) < _LINES_BEFORE or not lines[-1].strip() or len(lines[-1]) >= _SHORT * min(map(len, before)):
        return ""
    return f"the last line, {cut(lines[-1].decode('latin-1'))!r}, is not terminated and is shorter than those before it"


def check_count(count: int) -> None:
    """Raise `ReadError` if `count` numbers are too many to be read."""
    if count > MAX_NUMBERS:
        raise ReadError(f"found {count} numbers in the columns that are used, allowed are up to {MAX_NUMBERS}")


def last_part(name: str) -> str:
    r"""Last part of a path such as "group/channel", or "Model Root"/"ADC"/"Out1" and Model Root/ADC\Out1 of dSPACE."""
    return name.replace("\\", "/").rsplit("/", 1)[-1].strip('"')


def _without_unit(name: str) -> str:
    """Name without a unit in brackets or after it."""
    bare, unit = stated_unit(name)
    return bare if unit is not None and unit.firm else name


def _plain(name: str) -> str:
    """Name in Unicode normal form, with one character each for micro, ohm and blank."""
    return unicodedata.normalize("NFKC", name).strip()


def named_time(reader: Reader) -> str | None:
    """The one column that is named time, in whatever case, or has a unit of time, as "x-axis" in s; None if none is.

    A column that is named so has a unit of time or none.
    """
    names = list(reader.names)
    units = {name: reader.unit(name) for name in names if names.count(name) == 1}
    named = [name for name in units if stated_unit(name)[0].strip().strip('"').lower() == "time"]
    if not named:
        timed = (name for name, unit in units.items() if unit is not None and unit.firm and unit.si == "s")
        named = list(timed)
    unit = units[named[0]] if len(named) == 1 else None
    return named[0] if len(named) == 1 and (unit is None or unit.si == "s") else None


def cut(text: str) -> str:
    """Text shortened for a message."""
    text = text.strip()
    return text if len(text) <= _MAX_QUOTED else f"{text[:_MAX_QUOTED]}..."


def shown(names: Sequence[str], most: int = 12) -> str:
    """List of names for a message, at most `most` of them."""
    kept = [cut(name) or "''" for name in names[:most]]
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(kept) or "none") + more


def numbers(values: Any, name: str) -> np.ndarray:
    """Values as an array of float or complex, without a copy if they are one already.

    Raises
    ------
    ReadError
        They are not numbers.
    """
    array = np.asarray(values)
    if array.dtype.names == ("real", "imag"):  # how MATLAB and others write complex numbers to HDF5
        array = array["real"] + 1j * array["imag"]
    if array.dtype.kind not in "fiubc":
        raise ReadError(f"found values of type {array.dtype.name}, allowed are numbers", name)
    return np.ascontiguousarray(array, complex if array.dtype.kind == "c" else float)
