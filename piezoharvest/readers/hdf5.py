"""HDF5 files."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from piezoharvest.readers.arrays import ArrayReader
from piezoharvest.readers.base import LOCKED, ReadError


class Hdf5(ArrayReader):
    """HDF5 file: every data set of numbers, by its path; a column may also be named by the last part alone."""

    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5", ".hdf")
    unsafe: ClassVar[tuple[str, ...]] = ("h5py",)

    def __init__(self, path: Path):
        import h5py

        super().__init__(path)
        arrays: dict[str, Any] = {}

        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and holds_numbers(item):
                arrays[name] = item

        try:
            self._file = h5py.File(path, "r")
            self._file.visititems(visit)
        except BlockingIOError:
            raise ReadError(LOCKED) from None
        except (OSError, RuntimeError, KeyError) as error:
            raise ReadError(f"not a complete HDF5 file ({error})") from None
        self._found(arrays)

    def _values(self, array: Any, index: tuple[Any, ...]) -> Any:
        return array[index]

    def close(self) -> None:
        self._file.close()


def holds_numbers(data: Any) -> bool:
    """True if a data set holds numbers; one without a shape is empty."""
    dtype = dtype_of(data)
    return dtype is not None and data.shape is not None and (dtype.kind in "fiubc" or dtype.names == ("real", "imag"))


def dtype_of(item: Any) -> Any:
    """Numpy dtype of a data set; None for types that numpy does not have, and for groups."""
    try:
        return item.dtype
    except (TypeError, AttributeError):
        return None
