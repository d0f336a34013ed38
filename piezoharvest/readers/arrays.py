"""Base class of readers of files that hold arrays: columns of matrices are named as numpy indexes them."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import product
from math import prod
from typing import Any

import numpy as np

from piezoharvest.readers.base import Reader, ReadError, check_count, numbers

_INDEX = re.compile(r"(.*)\[([\d\s,:-]*)\]", re.S)
_MAX_LISTED_COLUMNS = 200  # columns of one array that are listed one by one


class Deferred:
    """An array that is read as a whole, at the first access."""

    def __init__(self, shape: tuple[int, ...], load: Callable[[], np.ndarray]):
        self.shape, self._load = shape, load

    @cached_property
    def _array(self) -> np.ndarray:
        return self._load()

    def __getitem__(self, index: tuple[Any, ...]) -> np.ndarray:
        return self._array[index]


class ArrayReader(Reader):
    """A file with named arrays.

    A vector is the column of its name. A column of a larger array is `name[:, 2]`, in numpy's notation, counted from 0;
    further colons are concatenated: of an array (samples, channels, periods), `name[:, 1, :]` is channel 1
    through all periods.
    """

    arrays: Mapping[str, Any]

    def _found(self, arrays: Mapping[str, Any]) -> None:
        """Set the arrays of the file: any objects with a shape that can be indexed."""
        self.arrays = arrays
        self.names = tuple(column for name, array in arrays.items() for column in _columns(name, array.shape))

    @abstractmethod
    def _values(self, array: Any, index: tuple[Any, ...]) -> Any:
        """Part of an array."""

    def resolve(self, column: str | int) -> str:
        indexed = isinstance(column, str) and _INDEX.fullmatch(column)
        if not indexed or column in self.names:
            found = super().resolve(column)
            if found in self.arrays or _INDEX.fullmatch(found):
                return found
            shape = self.arrays[found.rpartition("[")[0]].shape  # of an array whose columns are too many to be listed
            raise ReadError(
                f"found an array of shape {shape}, one of its columns must be selected by an index", str(column)
            )
        name, index = indexed.groups()
        if name not in self.arrays:
            name = super().resolve(name)
        shape, parts = self.arrays[name].shape, [part.strip() for part in index.split(",")]
        fine = len(parts) == len(shape) and ":" in parts and all(part == ":" or part.isdigit() for part in parts)
        beyond = [(part, n) for part, n in zip(parts, shape, strict=False) if part.isdigit() and int(part) >= n]
        if fine and beyond:
            needed = f"the index {beyond[0][0]} must be from 0 to {beyond[0][1] - 1}"
            raise ReadError(f"found an array of shape {shape}, {needed}", str(column))
        if not fine:
            needed = "a column is selected by an index with a number or : for each axis, and : for at least one"
            raise ReadError(f"found an array of shape {shape}, {needed}", str(column))
        return f"{name}[{', '.join(parts)}]"

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        places = {name: self._place(name) for name in names}
        check_count(sum(_size(*place) for place in places.values()))
        return {name: self._column(name, *place) for name, place in places.items()}

    def _place(self, name: str) -> tuple[Any, tuple[Any, ...]]:
        """Array and index of a column."""
        indexed = _INDEX.fullmatch(name)
        if name in self.arrays or not indexed:
            return self.arrays[name], ()
        return self.arrays[indexed[1]], tuple(
            slice(None) if part == ":" else int(part) for part in indexed[2].split(", ")
        )

    def _column(self, name: str, array: Any, index: tuple[Any, ...]) -> np.ndarray:
        try:
            values = self._values(array, index)
        except MemoryError:
            raise
        except Exception as error:  # libraries raise any exception on damaged files
            raise ReadError(f"the file is damaged ({error})", name) from None
        return numbers(np.ravel(values, order="F"), name)


def _size(array: Any, index: tuple[Any, ...]) -> int:
    """Number of values that have to be read for a column."""
    if isinstance(array, Deferred) or not index:
        return prod(array.shape)
    return prod(n for n, part in zip(array.shape, index, strict=True) if part == slice(None))


def _columns(name: str, shape: tuple[int, ...]) -> Iterator[str]:
    """Names of the columns of an array: samples run along its longest axis."""
    if prod(shape) <= 1:
        return
    axis = int(np.argmax(shape))
    if name and prod(shape) == max(shape):
        yield name
    elif prod(shape) // max(shape) > _MAX_LISTED_COLUMNS:
        yield f"{name}[{', '.join(f'0..{n - 1}' for n in shape)}]"
    else:
        for index in product(*(":" if n == axis else map(str, range(size)) for n, size in enumerate(shape))):
            yield f"{name}[{', '.join(index)}]"
