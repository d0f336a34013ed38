"""Files of numpy: .npz with several arrays, .npy with one."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, ClassVar
from zipfile import ZipFile

import numpy as np
from numpy.lib import format as form

from piezoharvest.readers.arrays import ArrayReader, Deferred
from piezoharvest.readers.base import ReadError

_NUMBERS = "fiubc"  # kinds of dtype
# Version 3 differs only in the names of fields, which arrays of numbers do not have.
_HEADERS = {(1, 0): form.read_array_header_1_0, (2, 0): form.read_array_header_2_0}


class NumpyFile(ArrayReader):
    """Arrays saved by numpy; that of a .npy file has no name: "[:, 0]", or "[:]" if it is a vector."""

    suffixes: ClassVar[tuple[str, ...]] = (".npz", ".npy")
    magic: ClassVar[tuple[bytes, ...]] = (b"PK\x03\x04", b"PK\x05\x06", b"\x93NUMPY")

    def __init__(self, path: Path):
        super().__init__(path)
        try:
            self._file = np.load(path, mmap_mode="r", allow_pickle=False)
            if isinstance(self._file, np.ndarray):
                arrays = {"": self._file} if self._file.dtype.kind in _NUMBERS else {}
            else:
                arrays = dict(_members(self._file))
        except Exception as error:  # zipfile, zlib and numpy each have their own
            raise ReadError(f"not a complete NumPy file without pickled objects ({error})") from None
        self._found(arrays)

    def close(self) -> None:
        if not isinstance(self._file, np.ndarray):
            self._file.close()

    def _values(self, array: Any, index: tuple[Any, ...]) -> Any:
        return array[index]


def _members(file: Any) -> Iterator[tuple[str, Deferred]]:
    """Arrays of a .npz file by name; only their headers are read."""
    for member in file.zip.namelist():
        with file.zip.open(member) as stream:
            if not member.endswith(".npy") or (version := form.read_magic(stream)) not in _HEADERS:
                continue
            shape, _, dtype = _HEADERS[version](stream)
        if dtype.kind in _NUMBERS:
            yield member.removesuffix(".npy"), Deferred(shape, partial(_load, file.zip, member))


def _load(archive: ZipFile, member: str) -> np.ndarray:
    with archive.open(member) as stream:
        return form.read_array(stream, allow_pickle=False)
