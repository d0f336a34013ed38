"""MATLAB files: v5 to v7 by scipy, v7.3 by h5py; recordings of dSPACE ControlDesk in either."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from piezoharvest.readers.arrays import ArrayReader, Deferred
from piezoharvest.readers.base import LOCKED, ReadError
from piezoharvest.readers.hdf5 import dtype_of, holds_numbers

_NUMERIC = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
_NESTED = ("struct", "cell", "object")
_MAX_INNER = 100_000  # references or characters that are read of one data set: cells, names of signals


class Matlab(ArrayReader):
    """MATLAB file: vectors and matrices by their names, those within structures as in "scope.signals(2).values".

    ControlDesk writes one structure with the fields X (time of each raster) and Y (the signals, with Name, Data and
    XIndex). Its signals are columns by their names, or by the last part of these, and their time is known.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mat",)
    unsafe: ClassVar[tuple[str, ...]] = ("h5py", "scipy.io")

    def __init__(self, path: Path):
        import h5py

        super().__init__(path)
        self._file: Any = None
        self._times: dict[str, Any] = {}
        try:
            if h5py.is_hdf5(path):
                self._file = h5py.File(path, "r")
                tree = {name: _from_hdf5(item) for name, item in self._file.items() if not name.startswith("#")}
            else:
                tree = _from_scipy(path)
            arrays: dict[str, Any] = {}
            for name, item in tree.items():
                arrays |= self._recording(item) if _is_recording(item) else dict(_flat(name, item))
        except MemoryError:
            raise
        except BlockingIOError:
            raise ReadError(LOCKED) from None
        except Exception as error:  # libraries raise any exception on damaged files
            raise ReadError(f"not a complete MATLAB file ({error})") from None
        self._found(arrays)

    def _values(self, array: Any, index: tuple[Any, ...]) -> Any:
        return array[index]

    def time_of(self, name: str) -> np.ndarray | None:
        """Time of the raster that the signal was recorded in."""
        time = self._times.get(name)
        return None if time is None else np.ravel(time[()]).astype(float)

    def close(self) -> None:
        if self._file is not None:
            self._file.close()

    def _recording(self, item: dict[str, Any]) -> dict[str, Any]:
        """Signals of a recording by name; sets their times."""
        signals = _as_list(item["Y"])
        count = Counter(str(signal["Name"]) for signal in signals)
        rasters = [x["Data"] for x in _as_list(item["X"])]
        found = {}
        for signal in signals:
            name = str(signal["Name"])
            if count[name] > 1:  # newer versions keep the path of a signal apart from its name
                name = f"{signal.get('Path', '')}/{name}"
            found[name] = signal["Data"]
            given = int(np.ravel(signal["XIndex"][()])[0]) - 1 if "XIndex" in signal else 0
            rasters_first = rasters[given : given + 1] + rasters
            fitting = (x for x in rasters_first if np.prod(x.shape) == np.prod(signal["Data"].shape))
            self._times[name] = next(fitting, None)
        return found


def _is_recording(item: Any) -> bool:
    """True if a structure is a recording of ControlDesk."""
    if not isinstance(item, dict) or not {"X", "Y"} <= item.keys():
        return False
    parts = [_as_list(item["X"]), _as_list(item["Y"])]
    return all(isinstance(part, dict) and "Data" in part for some in parts for part in some) and all(
        "Name" in signal for signal in parts[1]
    )


def _as_list(item: Any) -> Sequence[Any]:
    return item if isinstance(item, list) else [item]


def _flat(name: str, item: Any) -> Iterator[tuple[str, Any]]:
    """Arrays of numbers within an item, named as MATLAB would."""
    if isinstance(item, dict):
        for field, inner in item.items():
            yield from _flat(f"{name}.{field}", inner)
    elif isinstance(item, list):
        for n, inner in enumerate(item, 1):
            yield from _flat(f"{name}({n})", inner)
    elif not isinstance(item, str):
        yield name, item


def _from_scipy(path: Path) -> dict[str, Any]:
    """Variables of a file of version 4 to 7 as dicts, lists, strings and arrays, the latter read at first access."""
    from scipy.io import whosmat

    found: dict[str, Any] = {}
    for name, shape, kind in whosmat(path):
        if kind in _NUMERIC:
            found[name] = Deferred(tuple(n for n in shape if n != 1), partial(_variable, path, name))
        elif kind in _NESTED and not name.startswith("__"):
            found[name] = _plain(_variable(path, name))
    return found


def _variable(path: Path, name: str) -> Any:
    from scipy.io import loadmat

    return loadmat(path, variable_names=[name], squeeze_me=True, struct_as_record=False, chars_as_strings=True)[name]


def _plain(item: Any) -> Any:
    if hasattr(item, "_fieldnames"):
        return {field: _plain(getattr(item, field)) for field in item._fieldnames}
    array = np.asarray(item)
    if array.dtype.kind == "O":
        return [_plain(inner) for inner in array.ravel()]
    return array if array.dtype.kind in "fiubc" else str(item)


class _Transposed:
    """Data set of a v7.3 file, which stores axes in reverse order, with the axes as MATLAB shows them."""

    def __init__(self, data: Any):
        self._data = data
        self.shape, self.dtype = data.shape[::-1], data.dtype

    def __getitem__(self, index: tuple[Any, ...]) -> np.ndarray:
        return np.transpose(self._data[tuple(index)[::-1]])


def _from_hdf5(item: Any) -> Any:
    """Item of a v7.3 file as dict, list, string or array."""
    import h5py

    kind = item.attrs.get("MATLAB_class", b"")
    if isinstance(item, h5py.Group):
        fields = dict(item.items())
        # The fields of an array of structures are references to the values of each element, without a MATLAB class.
        if fields and all(_is_reference(field) and "MATLAB_class" not in field.attrs for field in fields.values()):
            columns = {name: _dereferenced(field) for name, field in fields.items()}
            return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        return {name: _from_hdf5(field) for name, field in fields.items()}
    if _is_reference(item):
        return _dereferenced(item)
    if kind == b"char":
        return "" if "MATLAB_empty" in item.attrs else "".join(map(chr, np.ravel(_inner(item))))
    return _Transposed(item) if holds_numbers(item) and "MATLAB_empty" not in item.attrs else ""


def _is_reference(item: Any) -> bool:
    dtype = dtype_of(item)
    return dtype is not None and dtype.kind == "O"


def _inner(item: Any) -> np.ndarray:
    """References or characters of a data set; their number is limited, for a damaged file may claim any."""
    if item.size is not None and item.size > _MAX_INNER:
        raise ValueError(f"{item.name} with {item.size} elements, of which at most {_MAX_INNER} are followed")
    return item[()]


def _dereferenced(item: Any) -> list[Any]:
    return [_from_hdf5(item.file[reference]) for reference in np.ravel(_inner(item), order="F") if reference]
