"""Readers of data files, one for each format; every module of this package that defines suffixes is found by scanning.

A reader opens a file, lists the columns that it has and reads those that are wanted. Add a format by one more file with
a subclass of `Reader`, here or in a script of your own.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from piezoharvest.description.parameters import subclasses_by
from piezoharvest.input import InputError, check_readable
from piezoharvest.readers.apart import Apart
from piezoharvest.readers.base import MissingColumnError, Reader, ReadError

__all__ = ["MissingColumnError", "ReadError", "Reader", "open_reader", "registered"]

_SPREADSHEETS = (".xlsx", ".xls", ".xlsm", ".ods")
_START = 1024  # bytes by which a reader recognises the text files of its instrument

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")


def registered() -> dict[str, type[Reader]]:
    """All readers by the endings of the files that they read, those that a user's own script defines included."""
    return {suffix: cls for suffixes, cls in subclasses_by("suffixes", Reader).items() for suffix in suffixes}


def open_reader(path: Path, **lines: int) -> Reader:
    """Open a data file by the ending of its name.

    Parameters
    ----------
    path : Path
    **lines : int
        `skip_rows` and `header_row` of a text file, as in `text.Text`.

    Raises
    ------
    ReadError
        No such file, an unknown ending, or a file that is not what its ending says.
    """
    known = registered()
    if os.path.isdir(path):
        raise ReadError("found a directory, but a data file is needed")
    if path.suffix.lower() not in known:
        if path.suffix.lower() in _SPREADSHEETS:
            raise ReadError(f"found {path.suffix!r}, a spreadsheet, which cannot be read: save the sheet as .csv")
        found = repr(path.suffix) if path.suffix else "no ending"
        endings = ", ".join(sorted(known))
        raise ReadError(f"found {found}, allowed are names ending in {endings} (.txt for any table of numbers in text)")
    cls = known[path.suffix.lower()]
    try:
        empty = not check_readable(path, cls.most_bytes)
    except InputError as error:
        raise ReadError(str(error)) from None
    if empty:
        raise ReadError("the file is empty, it must contain measured data")
    _check_magic(path, cls)
    cls = _special(path, cls, bool(lines)) if cls.by_lines else cls
    if lines and not cls.by_lines:
        allowed = ", ".join(sorted(suffix for suffix, each in known.items() if each.by_lines))
        raise ReadError(f"{' and '.join(lines)} may be given for text files only ({allowed})")
    missing = [name for name in cls.unsafe if cls.extra and find_spec(name) is None]
    if missing:
        needed = f"the package {missing[0]} is missing, which reads {cls.suffixes[0]} files"
        raise ReadError(f"{needed}: pip install 'piezoharvest[{cls.extra}]'")
    return Apart(path, cls.unsafe) if cls.unsafe and sys.executable else cls(path, **lines)


def _check_magic(path: Path, cls: type[Reader]) -> None:
    """Raise `ReadError` if a file does not begin as all of its format do: it has another, or is damaged."""
    with path.open("rb") as stream:
        start = stream.read(_START)
    if cls.magic and not start.startswith(cls.magic):
        own = path.suffix.lower()
        raise ReadError(f"found a file that does not begin as {own} files do: its extension is wrong, or it is damaged")


def _special(path: Path, cls: type[Reader], by_lines: bool) -> type[Reader]:
    """Reader of the instrument that wrote a text file, if there is one; one that can skip lines where that is asked."""
    with path.open("rb") as stream:
        start = stream.read(_START)
    known = (each for each in _subclasses(Reader) if each.by_lines or not by_lines)
    return next((each for each in known if each.recognises(start)), cls)


def _subclasses(cls: type[Reader]) -> Iterator[type[Reader]]:
    for each in cls.__subclasses__():
        yield each
        yield from _subclasses(each)
